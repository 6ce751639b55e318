"""Time-outs and ramps are times of the clock, however far apart the measurements are."""

from itertools import pairwise

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Reason
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import Persistence
from fsw_supervisor.state_machine import Machine, Mode

SECOND_NS = 1_000_000_000
#: time between two measurements: that of a tick, and just less than what counts as a gap [s]
PERIODS_S = (0.1, 0.3, 0.9)


def slow_tick(rig, period_s):
    """A tick after a pause; returns its one command."""
    rig.now_s += period_s - 0.1
    rig.stamp_ns += round((period_s - 0.1) * 10) * SECOND_NS // 10
    (decision,) = rig.tick()
    return decision


def seconds_until(rig, period_s, condition, most_s=60.0):
    """Time until a condition holds."""
    begin_s = rig.now_s
    while not condition():
        assert rig.now_s - begin_s < most_s
        slow_tick(rig, period_s)
    return rig.now_s - begin_s


def lockstep_tick(rig, period_s=0.1, pace_s=0.0):
    """A tick whose command the plant waits for; returns it."""
    rig.now_s += pace_s
    rig.stamp_ns += round(period_s * 10) * SECOND_NS // 10
    out = rig.arbiter.on_drives(rig.stamp_ns, rig.arbiter.applied or rig.drives, rig.now_s)
    for sensor, value in rig.values.items():
        out += rig.arbiter.on_sample(sensor, rig.stamp_ns, value, rig.now_s)
    for name in rig.names:
        if name not in rig.silent:
            out += rig.arbiter.on_proposal(name, rig.proposal(name), rig.now_s)
            out += rig.arbiter.on_status(name, (), False, rig.now_s)
    while not out:
        rig.now_s = rig.arbiter.wakeup_s
        out += rig.arbiter.on_time(rig.now_s)
    (decision,) = out
    return decision


@pytest.mark.requirement("S7")
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_hold_in_lockstep_ends_after_its_time_limit(make_rig, period_s):
    rig = make_rig(lockstep=True)
    for _ in range(10):
        lockstep_tick(rig)
    rig.silent |= set(rig.names)
    machine = rig.arbiter.machine
    while machine.mode is not Mode.HOLD:
        lockstep_tick(rig, period_s)
    begin_ns = rig.stamp_ns
    while machine.mode is Mode.HOLD:
        assert rig.stamp_ns - begin_ns < 60 * SECOND_NS
        lockstep_tick(rig, period_s)
    assert (rig.stamp_ns - begin_ns) / SECOND_NS == pytest.approx(10.0, abs=2 * period_s)


@pytest.mark.requirement("S7")
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_hold_ends_after_its_time_limit(make_rig, period_s):
    rig = make_rig().run(10)
    rig.silent |= set(rig.names)
    machine = rig.arbiter.machine
    seconds_until(rig, period_s, lambda: machine.mode is Mode.HOLD)
    assert seconds_until(rig, period_s, lambda: machine.mode is Mode.SAFE_STOP) == pytest.approx(
        10.0, abs=period_s
    )


@pytest.mark.requirement("S7")
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_blind_manual_mode_ends_after_its_time_limit(make_rig, period_s):
    rig = make_rig(SupervisorParameters.from_values({"operator_hold_timeout_s": 20.0})).run(10)
    rig.arbiter.operator.ask_mode("manual", Command(78.4, 407.5), "operator")
    rig.values["depth"] = float("nan")
    machine = rig.arbiter.machine
    seconds_until(rig, period_s, lambda: rig.arbiter.safety.invalid_sensors == ("depth",))
    assert seconds_until(rig, period_s, lambda: machine.mode is Mode.SAFE_STOP) == pytest.approx(
        20.0, abs=period_s
    )


@pytest.mark.requirement("S7")
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_start_without_a_controller_ends_after_its_time_limit(make_rig, period_s):
    rig = make_rig(SupervisorParameters.from_values({"start_timeout_s": 20.0}))
    rig.names = []
    machine, begin_s = rig.arbiter.machine, rig.now_s
    while machine.mode is Mode.START:
        assert rig.now_s - begin_s < 60.0
        rig.now_s += period_s - 0.1
        rig.stamp_ns += round((period_s - 0.1) * 10) * SECOND_NS // 10
        rig.tick()
    assert rig.now_s - begin_s == pytest.approx(20.0, abs=2 * period_s)


@pytest.mark.parametrize(("period_s", "longest_s"), [(0.1, 6.8), (0.5, 7.0), (0.9, 12.7)])
def test_safe_stop_ramps_at_its_rate_as_far_as_the_move_limit_permits(rig, period_s, longest_s):
    """13.4 kN at 2 kN/s; where measurements come every 0.9 s, one move of 1 kN each."""
    rig.arbiter.operator.ask_mode("safe_stop", None, "operator")
    assert seconds_until(rig, period_s, lambda: rig.last.command.force_kn <= 65.0) <= longest_s
    forces_kn = [decision.command.force_kn for tick in rig.ticks for decision in tick]
    moves_kn = [before - after for before, after in pairwise(forces_kn)]
    assert max(moves_kn) <= rig.arbiter.settings.drive_limits.force_step_kn + 1e-9


def test_at_every_tick_the_ramp_moves_by_exactly_one_period(rig):
    rig.arbiter.operator.ask_mode("safe_stop", None, "operator")
    before = rig.last.command
    for _ in range(10):
        (decision,) = rig.tick()
        assert decision.command == Command(before.force_kn - 2.0 * 0.1, before.speed_rpm)
        before = decision.command


def test_a_burst_of_ticks_after_a_stall_does_not_hasten_the_ramp(rig):
    rig.arbiter.operator.ask_mode("safe_stop", None, "operator")
    rig.run(3)
    start_kn, start_s = rig.last.command.force_kn, rig.now_s
    rig.now_s += 0.5
    out = []
    for _ in range(4):
        rig.stamp_ns += SECOND_NS // 10
        rig.now_s += 0.001
        for sensor, value in rig.values.items():
            out += rig.arbiter.on_sample(sensor, rig.stamp_ns, value, rig.now_s)
        out += rig.arbiter.on_drives(rig.stamp_ns, rig.arbiter.applied, rig.now_s)
        out += rig.arbiter.on_time(rig.now_s)
    assert len(out) == 4
    assert start_kn - out[-1].command.force_kn <= 2.0 * (rig.now_s - start_s) + 1e-9


@pytest.mark.requirement("S1")
@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_trip_takes_effect_after_its_time_and_never_by_a_single_sample(make_rig, period_s):
    rig = make_rig()
    rig.values["thermocouple"] = 905.0
    rig.run(10)
    rig.values["thermocouple"] = 912.0
    assert slow_tick(rig, period_s).source == "decentral"
    stops_s = seconds_until(rig, period_s, lambda: rig.last.source == "safe_stop")
    assert stops_s == pytest.approx(max(0.2, period_s))


@pytest.mark.parametrize(
    ("elapsed_s", "limit_s", "values"),
    [(0.1, 0.3, 3), (0.1, 0.2, 2), (0.1, 0.1, 2), (0.9, 0.3, 2), (0.05, 0.3, 4)],
)
def test_persistence_is_a_time_in_at_least_two_values(elapsed_s, limit_s, values):
    persistence = Persistence()
    for count in range(1, values + 1):
        assert not persistence.reaches(limit_s, 0.1)
        persistence.note(True, 7.0 if count == 1 else elapsed_s, 0.1)
    assert persistence.reaches(limit_s, 0.1)
    persistence.note(False, elapsed_s, 0.1)
    assert persistence == Persistence()


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_storm_window_is_a_time(period_s):
    machine = Machine(SupervisorParameters.from_values({"storm_swaps": 1, "storm_window_s": 9.0}))
    machine.advance(1, 1 * SECOND_NS)
    machine.fire(Cause.READY, Reason(), "start", "a")
    machine.swap("b", Cause.SWAP_FAILED, Reason(), "failover")
    step_ns = round(period_s * SECOND_NS)
    for count in range(1, 200):
        machine.advance(1 + count, SECOND_NS + count * step_ns)
        if not machine.storming():
            break
    assert count * period_s == pytest.approx(9.0, abs=period_s)


@pytest.mark.parametrize("period_s", [0.3, 0.9])
def test_interval_between_swaps_is_a_time(make_rig, period_s):
    rig = make_rig(SupervisorParameters.from_values({"switch_interval_s": 1.8})).run(10)
    rig.arbiter.operator.ask_switch("nmpc", True, 0.0, "operator", rig.now_s)
    slow_tick(rig, period_s)
    assert rig.last.source == "nmpc"
    begin_s = rig.now_s
    while rig.last.source == "nmpc":
        assert rig.now_s - begin_s < 5.0
        rig.arbiter.operator.ask_switch("decentral", True, 0.0, "operator", rig.now_s)
        slow_tick(rig, period_s)
    assert rig.now_s - begin_s == pytest.approx(1.8, abs=1.5 * period_s)


def test_in_lockstep_a_request_times_out_by_the_stamps(make_rig):
    rig = make_rig(lockstep=True)
    for _ in range(10):
        lockstep_tick(rig)
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.silent.add("nmpc")
    request = rig.arbiter.operator.ask_switch("nmpc", False, 1.8, "operator", rig.now_s)
    begin_ns = rig.stamp_ns
    while not request.done:
        assert rig.stamp_ns - begin_ns < 5 * SECOND_NS
        lockstep_tick(rig, 0.9)
    assert request.reply.fact.code == "timed_out"
    assert rig.stamp_ns - begin_ns == pytest.approx(2.7 * SECOND_NS)


def test_time_outs_of_lockstep_do_not_depend_on_the_wall_clock(make_rig):
    """The same stamps at another pace lead to the same commands."""
    runs = []
    for pace_s in (0.0, 0.37, 3.1):
        rig = make_rig(SupervisorParameters.from_values({"hold_timeout_s": 2.0}), lockstep=True)
        commands = [lockstep_tick(rig, pace_s=pace_s) for _ in range(10)]
        rig.silent |= set(rig.names)
        commands += [lockstep_tick(rig, pace_s=pace_s) for _ in range(60)]
        runs.append([(decision.source, decision.command) for decision in commands])
    assert runs[0] == runs[1] == runs[2]
    assert runs[0][-1][0] == "safe_stop"


@pytest.mark.requirement("S7")
def test_a_hold_requested_in_a_pause_has_its_whole_time(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"operator_hold_timeout_s": 5.0})).run(10)
    rig.now_s += 60.0
    rig.stamp_ns += 60 * SECOND_NS
    rig.arbiter.on_time(rig.now_s)
    assert rig.arbiter.operator.ask_mode("hold", None, "operator")[0]
    rig.run(40)
    assert rig.arbiter.machine.mode is Mode.HOLD
    rig.run(15)
    assert rig.arbiter.machine.mode is Mode.SAFE_STOP
