"""The prediction: the same process as the model, exact dead time, exact sensitivities."""

import casadi as ca
import numpy as np
import pytest

from fsw_model import ProcessModel, nominal
from fsw_nmpc import kernel_codegen
from fsw_nmpc.horizon import PAPER_GRID_S, horizon_of
from fsw_nmpc.library import KERNEL, State
from fsw_test_support.nmpc_prediction import n_start, prediction_function, start_vector
from fsw_test_support.nmpc_problems import make_library, predict, random_moves, random_start

P = nominal()


def start_from(state, force_kn, speed_rpm):
    """What a prediction from a state of the process starts from.

    The model's power without its parabola.
    """
    creep, slow, _, copper, tool, motor = state.x
    x = (creep, slow, copper, tool, motor)
    start = KERNEL.new("fsw_start", x=x, force_kn=force_kn, speed_rpm=speed_rpm)
    start.x[State.SCALE] = start.x[State.DEPTH_GAIN] = 1.0
    history = np.array([(p0, p1 + p2, p3) for p0, p1, p2, p3 in state.power])
    start.history[0 : history.size] = history.ravel().tolist()
    return start


@pytest.mark.parametrize("dead_time_s", [2.8, 2.85, 1.8, 0.9, 4.0, 10.0])
def test_prediction_matches_the_process(dead_time_s, rng):
    """From a moving state, with random moves at every interval.

    As the process model steps it, the tail included.
    """
    p = P.changed(dead_time_s=dead_time_s)
    model, library = ProcessModel(p), make_library(54, p)
    state, force, speed = model.equilibrium().state.copy(), 78.4, 407.576
    for _ in range(60):
        force, speed = force + rng.uniform(-0.5, 0.5), speed + rng.uniform(-2, 2)
        model.step(state, force, speed)
    moves = random_moves(rng, library.horizon)
    depth, temperature, _, _ = predict(library, start_from(state, force, speed), moves)
    grid, tick = PAPER_GRID_S, 0
    for k, (df, dn) in enumerate(moves.reshape(-1, 2)):
        force, speed = force + df, speed + dn
        while tick < round(10 * grid[k + 1]):
            model.step(state, force, speed)
            tick += 1
        shown = model.outputs(state, force, speed)
        # the tail's steps of 1 s take the torque as linear
        assert depth[k] == pytest.approx(shown.depth_mm, abs=1e-6 if k < 50 else 1e-4)
        assert temperature[k] == pytest.approx(shown.temperature_c, abs=1e-4 if k < 50 else 2e-2)


def test_dead_time_is_exact(library, rng):
    """No move acts on the temperature before 2.8 s.

    Each power of the history arrives when its time has come.
    """
    h = library.horizon
    start, still = random_start(rng, h, P), np.zeros(2 * h.n_blocks)
    _, temperature, _, by_temperature = predict(library, start, still)
    early = h.time_s < 2.8 + 1e-9
    assert not by_temperature[early].any()
    assert by_temperature[~early].any(axis=1).all()
    for tick in (0, 13, 27):
        start.history[3 * tick] += 10.0
        _, changed, _, _ = predict(library, start, still)
        start.history[3 * tick] -= 10.0
        first = int(np.nonzero(np.abs(changed - temperature) > 1e-12)[0][0])
        assert h.time_s[first] == pytest.approx(0.1 * (tick + 1))


@pytest.mark.slow
@pytest.mark.parametrize("dead_time_s", [2.8, 2.85, 1.83])
def test_library_and_casadi_predict_the_same_with_the_same_slopes(dead_time_s, rng):
    p = P.changed(dead_time_s=dead_time_s)
    library = make_library(20, p)
    h = library.horizon
    expression = prediction_function(p, h)
    symbols = [
        ca.SX.sym("moves", 40),
        ca.SX.sym("start", n_start(h)),
        ca.SX.sym("history", 3 * h.n_history),
    ]
    outputs = ca.vertcat(*expression(*symbols))
    both = ca.Function("both", symbols, [outputs, ca.jacobian(outputs, symbols[0])])
    for _ in range(5):
        start, moves = random_start(rng, h, p), random_moves(rng, h)
        depth, temperature, by_depth, by_temperature = predict(library, start, moves)
        values, slopes = both(
            moves, start_vector(start, h), list(start.history[0 : 3 * h.n_history])
        )
        assert np.concatenate([depth, temperature]) == pytest.approx(
            values.full().ravel(), rel=1e-12
        )
        assert np.vstack([by_depth, by_temperature]) == pytest.approx(
            slopes.full(), rel=1e-9, abs=1e-11
        )


def test_horizons_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="21 blocks"):
        horizon_of(P, 21)
    with pytest.raises(ValueError, match=r"'dead_time_s' is 0\.5: .* 0\.9 s"):
        horizon_of(P.changed(dead_time_s=0.5), 20)


@pytest.mark.skipif(
    f"CasADi {ca.__version__}." not in (KERNEL.folder / "torque.c").read_text(encoding="utf-8"),
    reason="another version of CasADi writes the same function in other words",
)
def test_generated_torque_is_up_to_date():
    """The C file is what the equations give now."""
    assert (KERNEL.folder / "torque.c").read_text(encoding="utf-8") == kernel_codegen.generate()
