"""The controller in closed loop: offset-free, within limits, and unbroken by sensors, solvers and people."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fsw_control import Command, Limits, Measurement, Reference
from fsw_control.contract import Coming
from fsw_model import ProcessModel, nominal
from fsw_nmpc import NmpcController
from fsw_nmpc import controller as controller_module
from fsw_nmpc.library import SolveStatus
from fsw_test_support.nmpc_problems import finish_changes

P = nominal()
TARGET = Reference(2.66, 816.4)
NAN = float("nan")
BOUNDED = NmpcController()


class Loop:
    """Process and controller; the process may differ from the controller's model."""

    def __init__(self, controller=None, model=None):
        self.controller, self.model = controller or NmpcController(), model or ProcessModel(P)
        rest = self.model.equilibrium()
        self.state, self.applied, self.tick = rest.state.copy(), Command(rest.force_kn, rest.speed_rpm), 0
        self.controller.reset(self.applied)

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


def within(proposal, before):
    """Whether a proposal keeps the bounds always, and the moves where it can; else it is not healthy."""
    lim, command = Limits(), proposal.command
    if lim.clip(command, None) != command:
        return False
    near = lim.clip(before, None)
    if max(abs(near.force_kn - before.force_kn) - 1.0, abs(near.speed_rpm - before.speed_rpm) - 3.0) > 1e-6:
        before, healthy = near, False
    else:
        healthy = proposal.healthy
    moves = abs(command.force_kn - before.force_kn) - 1.0, abs(command.speed_rpm - before.speed_rpm) - 3.0
    return max(moves) <= 2e-6 and healthy == proposal.healthy


@pytest.mark.slow
def test_rests_at_the_operating_point():
    loop = Loop()
    for _ in range(50):
        proposal = loop.step()
        assert proposal.healthy
        assert proposal.diagnosis.solver_status == "rti: solved"
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-6)
    assert loop.shown.temperature_c == pytest.approx(816.4, abs=1e-4)
    assert set(proposal.diagnosis.disturbances) == {"force_kn", "power_kw", "torque_scale", "depth_mm", "temperature_c"}


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "depth_mm", "temperature_c"), [("default", 1e-4, 0.01), ("paper", 3e-3, 0.2)])
def test_tracks_both_set_points(preset, depth_mm, temperature_c):
    loop = Loop(NmpcController({"preset": preset}))
    for _ in range(10):
        loop.step()
    for _ in range(500):
        proposal = loop.step(Reference(2.72, 822.4))
    assert loop.shown.depth_mm == pytest.approx(2.72, abs=depth_mm)
    assert loop.shown.temperature_c == pytest.approx(822.4, abs=temperature_c)
    assert len(proposal.diagnosis.plan.time_s) == 54
    assert proposal.diagnosis.plan.time_s[-1] == pytest.approx(30.0)


def test_plan_is_what_happens():
    """Nominal process, no noise: with inputs as planned, the outputs are as planned."""
    loop = Loop()
    for _ in range(5):
        loop.step()
    for _ in range(3):
        plan = loop.step(Reference(2.8, 826.4)).diagnosis.plan
    for k in range(1, 45):
        assert loop.shown.depth_mm == pytest.approx(plan.depth_mm[k - 1], abs=5e-4)
        assert loop.shown.temperature_c == pytest.approx(plan.temperature_c[k - 1], abs=0.2)
        loop.step(Reference(2.8, 826.4), follow=Command(plan.force_kn[k], plan.speed_rpm[k]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "factors",
    [
        {"sticking_stress_pa": 1.1, "sliding_friction": 1.1},
        {"thermal_gain_c_per_kw": 0.7},
        {"thermal_gain_c_per_kw": 1.4},
        {"depth_gain_mm_per_kn_s": 0.7},
        {"depth_gain_mm_per_kn_s": 1.4},
        {"softening_per_c": 1.5},
        {"dead_time_s": 1.2},
        {"copper_lag_s": 1.5},
    ],
    ids=lambda factors: " ".join(f"{name}x{factor}" for name, factor in factors.items()),
)
@pytest.mark.full
def test_no_offset_on_another_process(factors):
    loop = Loop(model=ProcessModel(P.scaled(**factors)))
    for _ in range(30):
        loop.step()
    for _ in range(1300):
        loop.step(Reference(2.76, 824.4))
    assert loop.shown.depth_mm == pytest.approx(2.76, abs=5e-4)
    assert loop.shown.temperature_c == pytest.approx(824.4, abs=0.05)


def test_no_offset_under_output_disturbances():
    loop = Loop()
    for _ in range(900):
        shown = loop.shown
        loop.step(depth_mm=shown.depth_mm + 0.05, temperature_c=shown.temperature_c - 3.0)
    assert loop.shown.depth_mm + 0.05 == pytest.approx(2.66, abs=2e-4)
    assert loop.shown.temperature_c - 3.0 == pytest.approx(816.4, abs=0.02)


def test_predicts_through_a_missing_sensor_then_gives_up():
    loop = Loop()
    for _ in range(30):
        loop.step()
    for k in range(30):
        assert loop.step(depth_mm=NAN, depth_valid=False).healthy, k
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-3)
    proposal = loop.step(depth_mm=NAN, depth_valid=False)
    assert not proposal.healthy
    assert proposal.reason == "no valid depth for 3 s"
    assert loop.step().healthy


def test_held_values_are_no_measurements():
    """A depth sensor hangs while the set-point moves: its held value must not tell the estimator to stand still."""
    loop, held = Loop(), None
    for k in range(40):
        if k < 10:
            loop.step()
            held = loop.shown.depth_mm
        elif k < 25:
            proposal = loop.step(Reference(2.76, 816.4), depth_mm=held, held=("depth",))
        else:
            proposal = loop.step(Reference(2.76, 816.4))
        if k >= 10:
            assert proposal.diagnosis.depth_estimate_mm == pytest.approx(loop.shown.depth_mm, abs=5e-3)


@pytest.mark.requirement("S4")
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf, 1e300, -1e300, 0.0])
@pytest.mark.parametrize("sensor", ["depth_mm", "torque_nm", "temperature_c"])
def test_absurd_samples_that_claim_to_be_valid(sensor, value):
    """Never an exception nor a command beyond limits; sound again at once when the sensor is."""
    loop = Loop()
    for _ in range(20):
        loop.step()
    for _ in range(3):
        before = loop.applied
        assert within(loop.step(**{sensor: value}), before)
    for _ in range(250):
        proposal = loop.step()
    assert proposal.healthy
    assert abs(loop.shown.depth_mm - 2.66) < 0.01
    assert abs(loop.shown.temperature_c - 816.4) < 1.0


@pytest.mark.requirement("S4")
@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    depth=st.floats(2.3, 3.0),
    temperature=st.floats(780.0, 880.0),
    force=st.floats(55.0, 100.0),
    speed=st.floats(280.0, 520.0),
    seed=st.integers(0, 1000),
)
def test_limits_hold_always(depth, temperature, force, speed, seed):
    """Any set-point, any applied command: every proposal is within bounds and moves of the applied command."""
    rng = np.random.default_rng(seed)
    loop = Loop()
    loop.applied = Command(force, speed)
    for _ in range(30):
        before, shown = loop.applied, loop.shown
        proposal = loop.step(Reference(depth, temperature), depth_mm=shown.depth_mm + rng.normal(0, 2e-3))
        assert within(proposal, before)


any_float = st.floats() | st.sampled_from([NAN, math.inf, 0.0, -0.0, 5e-324, 1e12, -1e12, 1e300, -1e300])


def mostly(value):
    return st.just(value) | any_float


anything = st.tuples(
    *(mostly(value) for value in (2.66, 1052.0, 816.4, 78.4, 407.6, 78.4, 407.6, 2.7, 818.0, 0.1)),
    st.tuples(*[st.booleans()] * 3),
    st.lists(st.builds(Coming, any_float, any_float, any_float), max_size=10),
)


#: with sensors that are not valid
SANE = (2.66, 1052.0, 816.4, 78.4, 407.6, 78.4, 407.6, 2.7, 818.0, 0.1, (False, False, False), [])


@pytest.mark.requirement("S31")
@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@example([*[SANE] * 3, (*SANE[:4], 50970.0, *SANE[5:10], (True, False, True), [])])
@given(st.lists(anything, max_size=25))
def test_whatever_comes_the_command_is_inside_the_bounds(ticks):
    """Any bits in any input, for many ticks; then sane ones find it within the bounds and a move, and soon well.

    After drives far out of their bounds that were said to be valid, the estimator needs two seconds to come back.
    """
    controller = BOUNDED
    controller.reset(Command(NAN, 0.0))
    for depth, torque, temperature, acting_kn, acting_rpm, force, speed, *reference, dt_s, valid, coming in ticks:
        m = Measurement(0.0, depth, torque, temperature, *valid, force_kn=acting_kn, speed_rpm=acting_rpm)
        proposal = controller.step(m, Reference(*reference, tuple(coming)), Command(force, speed), dt_s)
        known = Command(force, speed) if math.isfinite(force + speed) else proposal.command
        assert within(proposal, known)
    healthy = []
    for _ in range(40):
        proposal = controller.step(Measurement(0.0, 2.66, 1052.0, 816.4), TARGET, Command(78.4, 407.6), 0.1)
        assert within(proposal, Command(78.4, 407.6))
        healthy.append(proposal.healthy)
    assert healthy[-1]


@pytest.mark.requirement("S31")
def test_an_absurd_applied_command_is_told_and_not_believed():
    loop = Loop()
    for _ in range(5):
        loop.step()
    for force_kn in (1e12, -1e300, 97.0, 58.0):
        proposal = loop.controller.step(loop.measure(), TARGET, Command(force_kn, 407.6), 0.1)
        assert (proposal.healthy, proposal.command.force_kn) == (
            False,
            Limits().clip(Command(force_kn, 400.0), None).force_kn,
        )
        assert "outside the bounds" in proposal.reason
    after = loop.step()
    assert after.healthy and abs(after.command.force_kn - 78.4) < 0.2


@pytest.mark.requirement("S31")
def test_an_absurd_applied_command_leaves_as_little_behind_as_an_unknown_one():
    after = []
    for strange in (Command(1e12, 407.6), Command(NAN, NAN)):
        loop = Loop()
        for _ in range(5):
            loop.step()
        loop.controller.step(loop.measure(), TARGET, strange, 0.1)
        after.append(loop.step().command)
    assert after[0] == after[1]


@pytest.mark.requirement("S31")
@pytest.mark.parametrize(
    ("force_kn", "speed_rpm", "inside"),
    [
        *((60.0 + off, 407.6, off > -1.0) for off in (-1.1, -0.9, 0.5)),
        *((95.0 + off, 407.6, off < 1.0) for off in (-0.5, 0.9, 1.1)),
        *((78.4, 300.0 + off, off > -3.0) for off in (-3.1, -2.9, 1.5)),
        *((78.4, 500.0 + off, off < 3.0) for off in (-1.5, 2.9, 3.1)),
    ],
)
def test_one_move_beyond_the_bounds_is_still_believed(force_kn, speed_rpm, inside):
    loop = Loop(BOUNDED)
    proposal = loop.controller.step(loop.measure(), TARGET, Command(force_kn, speed_rpm), 0.1)
    assert proposal.healthy == inside


@pytest.mark.requirement("S31")
@pytest.mark.parametrize(
    ("applied", "reference"),
    [
        (Command(95.8, 407.6), Reference(2.36, 816.4)),
        (Command(59.2, 407.6), Reference(2.96, 816.4)),
        (Command(78.4, 502.5), Reference(2.66, 776.4)),
        (Command(78.4, 297.5), Reference(2.66, 866.4)),
    ],
)
def test_from_beyond_a_bound_the_way_back_is_one_move_a_tick(applied, reference):
    """However far away the set-points are."""
    loop = Loop(BOUNDED)
    for _ in range(3):
        proposal = loop.controller.step(loop.measure(), reference, applied, 0.1)
        assert proposal.healthy and within(proposal, applied)
    move = abs(proposal.command.force_kn - applied.force_kn), abs(proposal.command.speed_rpm - applied.speed_rpm)
    assert move[0] == pytest.approx(1.0) or move[1] == pytest.approx(3.0)


@pytest.mark.parametrize(("beyond", "bound"), [((95.5, 407.6), (95.0, 407.6)), ((78.4, 298.0), (78.4, 300.0))])
def test_an_applied_command_beyond_a_bound_counts_as_the_bound(beyond, bound):
    """The drives keep the bounds, whatever they were told."""
    after = []
    for first in (beyond, bound):
        loop = Loop(BOUNDED)
        loop.controller.step(loop.measure(), TARGET, Command(*first), 0.1)
        after.append(loop.controller.step(loop.measure(), TARGET, Command(*bound), 0.1).diagnosis.disturbances)
    assert after[0] == after[1]


@pytest.mark.requirement("S31")
def test_while_it_waits_for_sensors_its_command_is_inside_the_bounds():
    loop = Loop(BOUNDED)
    for applied in (Command(97.0, 407.6), Command(1e300, -1e300), Command(59.5, 301.0)):
        blind = loop.measure(depth_mm=NAN, depth_valid=False)
        proposal = loop.controller.step(blind, TARGET, applied, 0.1)
        assert not proposal.healthy and "waiting" in proposal.reason
        assert Limits().clip(proposal.command, None) == proposal.command


def test_saturation_without_failures():
    """Set-points out of reach: no failed solve, and the set-points that can be reached are."""
    loop = Loop()
    for k in range(600):
        sign = 1 if k // 150 % 2 else -1
        proposal = loop.step(Reference(2.66 + 0.5 * sign, 816.4 + (60.0 if sign > 0 else -40.0)))
    assert proposal.diagnosis.bad_cycles == 0
    for _ in range(900):
        loop.step()
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-3)
    assert loop.shown.temperature_c == pytest.approx(816.4, abs=0.1)


@pytest.mark.requirement("S12")
def test_follows_another_controller_and_takes_over_without_a_bump():
    """Another one moves the inputs about while this one only watches; then it is in command, and nothing jumps."""
    loop = Loop()
    for k in range(100):
        before = loop.applied
        other = Command(before.force_kn + 0.1 * math.sin(0.3 * k), before.speed_rpm + 0.5 * math.cos(0.2 * k))
        assert loop.step(follow=other).healthy
    here = Reference(loop.shown.depth_mm, loop.shown.temperature_c)
    watched, last = loop.controller.library.output, loop.applied
    assert watched.depth_mm == pytest.approx(here.depth_mm, abs=1e-3)
    moves = []
    for _ in range(30):
        loop.step(here)
        moves.append((loop.applied.force_kn - last.force_kn, loop.applied.speed_rpm - last.speed_rpm))
        last = loop.applied
    rest = Loop()
    for _ in range(100):
        rest.step()
    still = rest.applied
    first = rest.step()
    assert abs(first.command.force_kn - still.force_kn) < 1e-3  # at rest a swap moves nothing at all
    assert abs(first.command.speed_rpm - still.speed_rpm) < 1e-2
    assert all(abs(force) <= 1.0 + 1e-9 and abs(speed) <= 3.0 + 1e-9 for force, speed in moves)


class Broken:
    """A solver that fails on demand, in a way of one's choice, and remembers where it was started."""

    name = "broken"

    def __init__(self, library):
        self.library, self.how, self.starts = library, "", []

    def solve(self, problem, moves):
        self.starts.append(np.array(moves))
        status, found, depth, temperature = self.library.solve(problem, moves)
        if self.how == "status":
            status = SolveStatus.ITERATION_CAP
        elif self.how == "nan":
            found = found * np.nan
        elif self.how in ("fast", "fast down"):
            found = np.array(found)
            found[0] += 2.0 if self.how == "fast" else -2.0  # the first move of the force only
        elif self.how in ("beyond", "beyond below"):
            found = np.tile([0.9, 2.9], len(moves) // 2) * (1.0 if self.how == "beyond" else -1.0)
        return status, found, depth, temperature


@pytest.mark.parametrize("how", ["status", "nan", "fast", "fast down", "beyond", "beyond below"])
def test_a_failed_solve_is_bridged_by_the_plan_then_told(how):
    controller = NmpcController({"plan_reuse": 4})
    controller.solver = broken = Broken(controller.library)
    loop = Loop(controller)
    for _ in range(15):
        proposal = loop.step(Reference(2.76, 816.4))
    planned = np.diff([loop.applied.force_kn, *proposal.diagnosis.plan.force_kn[1:4]])
    broken.how = how
    for k in range(4):
        before = loop.applied
        proposal = loop.step(Reference(2.76, 816.4))
        assert proposal.healthy
        assert proposal.reason.startswith("solver: ")
        if k < 3:
            assert proposal.command.force_kn - before.force_kn == pytest.approx(planned[k], abs=1e-6)
        assert len(proposal.diagnosis.plan.time_s) == 54
    proposal = loop.step(Reference(2.76, 816.4))
    assert not proposal.healthy
    assert proposal.diagnosis.bad_cycles == 5
    broken.how, broken.starts = "", []
    assert loop.step(Reference(2.76, 816.4)).healthy
    assert not broken.starts[0].any(), "the solve after a failure starts cold"


def test_late_ticks_are_predicted_over():
    """A gap of 1 s in the ticks: the estimate is where the process is."""
    loop = Loop()
    for _ in range(40):
        loop.step(Reference(2.70, 819.4))
    for _ in range(9):
        loop.model.step(loop.state, loop.applied.force_kn, loop.applied.speed_rpm)
    proposal = loop.controller.step(loop.measure(), Reference(2.70, 819.4), loop.applied, 1.0)
    assert proposal.healthy
    # the first sample after the gap looks like a spike, so this is the prediction alone
    assert proposal.diagnosis.depth_estimate_mm == pytest.approx(loop.shown.depth_mm, abs=5e-4)
    assert proposal.diagnosis.temperature_estimate_c == pytest.approx(loop.shown.temperature_c, abs=1e-2)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, 1e9, NAN])
def test_strange_times(dt_s):
    loop = Loop()
    for _ in range(5):
        loop.step()
    proposal = loop.controller.step(loop.measure(), TARGET, loop.applied, dt_s)
    assert math.isfinite(proposal.command.force_kn)
    assert loop.step().healthy


def test_diverged_estimator_starts_again():
    loop = Loop()
    for _ in range(20):
        loop.step()
    for row in loop.controller.library.state.estimator.p:
        row[0:10] = [NAN] * 10
    proposals = [loop.step() for _ in range(3)]
    assert proposals[-1].healthy
    assert proposals[-1].diagnosis.depth_estimate_mm == pytest.approx(2.66, abs=1e-3)


def test_waits_for_what_it_needs():
    controller = NmpcController()
    applied = Command(78.4, 407.576)
    good = Measurement(0.1, 2.66, 1052.86, 816.4)
    proposal = controller.step(good, Reference(NAN, 816.4), applied, 0.1)
    assert (proposal.healthy, proposal.reason) == (False, "no usable reference")
    controller.reset(applied)
    proposal = controller.step(Measurement(0.0, NAN, NAN, NAN, False, False, False), TARGET, applied, 0.1)
    assert (proposal.healthy, proposal.reason) == (False, "waiting for valid sensors: depth, thermocouple")
    assert controller.step(good, TARGET, applied, 0.1).healthy
    assert controller.step(good, Reference(NAN, NAN), Command(NAN, NAN), 0.1).healthy


def test_another_horizon_goes_on_with_the_plan(tmp_path):
    loop = Loop()
    for _ in range(12):
        before = loop.step(Reference(2.76, 816.4))
    file = tmp_path / "every_interval.yaml"
    file.write_text("blocks: 54")
    loop.controller.configure({"tuning_file": str(file)})
    finish_changes(loop.controller)
    assert loop.controller.library.horizon.n_blocks == 54
    last = loop.applied
    proposal = loop.step(Reference(2.76, 816.4))
    assert proposal.healthy
    planned = before.diagnosis.plan.force_kn[1] - before.diagnosis.plan.force_kn[0]
    assert proposal.command.force_kn - last.force_kn == pytest.approx(planned, abs=0.2)


def test_a_solver_that_cannot_be_made_is_told_and_later_changes_work(tmp_path, monkeypatch):
    """The disk is full once: the old solver works on, the proposals say why, and the next change tries again."""
    told = []
    loop = Loop(NmpcController(complain=told.append))
    (tmp_path / "54.yaml").write_text("blocks: 54")
    make, full = controller_module._make, [True]

    def make_or_fail(settings):
        if full and full.pop():
            raise OSError(28, "No space left on device")
        return make(settings)

    monkeypatch.setattr(controller_module, "_make", make_or_fail)
    loop.controller.configure({"tuning_file": str(tmp_path / "54.yaml")})
    finish_changes(loop.controller)
    for _ in range(3):
        proposal = loop.step()
        assert proposal.healthy and "No space left on device" in proposal.reason
    assert len(told) == 1 and loop.controller.library.horizon.n_blocks == 20
    loop.controller.configure({"tuning_file": str(tmp_path / "54.yaml")})  # the same once more
    finish_changes(loop.controller)
    assert loop.controller.library.horizon.n_blocks == 54 and loop.step().reason == ""


@pytest.mark.slow
@pytest.mark.full
def test_reference_solver_in_the_loop_does_the_same():
    """Real-time iterations against problems solved to convergence, over a step of both set-points."""
    loops = [Loop(), Loop(NmpcController({"solver": "reference"}))]
    for k in range(40):
        for loop in loops:
            proposal = loop.step(TARGET if k < 3 else Reference(2.76, 822.4))
            assert proposal.healthy, proposal.reason
    assert loops[0].shown.depth_mm == pytest.approx(loops[1].shown.depth_mm, abs=5e-4)
    assert loops[0].applied.force_kn == pytest.approx(loops[1].applied.force_kn, abs=0.2)
    assert loops[0].applied.speed_rpm == pytest.approx(loops[1].applied.speed_rpm, abs=1.0)  # of 33 rpm moved
