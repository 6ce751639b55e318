"""The file of a heat profile: read as written, and refused where it contradicts itself."""

import pytest

from fsw_control.schema.models import InputError
from fsw_model import nominal
from fsw_model.heat_profile import HeatProfile, HeatSource, ThermalModel

PROFILE = HeatProfile(
    type="copper_lid",
    model=ThermalModel.of(nominal()),
    welds=(HeatSource(weld="C001", sha256="a" * 64),),
    travel_mm=(0.0, 10.0, 20.0),
    heat_kw=(1.0, -0.5, 0.25),
    deviation_kw=(0.1, 0.2, 0.1),
)


def test_text_reads_back(tmp_path):
    (tmp_path / "heat.yaml").write_text(PROFILE.text, encoding="utf-8")
    assert HeatProfile.from_file(tmp_path / "heat.yaml") == PROFILE


@pytest.mark.parametrize(
    "values",
    [
        {"heat_kw": (1.0, 2.0)},
        {"deviation_kw": (0.1, 0.1)},
        {"deviation_kw": (0.1, -0.1, 0.1)},
        {"travel_mm": (0.0, 10.0, 10.0)},
        {"welds": ()},
        {"welds": ({"weld": "C001", "sha256": "a"},)},
    ],
)
def test_contradictions_are_refused(values):
    with pytest.raises(InputError):
        PROFILE.changed(**values)
