"""The library's solver.

Optimal, within limits, and unshaken by whatever is wrong with a problem.
"""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fsw_control import Command, Measurement, Reference, weld
from fsw_model import STEP_S, ProcessModel, nominal
from fsw_nmpc.controller import NmpcController
from fsw_nmpc.library import KERNEL, SolveStatus, State
from fsw_nmpc.tuning import Tuning
from fsw_test_support.nmpc_ipopt import ReferenceSolver, cumulation, input_bounds, objective
from fsw_test_support.nmpc_problems import (
    LIMITS,
    make_library,
    predict,
    random_moves,
    random_problem,
    solve,
)

P = nominal()


def cold(library):
    return np.zeros(2 * library.horizon.n_blocks)


def cost_of(library, problem, moves):
    depth, temperature, _, _ = predict(library, KERNEL.ffi.addressof(problem, "start"), moves)
    return objective(problem, library.state.tuning, library.horizon, moves, depth, temperature)


@pytest.mark.slow
@pytest.mark.full
def test_converged_iterations_reach_the_oracle(library):
    """Real-time iterations repeated on one problem end where cold IPOPT on the whole NLP does."""
    rng = np.random.default_rng(3)
    oracle = ReferenceSolver(library, P)
    for _ in range(6 if library.horizon.n_blocks == 20 else 2):
        problem = random_problem(rng, library, P)
        status, best, depth, temperature = oracle.solve(problem, cold(library))
        assert status is SolveStatus.OK
        best_cost = objective(
            problem, library.state.tuning, library.horizon, best, depth, temperature
        )
        moves = cold(library)
        for _ in range(12):
            _, after, _, _ = solve(library, problem, moves)
            if np.abs(after - moves).max() < 1e-9:
                break
            moves = after
        assert cost_of(library, problem, moves) <= best_cost + 1e-6 * (1.0 + abs(best_cost))


def test_kkt_residuals(library, rng):
    for _ in range(40):
        problem = random_problem(rng, library, P)
        status, _, _, _ = solve(library, problem, cold(library))
        output = library.output
        loss = 1e-6 * (1.0 + abs(output.cost))
        assert status is SolveStatus.OK
        assert output.gap <= loss
        assert output.primal_residual <= 1e-7
        assert output.dual_residual <= max(1e-6, loss)


def test_no_feasible_point_is_better(library20, rng):
    """Optimality without duals.

    Random feasible changes never lower the cost of the problem with linear outputs.
    """
    h = library20.horizon
    largest = np.outer(h.block_reach, [LIMITS.force_step_kn, LIMITS.speed_step_rpm]).ravel()
    for _ in range(4):
        problem = random_problem(rng, library20, P)
        tuning = library20.state.tuning
        z0, t0, by_z, by_t = predict(
            library20, KERNEL.ffi.addressof(problem, "start"), cold(library20)
        )

        def cost(moves, problem=problem, tuning=tuning, at=(z0, t0), by=(by_z, by_t)):
            outputs = (at[i] + by[i] @ moves for i in range(2))
            return objective(problem, tuning, h, moves, *outputs)

        _, best, _, _ = solve(library20, problem, cold(library20))
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


@settings(
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(seed=st.integers(0, 2**32 - 1))
def test_limits_hold_always(library20, seed):
    """Whatever the problem and the start, also from inputs on their bounds."""
    rng = np.random.default_rng(seed)
    problem, h = random_problem(rng, library20, P), library20.horizon
    if rng.random() < 0.3:
        problem.start.force_kn, problem.start.speed_rpm = (
            rng.choice([60.0, 95.0]),
            rng.choice([300.0, 500.0]),
        )
    status, moves, _, _ = solve(library20, problem, random_moves(rng, h))
    assert status is SolveStatus.OK
    pairs = moves.reshape(-1, 2) / h.block_reach[:, None]
    assert np.abs(pairs[:, 0]).max() <= 1.0 + 1e-6 and np.abs(pairs[:, 1]).max() <= 3.0 + 3e-6
    reached = cumulation(h) @ moves
    low, high = input_bounds(problem, library20.state.tuning, h)
    assert (reached >= low - 1e-4).all() and (reached <= high + 1e-4).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("where", ["state", "history", "band", "start", "scale", "input"])
def test_bad_numbers_are_refused_and_the_next_solve_is_unaffected(library20, rng, bad, where):
    """No exception, no hang.

    The answer is refused, and the next good problem is solved as if nothing had been.
    """
    good = random_problem(rng, library20, P, Tuning())
    _, expected, _, _ = solve(library20, good, cold(library20))
    problem, moves = random_problem(rng, library20, P, Tuning()), cold(library20)
    if where == "state":
        problem.start.x[3] = bad
    elif where == "history":
        problem.start.history[5] = bad
    elif where == "band":
        problem.low[1][40] = problem.high[1][40] = bad
    elif where == "start":
        moves[3] = bad
    elif where == "scale":
        problem.start.x[State.SCALE] = bad
    else:
        problem.start.force_kn = bad
    status, _, _, _ = solve(library20, problem, moves)
    # a finite start is clipped to the limits, however far off it is
    assert status is not SolveStatus.OK or (where == "start" and np.isfinite(bad))
    status, again, _, _ = solve(library20, good, cold(library20))
    assert status is SolveStatus.OK
    assert again.tobytes() == expected.tobytes()


def test_start_far_from_the_solution_reaches_the_same_cost(library20, rng):
    """Starts far from the solution, even beyond the limits, end at a solution as good after some iterations."""
    for _ in range(20):
        problem = random_problem(rng, library20, P)
        moves = {"cold": cold(library20), "poisoned": 5.0 * random_moves(rng, library20.horizon)}
        for name in moves:
            for _ in range(8):
                status, moves[name], _, _ = solve(library20, problem, moves[name])
                assert status is SolveStatus.OK
        costs = [cost_of(library20, problem, m) for m in moves.values()]
        assert costs[1] == pytest.approx(costs[0], rel=1e-4, abs=1e-4)


def test_iterations_are_capped(rng):
    short = make_library(20, max_iterations=3)
    problem = random_problem(rng, short, P)
    status, _, _, _ = solve(short, problem, cold(short))
    assert status is SolveStatus.ITERATION_CAP
    assert short.output.iterations == 3


def test_memory_is_one_static_struct(library):
    assert KERNEL.ffi.sizeof("fsw_nmpc") < 512 * 1024


@pytest.mark.slow
@pytest.mark.full
def test_paper_cost_is_solved_at_every_tick_of_a_noisy_weld():
    """Dead-bands with L1 costs at rest leave pivots many decades apart."""
    controller, model, rng = (
        NmpcController({"preset": "paper"}),
        ProcessModel(P),
        np.random.default_rng(1),
    )
    rest = model.equilibrium()
    state, applied = rest.state.copy(), Command(rest.force_kn, rest.speed_rpm)
    controller.reset(applied)
    for k in range(2400):
        shown, noise = (
            model.outputs(state, applied.force_kn, applied.speed_rpm),
            rng.normal(size=3),
        )
        depth_mm = weld.DEPTH_MM + 0.2 * (200 <= k < 700)
        temperature_c = weld.TEMPERATURE_C + 10.0 * (1300 <= k < 1800)
        measurement = Measurement(
            STEP_S * k,
            shown.depth_mm + 2e-3 * noise[0],
            shown.motor_torque_nm + 2.0 * noise[1],
            shown.temperature_c + 0.1 * noise[2],
        )
        proposal = controller.step(
            measurement, Reference(depth_mm, temperature_c), applied, STEP_S
        )
        assert proposal.healthy
        applied = proposal.command
        model.step(state, applied.force_kn, applied.speed_rpm)
    assert controller.library.output.bad_cycles == 0
