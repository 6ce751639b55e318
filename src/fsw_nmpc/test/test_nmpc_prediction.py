"""The prediction of the kernel: the same process as the model, exact dead time, exact sensitivities."""

import numpy as np
import pytest

from fsw_control import Command, Limits
from fsw_model import ProcessModel, nominal
from fsw_nmpc import kernel_codegen
from fsw_nmpc.cases import random_moves, random_problem
from fsw_nmpc.horizon import horizon_of, make_horizon, paper_grid
from fsw_nmpc.ocp import Estimate, Problem, Weights
from fsw_nmpc.prediction import prediction_function
from fsw_nmpc.solvers.constraints import start_vector
from fsw_nmpc.tuning import Tuning

P = nominal()


def at(state, applied, horizon):
    """A problem that starts from a process state."""
    ends = np.array(state.power_kw)[:, [0, 2]]  # the model also knows the middle of each step
    estimate = Estimate(x=np.array(state.x), history_kw=ends.ravel())
    nothing, weights = np.zeros(horizon.n_out), Weights.from_tuning(Tuning(), horizon, Limits())
    return Problem(estimate, applied, Limits(), nothing, nothing, nothing, nothing, weights)


def test_prediction_is_the_process(rti, rng):
    """From a moving state, with random moves: as the process model steps it."""
    model, h = ProcessModel(P), rti.horizon
    state, u = model.equilibrium().state.copy(), Command(78.4, 407.576)
    for _ in range(60):
        u = Command(u.force_kn + rng.uniform(-0.5, 0.5), u.speed_rpm + rng.uniform(-2, 2))
        model.step(state, u.force_kn, u.speed_rpm)
    moves = random_moves(rng, h, Limits())
    depth, temperature, _, _ = rti.kernel.predict(rti.call(at(state, u, h)), moves)
    pairs = moves.reshape(-1, 2)[h.interval_block]
    for k in range(50):
        u = Command(u.force_kn + pairs[k, 0], u.speed_rpm + pairs[k, 1])
        model.step(state, u.force_kn, u.speed_rpm)
        shown = model.outputs(state, u.force_kn, u.speed_rpm)
        assert depth[k] == pytest.approx(shown.depth_mm, abs=1e-7)
        assert temperature[k] == pytest.approx(shown.temperature_c, abs=1e-5)


def test_dead_time_is_exact(rti, rng):
    """No move acts on the temperature before 2.8 s; each power of the history arrives when its time has come."""
    h = rti.horizon
    problem = random_problem(rng, h, P)
    call = rti.call(problem)
    _, temperature, _, by_temperature = rti.kernel.predict(call, np.zeros(2 * h.n_blocks))
    early = h.time_s < 2.8 + 1e-9
    assert not by_temperature[early].any()
    assert by_temperature[~early].any(axis=1).all()
    for tick in (0, 13, 27):
        problem.estimate.history_kw[2 * tick : 2 * tick + 2] += 10.0
        _, changed, _, _ = rti.kernel.predict(rti.call(problem), np.zeros(2 * h.n_blocks))
        problem.estimate.history_kw[2 * tick : 2 * tick + 2] -= 10.0
        first = int(np.nonzero(np.abs(changed - temperature) > 1e-12)[0][0])
        assert h.time_s[first] == pytest.approx(0.1 * (tick + 1))


def test_long_steps_of_the_tail_see_every_short_one(library):
    """With steps of 0.1 s throughout, the paper's grid gives nearly the same outputs: the tail is no approximation."""
    from fsw_nmpc.solvers.rti import RtiSolver

    coarse = RtiSolver(P, horizon_of(P, 54), library)
    fine_grid = (*paper_grid()[:51], 5.5, 6.0)
    fine = RtiSolver(P, make_horizon(P, fine_grid, (1,) * 52, longest_step_s=0.1), library)
    rng = np.random.default_rng(0)
    problem = random_problem(rng, coarse.horizon, P, Tuning())
    moves = np.zeros(108)
    moves[:40] = random_moves(rng, coarse.horizon, Limits())[:40]
    z, t, _, _ = coarse.kernel.predict(coarse.call(problem), moves)
    problem.depth_low_mm = problem.depth_high_mm = problem.temperature_low_c = problem.temperature_high_c = np.zeros(52)
    problem.weights = Weights.from_tuning(Tuning(), fine.horizon, Limits())
    z_fine, t_fine, _, _ = fine.kernel.predict(fine.call(problem), moves[:104])
    assert np.abs(z[:50] - z_fine[:50]).max() < 1e-9
    assert np.abs(t[:50] - t_fine[:50]).max() < 1e-8


def test_sensitivities_are_exact(rti, rng):
    h = rti.horizon
    for _ in range(3):
        problem, moves = random_problem(rng, h, P), 0.3 * random_moves(rng, h, Limits())
        call = rti.call(problem)
        _, _, by_depth, by_temperature = rti.kernel.predict(call, moves)
        for j in rng.choice(2 * h.n_blocks, 8, replace=False):
            step = np.zeros(2 * h.n_blocks)
            step[j] = 1e-3
            above, below = rti.kernel.predict(call, moves + step), rti.kernel.predict(call, moves - step)
            assert by_depth[:, j] == pytest.approx((above[0] - below[0]) / 2e-3, rel=1e-5, abs=1e-7)
            assert by_temperature[:, j] == pytest.approx((above[1] - below[1]) / 2e-3, rel=1e-5, abs=1e-6)


def test_kernel_and_casadi_predict_the_same(rti, rng):
    h = rti.horizon
    predict = prediction_function(P, h)
    for _ in range(5):
        problem, moves = random_problem(rng, h, P), 0.3 * random_moves(rng, h, Limits())
        depth, temperature, _, _ = rti.kernel.predict(rti.call(problem), moves)
        other = predict(moves, start_vector(problem), problem.estimate.history_kw)
        assert depth == pytest.approx(other[0].full().ravel(), abs=1e-10)
        assert temperature == pytest.approx(other[1].full().ravel(), abs=1e-8)


def test_generated_torque_is_up_to_date():
    """The C file is what the equations give now (the first lines name CasADi's version)."""

    def body(text):
        return text[text.index("/* How to") :].split("torque_casadi_version")[0], text[text.index("casadi_s0[3]") :]

    assert body(kernel_codegen.SOURCE.read_text(encoding="utf-8")) == body(kernel_codegen.generate())


def test_generated_torque_is_the_symbolic_one(library, rng):
    import ctypes

    evaluate = ctypes.CDLL(str(library)).fsw_torque_casadi
    symbolic = kernel_codegen.torque_function()
    parameters = np.array([getattr(P, name) for name in kernel_codegen.TORQUE_PARAMETERS])
    double_p = ctypes.POINTER(ctypes.c_double)
    for _ in range(50):
        inputs = [np.array([rng.uniform(50, 100)]), np.array([rng.uniform(1.5, 3.5)]), parameters]
        out = np.zeros(3)
        arguments = (double_p * 3)(*(x.ctypes.data_as(double_p) for x in inputs))
        results = (double_p * 1)(out.ctypes.data_as(double_p))
        assert evaluate(arguments, results, None, None, 0) == 0
        assert out == pytest.approx(symbolic(inputs[0], inputs[1], parameters).full().ravel(), rel=1e-13)
