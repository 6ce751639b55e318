"""Solvers against each other, against the oracle, and against everything that can be wrong with a problem."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fsw_control import Command, Limits
from fsw_model import nominal
from fsw_nmpc.acceptance import MovePlan
from fsw_nmpc.cases import random_moves, random_problem
from fsw_nmpc.horizon import horizon_of
from fsw_nmpc.solvers.casadi_qp import CasadiSolver
from fsw_nmpc.solvers.constraints import cumulation, input_bounds, move_bounds
from fsw_nmpc.solvers.interior_point import QuadraticProgram
from fsw_nmpc.solvers.reference import ReferenceSolver
from fsw_nmpc.solvers.rti import RtiSolver

P = nominal()


@pytest.fixture(scope="module")
def pair(library):
    """Kernel and fallback on the same 20 blocks."""
    h = horizon_of(P, 20)
    return RtiSolver(P, h, library, max_iterations=100), CasadiSolver(P, h, max_iterations=100)


def test_fallback_gives_the_kernels_answers(pair, rng):
    kernel, fallback = pair
    for _ in range(60):
        problem = random_problem(rng, kernel.horizon, P)
        one, other = kernel.solve(problem, np.zeros(40)), fallback.solve(problem, np.zeros(40))
        assert one.solved and other.solved
        assert one.cost == pytest.approx(other.cost, rel=1e-6, abs=1e-6)
        assert one.depth_mm == pytest.approx(other.depth_mm, abs=1e-4)


def test_both_agree_on_the_moves_where_they_are_unique(pair, rng):
    """With a quadratic weight on the moves the solution is unique: the same to 1e-6."""
    kernel, fallback = pair
    for _ in range(20):
        problem = random_problem(rng, kernel.horizon, P)
        problem.weights.move_square = (1.0, 0.1)
        one, other = kernel.solve(problem, np.zeros(40)), fallback.solve(problem, np.zeros(40))
        assert one.moves == pytest.approx(other.moves, abs=1e-6)


def converged(solver, problem):
    moves = np.zeros(2 * solver.horizon.n_blocks)
    for _ in range(12):
        solution = solver.solve(problem, moves)
        if np.abs(solution.moves - moves).max() < 1e-9:
            break
        moves = solution.moves
    depth, temperature, _, _ = solver.kernel.predict(solver.call(problem), moves)
    return problem.objective(solver.horizon, moves, depth, temperature)


def test_converged_iterations_reach_the_oracle(rti):
    """Real-time iterations repeated on one problem end where cold IPOPT on the whole NLP does."""
    rng = np.random.default_rng(3)
    oracle = ReferenceSolver(P, rti.horizon)
    for _ in range(6):
        problem = random_problem(rng, rti.horizon, P)
        best = oracle.solve(problem, np.zeros(2 * rti.horizon.n_blocks))
        assert best.solved
        found = problem.objective(rti.horizon, best.moves, best.depth_mm, best.temperature_c)
        assert converged(rti, problem) <= found + 1e-6 * (1.0 + abs(found))


def test_kkt_residuals(rti, rng):
    for _ in range(40):
        problem = random_problem(rng, rti.horizon, P)
        solution = rti.solve(problem, np.zeros(2 * rti.horizon.n_blocks))
        result, loss = rti.kernel.result, 1e-6 * (1.0 + abs(solution.cost))
        assert solution.solved
        assert result.gap <= loss
        assert result.primal_residual <= 1e-7
        assert result.dual_residual <= max(1e-6, loss)


def test_no_feasible_point_is_better(pair, rng):
    """Optimality without duals: random feasible changes of the solution never lower the cost of the QP."""
    kernel, fallback = pair
    problem = random_problem(rng, kernel.horizon, P)
    outputs, slopes = fallback.linearise(problem, np.zeros(40))
    qp: QuadraticProgram = fallback.program(problem, outputs, slopes)
    largest = move_bounds(problem, kernel.horizon)
    z = kernel.solve(problem, np.zeros(40)).moves / largest
    best = qp.cost(z)
    low, high = input_bounds(problem, kernel.horizon)
    for _ in range(300):
        trial = np.clip(z + rng.normal(0.0, 10.0 ** rng.uniform(-5, 0), 40), -1.0, 1.0)
        reached = cumulation(kernel.horizon) @ (trial * largest)
        if (reached >= low).all() and (reached <= high).all():
            assert qp.cost(trial) >= best - 2e-6 * (1.0 + abs(best))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_limits_hold_always(pair, seed):
    """Whatever the problem and the start: a solution that counts as solved keeps every limit."""
    rng = np.random.default_rng(seed)
    kernel, _ = pair
    problem = random_problem(rng, kernel.horizon, P)
    edge = rng.random()
    if edge < 0.2:
        problem.applied = Command(float(rng.choice([60.0, 95.0])), float(rng.choice([300.0, 500.0])))
    elif edge < 0.4:
        problem.applied = Command(float(rng.choice([58.5, 96.5])), float(rng.choice([290.0, 510.0])))
    solution = kernel.solve(problem, random_moves(rng, kernel.horizon, Limits()))
    if solution.solved:
        assert MovePlan(kernel.horizon).refusal(solution, problem) == ""


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("where", ["state", "history", "band", "start", "scale", "input"])
def test_bad_numbers_give_a_status(pair, rng, bad, where):
    """Neither solver raises or hangs; and the next good problem is solved as if nothing had been."""
    for solver in pair:
        good = random_problem(rng, solver.horizon, P)
        expected = solver.solve(good, np.zeros(40))
        problem = random_problem(rng, solver.horizon, P)
        moves = np.zeros(40)
        if where == "state":
            problem.estimate.x[4] = bad
        elif where == "history":
            problem.estimate.history_kw[5] = bad
        elif where == "band":
            problem.temperature_low_c[40] = problem.temperature_high_c[40] = bad
        elif where == "start":
            moves[3] = bad
        elif where == "scale":
            problem.estimate.torque_scale = bad
        else:
            problem.applied = Command(bad, 400.0)
        solution = solver.solve(problem, moves)
        assert not solution.solved or MovePlan(solver.horizon).refusal(solution, problem) == "" or np.isfinite(bad)
        again = solver.solve(good, np.zeros(40))
        assert again.solved
        assert again.moves.tobytes() == expected.moves.tobytes()


def test_a_poisoned_start_costs_no_quality(pair, rng):
    """Starts far from the solution, even beyond the limits, end at a solution as good after a second iteration."""
    kernel, _ = pair
    for _ in range(20):
        problem = random_problem(rng, kernel.horizon, P)
        problem.weights.move_square = (1.0, 0.1)
        cold = kernel.solve(kernel_problem := problem, kernel.solve(problem, np.zeros(40)).moves)
        poisoned = kernel.solve(problem, 5.0 * random_moves(rng, kernel.horizon, Limits()))
        if not poisoned.solved:
            continue
        for _ in range(6):
            poisoned, cold = kernel.solve(problem, poisoned.moves), kernel.solve(kernel_problem, cold.moves)
        assert poisoned.cost == pytest.approx(cold.cost, rel=1e-4, abs=1e-4)


def test_iterations_are_capped(library, rng):
    h = horizon_of(P, 20)
    short = RtiSolver(P, h, library, max_iterations=3)
    solution = short.solve(random_problem(rng, h, P), np.zeros(40))
    assert solution.status == "iteration cap"
    assert solution.iterations == 3


def test_workspace_is_static_and_small(rti):
    assert rti.kernel.workspace_bytes < 512 * 1024
