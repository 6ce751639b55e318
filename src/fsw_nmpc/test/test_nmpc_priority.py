"""Which output gives way on the way to a set-point, and the quality limits that neither leaves for the other."""

import numpy as np
import pytest

from fsw_control import Reference
from fsw_model import ProcessModel, nominal
from fsw_nmpc import NmpcController
from fsw_nmpc.library import KERNEL, SolveStatus, tuning_of
from fsw_nmpc.settings import Settings
from fsw_nmpc.tuning import ADAPTIVE, PAPER, PRIORITIES, Tuning
from fsw_test_support.nmpc_ipopt import cumulation, input_bounds, objective, squares
from fsw_test_support.nmpc_loop import Loop
from fsw_test_support.nmpc_problems import LIMITS, predict, random_problem, solve

P = nominal()
NEAR_HUBER, NEAR_LIMIT = 0.5, 0.1  # as in rows.c
WEAK = P.scaled(sticking_stress_pa=0.85, sliding_friction=0.85)  # the speed is near its bound


def huber_of(tuning):
    """Huber thresholds of both outputs, by who gives way."""
    depth, balance = (tuning.priority == PRIORITIES.index(name) for name in ("depth", "balance"))
    depth_mm = 0.0 if depth or balance else tuning.huber_depth_mm
    return depth_mm, tuning.huber_temperature_c * (1.0 if depth else 2.0 if balance else 0.0)


def yielding(problem, tuning, horizon, at, outputs):
    """Cost of outputs beyond :func:`objective`: linear beyond a Huber threshold; quality limits at block ends.

    As in the library, a side is in use only where the outputs ``at``, without moves, come near it.
    """
    total, block_ends = 0.0, np.append(np.diff(horizon.interval_block) > 0, True)
    for q, output in enumerate(outputs):
        low, high = (
            np.array(list(problem.low[q][0 : horizon.n_out])),
            np.array(list(problem.high[q][0 : horizon.n_out])),
        )
        used = (horizon.depth_width, horizon.temperature_width)[q] > 0
        if (huber := huber_of(tuning)[q]) > 0.0:
            beyond = np.maximum(np.abs(output - low) - huber, 0.0)
            bent = used & (np.abs(at[q] - low) > NEAR_HUBER * huber)
            total -= float((0.5 * squares(problem, tuning)[q] * beyond**2)[bent].sum())
        least, most = problem.window_low[q], problem.window_high[q]
        near = NEAR_LIMIT * (most - least)
        limited = used & block_ends & ((at[q] > most - near) | (at[q] < least + near))
        if q == 0:
            limited &= (low <= most) & (high >= least)
        outside = np.maximum(output - np.maximum(most, high), 0.0) + np.maximum(
            np.minimum(least, low) - output, 0.0
        )
        total += float(
            ((tuning.quality_weight_per_mm, tuning.quality_weight_per_c)[q] * outside)[
                limited
            ].sum()
        )
    return total


@pytest.mark.parametrize("priority", PRIORITIES)
def test_no_feasible_point_is_better(library20, rng, priority):
    """Of the problem with linear outputs, linear costs beyond thresholds and quality limits in it."""
    h = library20.horizon
    largest = np.outer(h.block_reach, [LIMITS.force_step_kn, LIMITS.speed_step_rpm]).ravel()
    active = 0
    for _ in range(6):
        problem = random_problem(rng, library20, P, ADAPTIVE)
        library20.configure(tuning_of(Settings(P, ADAPTIVE, LIMITS, priority, max_iterations=100)))
        tuning, goal = library20.state.tuning, problem.low[0][h.n_out - 1]
        problem.window_low, problem.window_high = (goal - 0.1, 790.0), (goal + 0.1, 910.0)
        still = np.zeros(2 * h.n_blocks)
        z0, t0, by_z, by_t = predict(library20, KERNEL.ffi.addressof(problem, "start"), still)

        def cost(moves, problem=problem, tuning=tuning, at=(z0, t0), by=(by_z, by_t)):
            outputs = [at[i] + by[i] @ moves for i in range(2)]
            return objective(problem, tuning, h, moves, *outputs) + yielding(
                problem, tuning, h, at, outputs
            )

        status, best, _, _ = solve(library20, problem, still)
        told = library20.output
        assert status is SolveStatus.OK
        assert told.cost == pytest.approx(cost(best), rel=1e-6, abs=1e-5)
        active += (
            abs(yielding(problem, tuning, h, (z0, t0), [z0 + by_z @ best, t0 + by_t @ best])) > 1.0
        )
        low, high = input_bounds(problem, tuning, h)
        for _ in range(200):
            trial = (
                np.clip(
                    best / largest + rng.normal(0.0, 10.0 ** rng.uniform(-5, 0), 40), -1.0, 1.0
                )
                * largest
            )
            reached = cumulation(h) @ trial
            if (reached >= low).all() and (reached <= high).all():
                assert cost(trial) >= cost(best) - 2e-6 * (1.0 + abs(cost(best)))
    assert active >= 3


def errors(tuning_file="", preset="adaptive", priority="depth", parameters=WEAK, seconds=40):
    """IAE of depth and temperature, and their largest errors, 0.2 mm down from rest, without noise."""
    loop = Loop(NmpcController({"preset": preset, "priority": priority}), ProcessModel(parameters))
    off = []
    for k in range(10 * (seconds + 5)):
        target = Reference(2.66, 816.4) if k < 50 else Reference(2.46, 816.4)
        loop.step(target)
        shown = loop.shown
        if k >= 50:
            off.append(
                (shown.depth_mm - target.depth_mm, shown.temperature_c - target.temperature_c)
            )
    size = np.abs(off)
    return (*(0.1 * size.sum(axis=0)), *size.max(axis=0))


@pytest.mark.slow
def test_the_priority_acts_on_the_way():
    """Torque x 0.85: less force needs more speed than there is. The tight PI's IAE of the depth is 0.78 mm s."""
    depth, temperature = {}, {}
    for priority in PRIORITIES:
        depth[priority], temperature[priority], _, peak_c = errors(priority=priority)
        assert peak_c < 816.4 - 790.0
    waits, stays, _, _ = errors(preset="default")
    assert (
        depth["depth"]
        < 1.0
        < depth["balance"]
        < depth["temperature"]
        == pytest.approx(waits, rel=0.1)
    )
    assert temperature["depth"] > temperature["balance"] > temperature["temperature"]
    assert stays < temperature["temperature"] < 0.1 * temperature["depth"]


@pytest.mark.slow
def test_where_the_speed_suffices_nothing_gives_way():
    """On the nominal process the depth is a little faster, and the temperature off by a little more."""
    depth, temperature, _, peak_c = errors(parameters=P)
    waits, stays, _, peak = errors(parameters=P, preset="default")
    assert 0.8 * waits < depth < 0.95 * waits
    assert peak_c < peak + 3.0 and temperature < stays + 12.0


@pytest.mark.slow
def test_the_temperature_is_let_go_no_further_than_its_quality_limit():
    """With a limit 4 degC below the set-point the depth takes longer."""
    free, _, _, peak = errors()
    tuning = ADAPTIVE.changed(quality_temperature_min_c=812.4)
    loop_values = errors_with(tuning)
    assert peak > 6.0 > 5.0 > loop_values[3]
    assert loop_values[0] > free


def errors_with(tuning):
    """As :func:`errors`, with a tuning."""
    original = Tuning.preset
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Tuning, "preset", classmethod(lambda cls, name, p: tuning))
        found = errors()
    assert Tuning.preset == original
    return found


@pytest.mark.parametrize(
    "changes",
    [
        {"huber_temperature_c": 0.5, "weight_temperature_per_c": 1.0},
        {"huber_depth_mm": 0.005, "depth_scale_mm": 0.0},
        {"huber_temperature_c": 0.5, "temperature_scale_c": 0.0},
    ],
)
def test_what_contradicts_itself_is_refused(changes):
    with pytest.raises(ValueError, match="huber_"):
        Tuning().changed(**changes)
    with pytest.raises(ValueError, match="huber_"):
        PAPER.changed(huber_depth_mm=0.1)
