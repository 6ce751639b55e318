"""The problem in stages is the kernel's, and so acados and FATROP solve the same one."""

import numpy as np
import pytest

from fsw_model import nominal
from fsw_nmpc.horizon import horizon_of, make_horizon
from fsw_nmpc.library import KERNEL, SolveStatus
from fsw_nmpc.tuning import PAPER, Tuning
from fsw_test_support.nmpc_acados import Acados, AcadosSolver, install
from fsw_test_support.nmpc_fatrop import FatropSolver
from fsw_test_support.nmpc_ipopt import ReferenceSolver, objective
from fsw_test_support.nmpc_problems import (
    make_library,
    predict,
    random_moves,
    random_problem,
    solve,
)
from fsw_test_support.nmpc_stages import Stages

#: short, with blocks, a tail of longer intervals and more time than the dead time
SHORT = make_horizon(
    nominal(), (*np.arange(0.0, 4.05, 0.1), 5.0, 7.0), (1, 1, 8, 14, 16, 1, 1), long_moves=True
)


@pytest.mark.parametrize("dead_time_s", [2.8, 1.23])
def test_stages_give_the_outputs_and_the_cost_of_the_kernel(dead_time_s):
    parameters, rng = (
        nominal().model_copy(update={"dead_time_s": dead_time_s}),
        np.random.default_rng(1),
    )
    library = make_library(20, parameters, horizon=horizon_of(parameters, 20))
    stages = Stages(library, parameters)
    for _ in range(3):
        problem = random_problem(rng, library, parameters, Tuning())
        moves = random_moves(rng, library.horizon)
        start, shown, cost = problem.start, np.full((2, library.horizon.n_out), np.nan), 0.0
        expected = predict(library, KERNEL.ffi.addressof(problem, "start"), moves)[:2]
        data, inputs = stages.data(problem), stages.inputs(moves)
        states = stages.rolled_out(stages.start(problem), inputs, data)
        for stage, x, u, numbers in zip(stages.stages, states, inputs, data, strict=False):
            y = stage.outputs(x, u, numbers.parameter).full().ravel()
            shown[0, stage.depth_points], shown[1, stage.tool_points] = np.split(
                y, [len(stage.depth_points)]
            )
            cost += (
                0.5 * numbers.weight @ (y - numbers.goal) ** 2 + 0.5 * numbers.move_weight @ u**2
            )
        drift = np.array([list(start.drift[q][0 : library.horizon.n_out]) for q in (0, 1)])
        off = [[start.x[8]], [start.x[9] + parameters.operating_temperature_c]]
        seen = np.isfinite(shown)
        assert seen[0].all() and seen[1].sum() == (library.horizon.temperature_width > 0).sum()
        np.testing.assert_allclose(
            (shown + drift + off)[seen], np.array(expected)[seen], rtol=1e-12
        )
        assert cost == pytest.approx(
            objective(problem, library.state.tuning, library.horizon, moves, *expected), rel=1e-12
        )


@pytest.mark.slow
def test_acados_finds_the_plan_of_the_kernel():
    folder = install()
    if isinstance(folder, str):
        pytest.skip(folder)
    library, rng = make_library(horizon=SHORT), np.random.default_rng(2)
    acados = Acados(folder)
    compiled = acados.compiled(Stages(library, nominal()), optimisation="-O0")
    solver = AcadosSolver(acados, compiled, library, nominal())
    for _ in range(10):
        problem = random_problem(rng, library, nominal(), Tuning())
        start = np.zeros(2 * SHORT.n_blocks)
        own, other = solve(library, problem, start), solver.solve(problem, start)
        assert own[0] is other[0] is SolveStatus.OK
        at = KERNEL.ffi.addressof(problem, "start")
        costs = [
            objective(
                problem, library.state.tuning, SHORT, moves, *predict(library, at, moves)[:2]
            )
            for _, moves, _, _ in (own, other)
        ]
        assert costs[0] == pytest.approx(costs[1], rel=1e-4)
        np.testing.assert_allclose(own[2], other[2], atol=1e-4)
        np.testing.assert_allclose(own[3], other[3], atol=1e-2)


@pytest.mark.slow
def test_fatrop_finds_the_optimum_of_ipopt():
    library, rng = make_library(horizon=SHORT, tuning=PAPER), np.random.default_rng(3)
    fatrop, ipopt = FatropSolver(library, nominal()), ReferenceSolver(library, nominal())
    for _ in range(3):
        problem = random_problem(rng, library, nominal(), PAPER)
        answers = [
            solver.solve(problem, np.zeros(2 * SHORT.n_blocks)) for solver in (fatrop, ipopt)
        ]
        assert [status for status, *_ in answers] == [SolveStatus.OK] * 2
        assert fatrop.cost == pytest.approx(ipopt.cost, rel=1e-3)
