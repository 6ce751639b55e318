"""The compact canister in the tool's frame.

Beside the reduced one, at every speed, and from the cache.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

from fsw_control.schema.models import InputError
from fsw_heat import load_or_compact, load_or_reduce
from fsw_heat.heat_model import CompactCanister
from fsw_plant.canister import CanisterParameters

pytestmark = pytest.mark.slow

SPEED = 86.0 / 60.0
OTHER = {
    "conductivity_w_per_m_k": 340.0,
    "heat_capacity_j_per_kg_k": 445.0,
    "emissivity": 0.6,
    "clamp_w_per_m2_k": 1500.0,
    "shoulder_share": 0.2,
    "tool_share": 0.1,
    "ambient_c": 5.0,
}


@pytest.fixture(scope="module")
def canister() -> CompactCanister:
    return load_or_compact(CanisterParameters(properties="constant"))


def weld(second: float) -> tuple[float, float, float]:
    """Power kW, traverse mm/s and position mm: dwell, descent, a stop, another speed, the way up.

    Power changes.
    """
    speed = (
        0.0
        if second < 100.0 or 700.0 < second < 760.0
        else 0.5 * SPEED
        if second > 1000.0
        else SPEED
    )
    height = float(np.interp(second, [160.0, 240.0, 1100.0, 1180.0], [75.0, 0.0, 0.0, 90.0]))
    return 44.0 + 5.0 * np.sign(np.sin(0.05 * second)), speed, height


@pytest.mark.parametrize("values", [{}, OTHER])
def test_compact_canister_follows_the_reduced_one(values: dict[str, float]) -> None:
    """Also with copper, losses and shares that its vectors were not chosen for."""
    parameters = CanisterParameters(**values)
    compact, reduced = load_or_compact(parameters), load_or_reduce(parameters)
    assert compact.states < 120 < 10 * compact.states < reduced.states
    small, large = compact.initial(axial_mm=75.0), reduced.initial(axial_mm=75.0)
    apart = []
    for k in range(1300):
        small, large = compact.step(small, *weld(k), 1.0), reduced.step(large, *weld(k), 1.0)
        apart.append(
            compact.stir_zone_temperature_c(small) - reduced.stir_zone_temperature_c(large)
        )
    assert reduced.stir_zone_temperature_c(large) > 600.0
    assert np.abs(apart).max() < 0.4


@pytest.mark.parametrize("speed", [0.0, -SPEED, 20.0])
@pytest.mark.parametrize("dt_s", [0.1, 30.0])
def test_a_transition_is_the_exponential_of_the_equations(
    canister: CompactCanister, speed: float, dt_s: float
) -> None:
    even, n = len(canister.tables["transport"]), canister.states
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n] = np.hstack([-canister.tables["decay"], np.eye(n)])
    turning = speed / canister.parameters.outer_radius_mm * canister.tables["transport"]
    matrix[:even, even:n] -= turning
    matrix[even:n, :even] += turning.T
    exact = scipy.linalg.expm(dt_s * matrix)[:n]
    kept, response = canister.over(speed, dt_s)
    np.testing.assert_allclose(kept.T, exact[:, :n], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(response.T, exact[:, n : n + even], rtol=0.0, atol=1e-11 * dt_s)


@pytest.mark.parametrize("speed", [0.0, 0.3, -SPEED, 20.0, 500.0])
def test_canister_loses_heat_at_every_speed(canister: CompactCanister, speed: float) -> None:
    """Decay is symmetric and transport skew, so no state grows over a step."""
    kept, _ = canister.over(speed, 0.1)
    assert np.linalg.norm(kept, 2) < 1.0


def test_travel_backwards_heats_the_same(canister: CompactCanister) -> None:
    both = []
    for speed in (SPEED, -SPEED):
        state = canister.initial()
        for _ in range(100):
            state = canister.step(state, 40.0, speed, 0.0, 1.0)
        both.append(canister.stir_zone_temperature_c(state))
    assert both[0] == pytest.approx(both[1], abs=1e-8)


def test_long_step_equals_many_short_ones(canister: CompactCanister) -> None:
    long = canister.step(canister.initial(), 40.0, SPEED, 0.0, 10.0)
    short = canister.initial()
    for _ in range(1000):
        short = canister.step(short, 40.0, SPEED, 0.0, 0.01)
    assert canister.stir_zone_temperature_c(long) == pytest.approx(
        canister.stir_zone_temperature_c(short), abs=1e-8
    )


@pytest.mark.parametrize(
    ("inputs", "text"),
    [((float("nan"), 1.0, 0.0), "not finite"), ((40.0, 1.0, 101.0), "the copper")],
)
def test_step_refuses_invalid_arguments(
    canister: CompactCanister, inputs: tuple[float, float, float], text: str
) -> None:
    with pytest.raises(InputError, match=text):
        canister.step(canister.initial(), *inputs)


def test_a_given_file_is_of_this_kind_and_geometry(tmp_path: Path) -> None:
    tiny = CanisterParameters(
        outer_radius_mm=60.0, wall_mm=20.0, rim_mm=40.0, lid_mm=0.0, lid_from_mm=0.0, tube_mm=100.0, lowest_mm=-10.0,
        probe_radius_mm=8.0, probe_length_mm=20.0, shoulder_radius_mm=12.0, clamp_from_mm=60.0, clamp_to_mm=80.0,
        element_mm=4.0, modes=20,
    )  # fmt: skip
    load_or_compact(tiny, tmp_path)
    kinds = sorted(path.name.partition("-")[0] for path in tmp_path.iterdir())
    assert kinds == ["canister", "compact"]
    file = next(tmp_path.glob("compact-*"))
    assert load_or_compact(tiny.changed(conductivity_w_per_m_k=300.0), file).states > 0
    with pytest.raises(InputError, match=r"\(wall_mm 20\.0, not 20\.5\)"):
        load_or_compact(tiny.changed(wall_mm=20.5), file)
    with pytest.raises(InputError, match="no reduced"):
        load_or_reduce(tiny, file)
