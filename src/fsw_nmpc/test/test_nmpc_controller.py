"""The controller in closed loop: offset-free, within limits, and unbroken by sensors, solvers and people."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control import Command, Limits, Measurement, Reference
from fsw_model import ProcessModel, nominal
from fsw_nmpc.controller import NmpcController
from fsw_nmpc.horizon import horizon_of
from fsw_nmpc.ocp import Solution
from fsw_nmpc.solvers.choice import make_solver
from fsw_nmpc.tuning import Tuning

P = nominal()
TARGET = Reference(2.66, 850.0)
NAN = float("nan")


@pytest.fixture(scope="module")
def solver():
    return make_solver("auto", P, 20, 50)[0]


class Loop:
    """Process and controller; the process may differ from the controller's model."""

    def __init__(self, controller, model=None):
        self.controller, self.model = controller, model or ProcessModel(P)
        rest = self.model.equilibrium()
        self.state, self.applied, self.tick = rest.state.copy(), Command(rest.force_kn, rest.speed_rpm), 0

    def measure(self, **changes):
        shown = self.model.outputs(self.state, self.applied.force_kn, self.applied.speed_rpm)
        values = {"depth_mm": shown.depth_mm, "torque_nm": shown.motor_torque_nm, "temperature_c": shown.temperature_c}
        return Measurement(0.1 * self.tick, **(values | changes))

    def step(self, reference=TARGET, follow=None, **changes):
        """One tick; ``follow``: the command applied instead of the proposal."""
        proposal = self.controller.step(self.measure(**changes), reference, self.applied, 0.1)
        self.applied = follow or proposal.command
        self.model.step(self.state, self.applied.force_kn, self.applied.speed_rpm)
        self.tick += 1
        return proposal

    @property
    def shown(self):
        return self.measure()


def test_rests_at_the_operating_point(solver):
    loop = Loop(NmpcController(solver, P))
    for _ in range(50):
        proposal = loop.step()
        assert proposal.healthy
        assert proposal.diagnosis.solver_status.endswith("solved")
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-4)
    assert loop.shown.temperature_c == pytest.approx(850.0, abs=0.03)


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_tracks_both_set_points(solver, preset):
    controller = NmpcController(solver, P, Tuning.preset(preset))
    loop = Loop(controller)
    for _ in range(10):
        loop.step()
    for _ in range(500):
        proposal = loop.step(Reference(2.72, 856.0))
    assert loop.shown.depth_mm == pytest.approx(2.72, abs=controller.tuning.dead_band_depth_mm + 1e-3)
    assert loop.shown.temperature_c == pytest.approx(856.0, abs=controller.tuning.dead_band_temperature_c + 0.1)
    assert len(proposal.diagnosis.plan.time_s) == 54
    assert proposal.diagnosis.plan.time_s[-1] == pytest.approx(30.0)


def test_no_offset_under_torque_error(solver):
    """+10 % torque in the process: no output stays off, and the estimator says why."""
    wrong = P.scaled(sticking_stress_pa=1.1, friction_coefficient=1.1)
    loop = Loop(NmpcController(solver, P), ProcessModel(wrong))
    for _ in range(1200):
        proposal = loop.step()
    assert abs(loop.shown.depth_mm - 2.66) < 1e-3
    assert abs(loop.shown.temperature_c - 850.0) < 0.1
    assert proposal.diagnosis.disturbances["torque scale [1]"] == pytest.approx(1.1, abs=0.02)


def test_no_offset_under_output_disturbances(solver):
    loop = Loop(NmpcController(solver, P))
    for _ in range(900):
        shown = loop.shown
        loop.step(depth_mm=shown.depth_mm + 0.05, temperature_c=shown.temperature_c - 3.0)
    assert loop.shown.depth_mm + 0.05 == pytest.approx(2.66, abs=1e-3)
    assert loop.shown.temperature_c - 3.0 == pytest.approx(850.0, abs=0.1)


def test_predicts_through_a_missing_sensor_then_gives_up(solver):
    controller = NmpcController(solver, P)
    loop = Loop(controller)
    for _ in range(30):
        loop.step()
    sure = controller.estimator.depth_deviation_mm
    limit = round(controller.estimator.tuning.blind_limit_s / 0.1)
    for k in range(limit):
        assert loop.step(depth_mm=NAN, depth_valid=False).healthy, k
    assert controller.estimator.depth_deviation_mm > 2.0 * sure
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=5e-3)
    proposal = loop.step(depth_mm=NAN, depth_valid=False)
    assert not proposal.healthy
    assert "depth" in proposal.reason
    assert loop.step().healthy


@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf, 1e300, -1e300, 0.0])
@pytest.mark.parametrize("sensor", ["depth_mm", "torque_nm", "temperature_c"])
def test_absurd_samples_that_claim_to_be_valid(solver, sensor, value):
    """Never an exception nor a command beyond limits; sound again at once when the sensor is."""
    loop = Loop(NmpcController(solver, P))
    for _ in range(20):
        loop.step()
    for _ in range(3):
        before = loop.applied
        proposal = loop.step(**{sensor: value})
        assert Limits().clip(proposal.command, before) == proposal.command
    for _ in range(250):
        proposal = loop.step()
    assert proposal.healthy
    assert abs(loop.shown.depth_mm - 2.66) < 0.05
    assert abs(loop.shown.temperature_c - 850.0) < 5.0


@settings(max_examples=25, deadline=None)
@given(
    depth=st.floats(2.3, 3.0),
    temperature=st.floats(810.0, 910.0),
    force=st.floats(55.0, 100.0),
    speed=st.floats(280.0, 520.0),
    seed=st.integers(0, 1000),
)
def test_limits_hold_always(solver, depth, temperature, force, speed, seed):
    """Any set-point, any applied command: every proposal is within bounds and rates of the applied command."""
    rng = np.random.default_rng(seed)
    loop = Loop(NmpcController(solver, P))
    loop.applied = Command(force, speed)
    for _ in range(30):
        before, shown = loop.applied, loop.shown
        proposal = loop.step(Reference(depth, temperature), depth_mm=shown.depth_mm + rng.normal(0, 2e-3))
        assert proposal.command == Limits().clip(proposal.command, before)
        assert abs(proposal.command.force_kn - before.force_kn) <= 1.0 + 1e-9
        assert abs(proposal.command.speed_rpm - before.speed_rpm) <= 3.0 + 1e-9
        if not 55.0 <= loop.shown.temperature_c <= 1080.0:
            break


def test_saturation_without_failures(solver):
    """Set-points out of reach: no failed solve."""
    controller = NmpcController(solver, P)
    loop = Loop(controller)
    for k in range(600):
        sign = 1 if k // 150 % 2 else -1
        loop.step(Reference(2.66 + 0.5 * sign, 850.0 + (60.0 if sign > 0 else -40.0)))
    assert controller.bad_cycles == 0


def test_follows_the_applied_command_without_a_bump(solver):
    """While another controller moves the handles every proposal starts from them; so does the first after the swap."""
    loop = Loop(NmpcController(solver, P))
    for k in range(100):
        before = loop.applied
        other = Command(before.force_kn + 0.1 * math.sin(0.3 * k), before.speed_rpm + 0.5 * math.cos(0.2 * k))
        proposal = loop.step(follow=other)
        assert proposal.healthy
        assert abs(proposal.command.force_kn - before.force_kn) <= 1.0 + 1e-9
    last = loop.applied
    first = loop.step()
    assert abs(first.command.force_kn - last.force_kn) <= 1.0 + 1e-9
    assert abs(first.command.speed_rpm - last.speed_rpm) <= 3.0 + 1e-9


class Broken:
    """A solver that fails on demand, in a way of one's choice, and remembers where it was started."""

    name = "broken"

    def __init__(self, inner):
        self.inner, self.horizon, self.how, self.starts = inner, inner.horizon, "", []

    def solve(self, problem, moves):
        self.starts.append(np.array(moves))
        s = self.inner.solve(problem, moves)
        if self.how == "status":
            return Solution(s.moves, s.depth_mm, s.temperature_c, "iteration cap", 9, s.cost)
        if self.how == "nan":
            return Solution(s.moves * np.nan, s.depth_mm, s.temperature_c, "solved", 9, s.cost)
        if self.how == "fast":
            return Solution(s.moves + 2.0, s.depth_mm, s.temperature_c, "solved", 9, s.cost)
        if self.how == "beyond":
            away = np.tile([0.9, 2.9], len(moves) // 2)
            return Solution(away, s.depth_mm, s.temperature_c, "solved", 9, s.cost)
        return s


@pytest.mark.parametrize("how", ["status", "nan", "fast", "beyond"])
def test_a_failed_solve_is_bridged_by_the_plan_then_told(solver, how):
    broken = Broken(solver)
    controller = NmpcController(broken, P, plan_reuse=4)
    loop = Loop(controller)
    for _ in range(15):
        proposal = loop.step(Reference(2.76, 850.0))
    planned = np.diff([loop.applied.force_kn, *(f + 0.0 for f in proposal.diagnosis.plan.force_kn[1:4])])
    broken.how = how
    for k in range(4):
        before = loop.applied
        proposal = loop.step(Reference(2.76, 850.0))
        assert proposal.healthy
        assert proposal.reason.startswith("solver: ")
        if k < 3:
            assert proposal.command.force_kn - before.force_kn == pytest.approx(planned[k], abs=1e-6)
        assert len(proposal.diagnosis.plan.time_s) == 54
    proposal = loop.step(Reference(2.76, 850.0))
    assert not proposal.healthy
    assert controller.bad_cycles == 5
    broken.how, broken.starts = "", []
    assert loop.step(Reference(2.76, 850.0)).healthy
    assert not broken.starts[0].any(), "the solve after a failure starts cold"


def test_late_ticks_are_predicted_over(solver):
    """A gap of 1 s in the ticks: the estimate is where the process is."""
    controller = NmpcController(solver, P)
    loop = Loop(controller)
    for _ in range(40):
        loop.step(Reference(2.70, 853.0))
    for _ in range(9):
        loop.model.step(loop.state, loop.applied.force_kn, loop.applied.speed_rpm)
    proposal = controller.step(loop.measure(), Reference(2.70, 853.0), loop.applied, 1.0)
    assert proposal.healthy
    assert proposal.diagnosis.depth_estimate_mm == pytest.approx(loop.shown.depth_mm, abs=2e-3)
    assert proposal.diagnosis.temperature_estimate_c == pytest.approx(loop.shown.temperature_c, abs=0.1)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, 1e9, NAN])
def test_strange_times(solver, dt_s):
    loop = Loop(NmpcController(solver, P))
    for _ in range(5):
        loop.step()
    proposal = loop.controller.step(loop.measure(), TARGET, loop.applied, dt_s)
    assert math.isfinite(proposal.command.force_kn)
    assert loop.step().healthy


def test_diverged_estimator_starts_anew(solver):
    controller = NmpcController(solver, P)
    loop = Loop(controller)
    for _ in range(20):
        loop.step()
    controller.estimator._p[:] = np.nan
    proposals = [loop.step() for _ in range(3)]
    assert proposals[-1].healthy
    assert proposals[-1].diagnosis.depth_estimate_mm == pytest.approx(2.66, abs=5e-3)


def test_waits_for_what_it_needs(solver):
    controller = NmpcController(solver, P)
    assert not controller.step(Measurement(0.0, 2.66, 1e3, 850.0), Reference(NAN, 850.0), Command(78, 400), 0.1).healthy
    nothing = Measurement(0.0, NAN, NAN, NAN, False, False, False)
    controller.reset(Command(78.4, 407.576))
    proposal = controller.step(nothing, TARGET, Command(78.4, 407.576), 0.1)
    assert not proposal.healthy
    assert "depth" in proposal.reason
    good = Measurement(0.1, 2.66, 1052.86, 850.0)
    assert controller.step(good, TARGET, Command(78.4, 407.576), 0.1).healthy
    assert controller.step(good, Reference(NAN, NAN), Command(NAN, NAN), 0.1).healthy


def test_replaced_solver_goes_on_with_the_plan(solver):
    controller = NmpcController(solver, P)
    loop = Loop(controller)
    for _ in range(12):
        loop.step(Reference(2.76, 850.0))
    other = make_solver("auto", P, 54, 50)[0]
    controller.replace_solver(other)
    assert controller.solver.horizon.n_blocks == horizon_of(P, 54).n_blocks
    before = loop.applied
    proposal = loop.step(Reference(2.76, 850.0))
    assert proposal.healthy
    assert proposal.command == Limits().clip(proposal.command, before)
