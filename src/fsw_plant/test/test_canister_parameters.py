"""Parameters of the canister in files."""

from pathlib import Path

import pytest

from fsw_control.schema.models import InputError
from fsw_plant.canister import CanisterParameters


def test_the_shoulders_share_is_that_of_the_papers_torque() -> None:
    """(22) at the operating point."""
    p, radius_m = CanisterParameters(), 0.015 + 20.0 / 3.0 * 2.66e-3
    shoulder = 2.408 * (radius_m**3 - 0.015**3)
    assert p.shoulder_share == pytest.approx(shoulder / (shoulder + 2.3e-5), abs=0.005)


#: of values that are each in their range
CONTRADICTION = ("", "value_error")


@pytest.mark.parametrize(
    ("text", "problem", "fact"),
    [
        (
            "conductivity_w_per_m_k: 0.0",
            ("conductivity_w_per_m_k", "outside"),
            "1 to 2000 W/(m K)",
        ),
        ("heat_capacity_j_per_kg_k: -1.0", ("heat_capacity_j_per_kg_k", "outside"), "10 to 5000"),
        ("wall_mm: .nan", ("wall_mm", "outside"), ""),
        ("element_mm: 12.0", CONTRADICTION, "element_mm is"),
        ("modes: 40", CONTRADICTION, "modes are"),
        ("probe_length_mm: 60.0", CONTRADICTION, "probe_length_mm must"),
        ("shoulder_radius_mm: 10.0", CONTRADICTION, "shoulder_radius_mm must"),
        ("rim_mm: 80.0", CONTRADICTION, "lid_from_mm puts"),
        (
            "{rim_mm: 34.0, lid_mm: 0.0, lid_from_mm: 0.0, lowest_mm: 0.0}",
            CONTRADICTION,
            "rim_mm leaves",
        ),
        ("clamp_to_mm: 100.0", CONTRADICTION, "clamp_to_mm must"),
        ("wal_mm: 49.0", ("wal_mm", "extra_forbidden"), "wall_mm"),
        ("", None, "no parameters"),
        ("[1]", ("", "model_type"), ""),
    ],
)
def test_invalid_canister_is_rejected_in_one_line(
    text: str, problem: tuple[str, str] | None, fact: str
) -> None:
    with pytest.raises(InputError) as caught:
        CanisterParameters.from_yaml(text, "some.yaml")
    assert caught.value.problems == (() if problem is None else (problem,))
    assert fact in str(caught.value) and "\n" not in str(caught.value)


def test_yaml_overrides_defaults(tmp_path: Path) -> None:
    path = tmp_path / "canister.yaml"
    path.write_text("wall_mm: 51.0\nlid_mm: 45\n")
    p = CanisterParameters.from_file(path)
    assert (p.wall_mm, p.lid_mm, p.rim_mm) == (51.0, 45.0, CanisterParameters().rim_mm)
