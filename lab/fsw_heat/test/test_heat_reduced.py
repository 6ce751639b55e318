"""The reduced canister: heat, symmetry, motion, and input that makes no sense."""

from math import nan, pi

import numpy as np
import pytest

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

from fsw_control.schema.models import InputError
from fsw_heat import ReducedCanister, load_or_reduce
from fsw_plant.canister import CanisterParameters

pytestmark = pytest.mark.slow

SPEED = 86.0 / 60.0


@pytest.fixture(scope="module")
def canister() -> ReducedCanister:
    return load_or_reduce(CanisterParameters(properties="constant"))


def test_heat_in_is_heat_stored_and_lost(canister: ReducedCanister) -> None:
    """At all times of a weld with dwell, descent, changing power and a stop."""
    state, brought, lost = canister.initial(axial_mm=75.0), 0.0, 0.0
    before = canister.loss_w(state)
    for k in range(6000):
        power = 45.0 - 15.0 * (k % 700 > 350)
        speed = 0.0 if k < 300 or k > 5000 else SPEED
        state = canister.step(state, power, speed, max(0.0, 75.0 - 0.1 * max(0, k - 600)))
        brought += 1e2 * power * (1.0 - canister.parameters.tool_share)
        after = canister.loss_w(state)
        lost, before = lost + 0.05 * (before + after), after
        assert canister.stored_j(state) + lost == pytest.approx(brought, rel=1e-3)
    assert canister.stored_j(state) + lost == pytest.approx(brought, rel=1e-6)
    assert lost > 0.01 * brought


def test_uniform_canister_changes_only_by_its_losses(
    canister: ReducedCanister,
) -> None:
    state = canister.initial(300.0)
    r, angle, z = [500.0, 10.0, 525.0, 480.0], [0.0, 1.0, 3.0, -2.0], [0.0, 60.0, -1500.0, 135.0]
    assert canister.temperature_c(state, r, angle, z) == pytest.approx(np.full(4, 300.0), abs=1e-6)
    assert canister.stir_zone_temperature_c(state) == pytest.approx(300.0, abs=1e-6)
    p = canister.parameters
    area = pi * (2 * 0.525 * 2.135 + 0.525**2 + 2 * 0.475 * 0.05)
    expected = 280.0 * (p.surface_w_per_m2_k * area + p.clamp_w_per_m2_k * pi * 1.05 * 0.1)
    assert canister.loss_w(state) == pytest.approx(expected, rel=1e-3)


def test_canister_cools_to_ambient(canister: ReducedCanister) -> None:
    state = canister.initial()
    for _ in range(100):
        state = canister.step(state, 40.0, SPEED, 0.0, 1.0)
    last = canister.stored_j(state)
    for _ in range(200):
        state = canister.step(state, 0.0, 0.0, 0.0, 3600.0)
        assert 0.0 <= canister.stored_j(state) < last
        last = canister.stored_j(state)
    assert canister.stir_zone_temperature_c(state) == pytest.approx(20.0, abs=0.01)


def test_heat_is_symmetric_at_rest_and_trails_a_moving_tool(
    canister: ReducedCanister,
) -> None:
    still = canister.step(canister.initial(angle_rad=1.0), 40.0, 0.0, 0.0, 60.0)
    ahead, behind = canister.temperature_c(still, 525.0, [1.1, 0.9], 0.0)
    assert ahead == pytest.approx(behind, abs=1e-6)
    moving = canister.step(canister.initial(angle_rad=1.0), 40.0, 3.0, 0.0, 60.0)
    assert moving.angle_rad == pytest.approx(1.0 + 180.0 / 525.0)
    ahead, behind = canister.temperature_c(
        moving, 525.0, moving.angle_rad + np.array([0.1, -0.1]), 0.0
    )
    assert behind > ahead + 50.0


def test_the_start_angle_does_not_matter(canister: ReducedCanister) -> None:
    results = []
    for angle in (0.0, 2.0, 40.0 * pi):
        state = canister.initial(angle_rad=angle)
        for k in range(100):
            state = canister.step(state, 40.0 + k % 7, SPEED, 20.0)
        results.append(canister.stir_zone_temperature_c(state))
    assert results == pytest.approx([results[0]] * 3, abs=1e-6)


def test_long_step_equals_many_short_ones(canister: ReducedCanister) -> None:
    long = canister.step(canister.initial(), 40.0, SPEED, 0.0, 10.0)
    short = canister.initial()
    for _ in range(1000):
        short = canister.step(short, 40.0, SPEED, 0.0, 0.01)
    assert canister.stir_zone_temperature_c(long) == pytest.approx(
        canister.stir_zone_temperature_c(short), abs=1e-8
    )


def test_the_overlap_meets_its_own_heat(canister: ReducedCanister) -> None:
    """The same power gives more where the weld has been."""
    turn = 2.0 * pi * 525.0 / SPEED
    state, seen = canister.initial(), {}
    for k in range(int(turn + 100)):
        state = canister.step(state, 40.0, SPEED, 0.0, 1.0)
        seen[k] = canister.stir_zone_temperature_c(state)
    assert seen[int(turn) - 1] > seen[int(turn) - 400] + 3.0


@pytest.mark.parametrize(
    ("inputs", "text"),
    [
        ((nan, 1.0, 0.0, 0.1), "not finite"),
        ((40.0, nan, 0.0, 0.1), "not finite"),
        ((40.0, 1.0, 101.0, 0.1), "the copper"),
        ((40.0, 1.0, -31.0, 0.1), "the copper"),
        ((40.0, 1.0, 0.0, 0.0), "above 0"),
    ],
)
def test_step_refuses_invalid_arguments(
    canister: ReducedCanister, inputs: tuple[float, float, float, float], text: str
) -> None:
    state = canister.initial()
    with pytest.raises(InputError, match=text) as caught:
        canister.step(state, *inputs)
    assert "\n" not in str(caught.value)
    assert canister.stir_zone_temperature_c(state) == pytest.approx(20.0)


@pytest.mark.parametrize(
    "place", [(400.0, 0.0, -10.0), (526.0, 0.0, 0.0), (500.0, 0.0, 136.0), (nan, 0.0, 0.0)]
)
def test_a_thermocouple_outside_the_copper_is_refused(
    canister: ReducedCanister, place: tuple[float, ...]
) -> None:
    with pytest.raises(InputError, match="no copper"):
        canister.temperature_c(canister.initial(), *place)
