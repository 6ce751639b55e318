"""Parameters in files and properties of copper."""

from pathlib import Path

import numpy as np
import pytest

from fsw_canister import CanisterParameters
from fsw_canister.copper import DENSITY_KG_PER_M3, Kirchhoff, conductivity, heat_capacity
from fsw_schema.models import InputError


def test_defaults_are_those_of_the_table() -> None:
    p = CanisterParameters()
    assert p.conductivity_w_per_m_k == pytest.approx(float(conductivity(p.reference_c)), rel=2e-3)
    assert p.heat_capacity_j_per_kg_k == pytest.approx(
        float(heat_capacity(p.reference_c)), rel=2e-3
    )
    assert p.density_kg_per_m3 == DENSITY_KG_PER_M3
    assert conductivity([26.85, 726.85]) == pytest.approx([401.0, 352.0])
    assert heat_capacity([26.85, 926.85]) == pytest.approx([385.0, 480.0])


def test_the_shoulders_share_is_that_of_the_papers_torque() -> None:
    """(22) at the operating point."""
    p, radius_m = CanisterParameters(), 0.015 + 20.0 / 3.0 * 2.66e-3
    shoulder = 2.408 * (radius_m**3 - 0.015**3)
    assert p.shoulder_share == pytest.approx(shoulder / (shoulder + 2.3e-5), abs=0.005)


def test_kirchhoffs_transform_is_the_integral_of_k_and_inverts() -> None:
    kirchhoff = Kirchhoff(CanisterParameters())
    temperatures = np.array([20.0, 300.0, 816.4])
    assert kirchhoff.temperature_c(kirchhoff.theta(temperatures)) == pytest.approx(
        temperatures, abs=1e-6
    )
    grid = np.linspace(20.0, 816.4, 20001)
    values = conductivity(grid) / conductivity(275.0)
    assert float(kirchhoff.theta(816.4)) == pytest.approx(
        0.5 * (values[1:] + values[:-1]) @ np.diff(grid), rel=1e-5
    )
    constant = Kirchhoff(CanisterParameters(properties="constant"))
    assert float(constant.theta(816.4)) == pytest.approx(796.4)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("conductivity_w_per_m_k: 0.0", "conductivity_w_per_m_k = 0 is outside 1 to 2000"),
        ("heat_capacity_j_per_kg_k: -1.0", "heat_capacity_j_per_kg_k = -1 is outside"),
        ("wall_mm: .nan", "wall_mm"),
        ("element_mm: 12.0", "element_mm is too coarse for the probe: at most 7.5 mm"),
        ("modes: 40", "modes are too few for the probe: at least 88"),
        ("probe_length_mm: 60.0", "probe_length_mm must be at most wall_mm"),
        ("shoulder_radius_mm: 10.0", "shoulder_radius_mm must be more than probe_radius_mm"),
        ("rim_mm: 80.0", "lid_from_mm puts the lid's plate outside"),
        (
            "{rim_mm: 34.0, lid_mm: 0.0, lid_from_mm: 0.0, lowest_mm: 0.0}",
            "rim_mm leaves the tool no place",
        ),
        ("clamp_to_mm: 100.0", "clamp_to_mm must be more than clamp_from_mm"),
        ("wal_mm: 49.0", "wal_mm is an unknown key; did you mean wall_mm"),
        ("", "holds no parameters"),
        ("[1]", "not a mapping"),
    ],
)
def test_what_is_no_canister_is_refused_in_one_line(text: str, complaint: str) -> None:
    with pytest.raises(InputError) as caught:
        CanisterParameters.from_yaml(text, "some.yaml")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_yaml_gives_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "canister.yaml"
    path.write_text("wall_mm: 51.0\nlid_mm: 45\n")
    p = CanisterParameters.from_file(path)
    assert (p.wall_mm, p.lid_mm, p.rim_mm) == (51.0, 45.0, CanisterParameters().rim_mm)
