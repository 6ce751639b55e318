"""A safe stop: what leads into it at every tick, what leads out, and what must not."""

import math

import pytest

from fsw_control.cause import Cause, Severity
from fsw_control.contract import Command
from fsw_control.reason import Reason
from fsw_control.stop import StopCause
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import OPERATOR_TRIGGERS, Machine, Mode

HOT, GOOD, NAN = 930.0, 850.0, math.nan
MANUAL = Command(78.0, 407.5)
OUT = ("auto", "hold", "manual")


def ask(rig, mode):
    return rig.arbiter.operator.ask_mode(mode, MANUAL, "operator")


def acknowledge(rig):
    return rig.arbiter.operator.acknowledge("operator")


WARM = (850.0 + HOT) / 2.0  # from one to the other in a step is a jump


def stop_by_heat(rig):
    rig.values["thermocouple"] = WARM
    rig.run(5)
    rig.values["thermocouple"] = HOT
    rig.run(10)
    assert rig.last.source == "safe_stop"
    return rig


def cool(rig):
    rig.values["thermocouple"] = WARM
    rig.run(5)
    rig.values["thermocouple"] = GOOD
    return rig.run(10)


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("mode", OUT)
def test_no_mode_leads_out_while_the_cause_is_there(rig, mode):
    stop_by_heat(rig)
    for request in (lambda: ask(rig, mode), lambda: acknowledge(rig), lambda: ask(rig, mode)):
        ok, why = request()
        assert not ok
        assert [cause.data["interlock"] for cause in why.data["causes"]] == ["temperature_high"]
    rig.values["thermocouple"] = 1100.0
    rig.run(100)
    assert rig.last.source == "safe_stop"


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("mode", OUT)
@pytest.mark.parametrize("why", ["interlock", "operator", "time-out"])
def test_every_safe_stop_is_left_only_after_an_acknowledgement(make_rig, mode, why):
    rig = make_rig(SupervisorParameters.from_values({"hold_timeout_s": 1.0})).run(10)
    if why == "interlock":
        cool(stop_by_heat(rig))
    elif why == "operator":
        assert ask(rig, "safe_stop")[0]
    else:
        rig.silent |= set(rig.names)
        rig.run(15)
        rig.silent.clear()
    rig.run(10)
    assert rig.arbiter.machine.mode is Mode.SAFE_STOP
    ok, why = ask(rig, mode)
    assert (ok, why.code) == (False, "acknowledge_first")
    assert rig.run(3).last.source == "safe_stop"
    assert acknowledge(rig)[0]
    assert rig.run(3).last.source == "safe_stop", "the acknowledgement by itself leads nowhere"
    assert ask(rig, mode)[0]
    rig.run(1)
    assert rig.arbiter.machine.mode == mode
    assert not rig.arbiter.machine.acknowledged


def test_there_is_nothing_to_acknowledge_outside_a_safe_stop(rig):
    assert not acknowledge(rig)[0]
    assert rig.run(1).last.source == "decentral"


@pytest.mark.requirement("S25")
def test_a_cause_after_the_acknowledgement_voids_it(rig):
    cool(stop_by_heat(rig))
    assert acknowledge(rig)[0]
    cool(stop_by_heat(rig))
    assert not ask(rig, "hold")[0]


COLD = 770.0


def change_temperature(rig, value):
    """In steps that are no jumps of the sensor."""
    while (gap := value - rig.values["thermocouple"]) != 0.0:
        rig.values["thermocouple"] += max(-30.0, min(30.0, gap))
        rig.run(5)
    return rig.run(10)


@pytest.mark.requirement("S25")
def test_cooling_by_the_stop_is_acknowledged_but_lets_nobody_leave_it(rig):
    ask(rig, "safe_stop")
    change_temperature(rig.run(10), COLD)
    assert rig.arbiter.safety.active["temperature_low"] is Severity.TRIP
    assert acknowledge(rig)[0]
    rig.run(20)
    assert rig.arbiter.machine.acknowledged
    assert [ask(rig, mode)[0] for mode in OUT] == [False] * 3
    change_temperature(rig, GOOD)
    assert ask(rig, "hold")[0]


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("restarted", [False, True])
def test_trip_that_refuses_the_acknowledgement_is_listed(rig, restarted):
    """A supervisor that restarts in mid-stop cannot know that the cold is the stop's doing."""
    ask(rig, "safe_stop")
    change_temperature(rig.run(10), COLD)
    if restarted:
        rig.restart()
        rig.tick()  # listens
        rig.run(10)
    assert rig.arbiter.safety.active["temperature_low"] is Severity.TRIP
    listed = rig.arbiter.operator.acknowledgement_blocked_by
    assert listed == (("temperature_low",) if restarted else ())
    ok, why = acknowledge(rig)
    assert ok is not restarted
    assert ok or [cause.data["interlock"] for cause in why.data["causes"]] == list(listed)


@pytest.mark.requirement("S25")
def test_sensor_that_refuses_the_acknowledgement_is_listed(rig):
    ask(rig, "safe_stop")
    rig.run(1)
    assert rig.arbiter.operator.acknowledgement_blocked_by == ()
    del rig.values["depth"]
    rig.run(10)
    assert rig.arbiter.operator.acknowledgement_blocked_by == ("depth",)
    assert not acknowledge(rig)[0]


@pytest.mark.requirement("S25")
def test_cold_that_caused_the_stop_is_not_its_consequence(rig):
    change_temperature(rig, COLD)
    assert rig.arbiter.machine.mode is Mode.SAFE_STOP
    rig.run(20)
    assert not acknowledge(rig)[0]


@pytest.mark.requirement("S25")
def test_cold_when_the_stop_begins_is_not_its_consequence(rig):
    """An operator stops because of it, before it has lasted long enough to trip."""
    change_temperature(rig, 800.0)
    rig.values["thermocouple"] = COLD
    rig.run(1)
    ask(rig, "safe_stop")
    rig.run(20)
    assert rig.arbiter.safety.active["temperature_low"] is Severity.TRIP
    assert not acknowledge(rig)[0]


@pytest.mark.requirement("S25")
def test_another_trip_voids_an_acknowledgement_beside_the_stops_consequence(rig):
    ask(rig, "safe_stop")
    change_temperature(rig.run(10), COLD)
    assert acknowledge(rig)[0]
    rig.values["depth"] = 3.9
    rig.run(20)
    assert not rig.arbiter.machine.acknowledged
    assert not acknowledge(rig)[0]


@pytest.mark.requirement("S25")
def test_another_safe_stop_after_the_acknowledgement_voids_it(rig):
    ask(rig, "safe_stop")
    assert acknowledge(rig)[0]
    assert ask(rig, "safe_stop")[0]
    assert not ask(rig, "auto")[0]


@pytest.mark.requirement("S25")
def test_each_safe_stop_needs_an_acknowledgement_of_its_own(rig):
    for _ in range(2):
        ask(rig, "safe_stop")
        rig.run(1)
        assert not ask(rig, "auto")[0]
        assert acknowledge(rig)[0]
        assert ask(rig, "auto")[0]
        rig.run(1)


@pytest.mark.parametrize("unknown", [NAN, 2000.0, None])
def test_a_value_that_becomes_unknown_clears_no_trip(rig, unknown):
    stop_by_heat(rig)
    if unknown is None:
        del rig.values["thermocouple"]
    else:
        rig.values["thermocouple"] = unknown
    rig.run(50)
    assert rig.arbiter.safety.active["temperature_high"] is Severity.TRIP
    assert not acknowledge(rig)[0]


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.SAFE_STOP])
def test_a_cause_acts_by_level_in_every_mode(rig, mode):
    """However a mode came about while the cause is there (here: by force), it ends with the next tick."""
    stop_by_heat(rig)
    machine = rig.arbiter.machine
    machine.mode, machine.active = mode, "decentral" if mode is Mode.AUTO else ""
    rig.run(1)
    assert rig.last.source == "safe_stop"
    assert machine.cause is Cause.INTERLOCK_TRIP


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("jump_s", [-3600, 5])
@pytest.mark.parametrize("present", [True, False])
def test_a_gap_and_time_going_back_lead_nowhere(rig, jump_s, present):
    stop_by_heat(rig)
    if not present:
        cool(rig)
    rig.drives = rig.arbiter.applied
    rig.now_s += 5.0
    rig.arbiter.on_time(rig.now_s)
    rig.stamp_ns += jump_s * 1_000_000_000
    for _ in range(20):
        rig.tick()
        assert rig.arbiter.machine.mode is Mode.SAFE_STOP
    assert rig.last.source == "safe_stop"
    assert acknowledge(rig)[0] is not present


@pytest.mark.requirement("S25")
def test_a_standby_that_sees_a_cause_stays_in_the_safe_stop_whatever_the_leader_sends(rig):
    stop_by_heat(rig)
    arbiter = rig.arbiter
    arbiter.ticks.leading = False
    for _ in range(5):
        arbiter.follow(rig.stamp_ns, "decentral", arbiter.applied)
        assert arbiter.machine.mode is Mode.SAFE_STOP
    arbiter.ticks.leading = True
    cool(rig)
    assert rig.last.source == "safe_stop"


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("trigger", list(Cause))
def test_no_trigger_leads_out_of_a_safe_stop_that_is_not_acknowledged(mode, trigger):
    machine = Machine(SupervisorParameters.from_values({}))
    machine.mode = mode
    machine.register.stop(StopCause.OPERATOR, "operator", 0)
    machine.fire(Cause.OPERATOR_SAFE_STOP, Reason(), "operator")
    machine.fire(trigger, Reason(), "operator", "decentral")
    assert machine.mode is Mode.SAFE_STOP
    machine.acknowledge("operator")
    machine.fire(trigger, Reason(), "operator", "decentral")
    leads_out = trigger in OPERATOR_TRIGGERS.values() and trigger is not Cause.OPERATOR_SAFE_STOP
    assert (machine.mode is not Mode.SAFE_STOP) == leads_out


@pytest.mark.requirement("S27")
def test_a_hold_of_the_operator_ends_in_a_safe_stop_unless_it_is_renewed(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"operator_hold_timeout_s": 2.0, "hold_timeout_s": 0.5})
    ).run(10)
    ask(rig, "hold")
    rig.run(18)
    assert ask(rig, "hold")[0]
    rig.run(18)
    assert rig.last.source == "hold"
    rig.run(4)
    assert rig.last.source == "safe_stop"


@pytest.mark.requirement("S27")
def test_a_start_without_a_controller_ends_in_a_safe_stop(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"start_timeout_s": 2.0}))
    rig.names = []
    for _ in range(19):
        rig.tick()
    assert rig.arbiter.machine.mode is Mode.START
    for _ in range(100):
        rig.tick()
    assert rig.last.source == "safe_stop"
    assert rig.last.command.force_kn == pytest.approx(rig.arbiter.settings.safe_force_kn)


@pytest.fixture
def monitor():
    """A monitor with the default limits, which believes a level after 3 ticks."""
    return SafetyMonitor(Machine(SupervisorParameters.from_values({})))


@pytest.mark.requirement("S26")
@pytest.mark.parametrize(
    ("values", "level"),
    [
        ((905.0, 905.0, 911.0), "WARN"),
        ((905.0, 911.0, 911.0), "WARN"),
        ((911.0, 905.0, 911.0), "WARN"),
        ((905.0, 905.0, 911.0, 911.0, 905.0, 911.0), "WARN"),
        ((911.0, 911.0, 911.0), "TRIP"),
        ((905.0, 911.0, 911.0, 911.0), "TRIP"),
        ((911.0, 850.0, 911.0, 911.0), ""),
        ((905.0, 905.0, 850.0), ""),
    ],
)
def test_a_level_is_believed_after_as_many_values_at_it_or_worse(monitor, values, level):
    for value in values:
        monitor.watch({"temperature_c": value})
    assert monitor.active == ({"temperature_high": Severity[level]} if level else {})


@pytest.mark.requirement("S26")
def test_more_persistence_clears_no_trip(monitor):
    for _ in range(3):
        monitor.watch({"temperature_c": 911.0})
    monitor.configure(SupervisorParameters.from_values({"interlocks.persistence_s": 5.0}))
    monitor.watch({"temperature_c": 911.0})
    assert monitor.tripped == ("temperature_high",)


@pytest.mark.requirement("S26")
def test_a_trip_is_gone_after_as_many_values_without_it(monitor):
    values = (911.0, 911.0, 911.0, 850.0, 850.0, 911.0, 850.0, 850.0)
    for value in values:
        monitor.watch({"temperature_c": value})
    assert monitor.tripped == ("temperature_high",)
    monitor.watch({"temperature_c": 850.0})
    assert not monitor.active


@pytest.mark.requirement("S25")
def test_one_good_sample_frees_no_safe_stop(rig):
    rig.values["depth"] = 3.8
    rig.run(5)
    rig.values["depth"] = 3.6
    rig.run(1)
    assert not acknowledge(rig)[0]
    assert not ask(rig, "hold")[0]
    for tick in range(30):
        rig.values["depth"] = 3.8 if tick % 3 else 3.6
        assert not rig.run(1).arbiter.operator.acknowledge("operator")[0]


@pytest.mark.requirement("S2")
def test_a_good_sample_that_is_held_frees_no_safe_stop(rig):
    stop_by_heat(rig)
    rig.values["thermocouple"] = 905.0
    rig.run(1)
    rig.values["thermocouple"] = NAN
    rig.run(20)
    assert rig.arbiter.safety.tripped == ("temperature_high",)
    assert not acknowledge(rig)[0]


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("why", ["interlock", "operator"])
@pytest.mark.parametrize("drives", [True, False])
@pytest.mark.parametrize("lockstep", [False, True])
def test_restart_keeps_the_safe_stop(make_rig, why, drives, lockstep):
    """The controllers have seen whose command is in force.

    A cause that is still there needs no new samples to count.
    """
    rig = make_rig(lockstep=lockstep)
    for _ in range(15):
        rig.tick()
    if why == "operator":
        ask(rig, "safe_stop")
        rig.run(2)
    else:
        stop_by_heat(rig)
    rig.restart()
    if not drives:
        rig.drives = None
    sources = [decision.source for _ in range(20) for decision in rig.tick()]
    assert len(sources) >= 15
    assert set(sources) == {"safe_stop"}
    cool(rig)
    assert not ask(rig, "auto")[0], "latched"
    assert acknowledge(rig)[0]
    assert ask(rig, "auto")[0]
    assert rig.run(3).last.source == "decentral"


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("silent_ticks", [1, 2, 3])
def test_controllers_that_come_late_still_tell_a_new_supervisor_of_the_safe_stop(
    rig, silent_ticks
):
    """A controller's status comes just after its proposal; the first command waits for it."""
    ask(rig, "safe_stop")
    rig.run(2).restart()
    rig.silent = set(rig.names)
    before = [decision for _ in range(silent_ticks) for decision in rig.tick()]
    rig.silent.clear()
    assert not before
    assert [decision.source for decision in rig.tick()] in ([], ["safe_stop"])
    assert rig.run(3).last.source == "safe_stop"


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("proposing", [True, False])
def test_a_new_supervisor_that_finds_the_controllers_late_still_hears_of_the_safe_stop(
    rig, proposing
):
    """On a busy machine, their status is heard more than a second after the measurements, and after their proposals."""
    ask(rig, "safe_stop")
    rig.run(2).restart()
    tell = rig.arbiter.on_status
    rig.arbiter.on_status = lambda *args: []
    rig.silent = set() if proposing else set(rig.names)
    assert not [decision for _ in range(18) for decision in rig.tick()]
    rig.arbiter.on_status = tell
    rig.silent.clear()
    assert [decision.source for _ in range(5) for decision in rig.tick()] == ["safe_stop"] * 5


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("asked_for", ["", "manual"])
@pytest.mark.parametrize("gap_s", [0.4, 2.0])
def test_a_new_supervisor_listens_also_after_a_gap_before_its_first_command(rig, asked_for, gap_s):
    ask(rig, "safe_stop")
    rig.run(2).restart()
    rig.silent = set(rig.names)
    assert not rig.tick()
    rig.silent.clear()
    rig.now_s += gap_s
    rig.stamp_ns += round(gap_s * 1e9)
    ask(rig, asked_for)
    assert [decision.source for _ in range(5) for decision in rig.tick()] == ["safe_stop"] * 5


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("mode", ["manual", "hold"])
def test_what_is_asked_of_a_new_supervisor_before_it_has_heard_of_the_safe_stop_does_not_lead_out(
    rig, mode
):
    ask(rig, "safe_stop")
    rig.run(2).restart()
    ask(rig, mode)  # nothing is measured yet, so nobody has told anything
    assert rig.run(3).last.source == "safe_stop"
    assert not ask(rig, mode)[0]


@pytest.mark.requirement("S25")
def test_nobody_acknowledges_a_safe_stop_before_anything_is_measured(rig):
    ask(rig, "safe_stop")
    rig.run(2).restart()
    ask(rig, "safe_stop")
    ok, why = acknowledge(rig)
    assert not ok
    assert [cause.code for cause in why.data["causes"]] == ["nothing_measured"]
    assert rig.arbiter.operator.acknowledgement_blocked_by == ("nothing_measured",)
    rig.run(3)
    assert not ask(rig, "manual")[0]
    assert acknowledge(rig)[0]
    assert ask(rig, "manual")[0]


@pytest.mark.requirement("S25")
def test_a_safe_stop_seen_on_the_command_topic_before_the_first_command_goes_on(make_rig):
    rig = make_rig()
    rig.arbiter.on_command(1, "safe_stop", MANUAL)
    for _ in range(10):
        rig.tick()
    assert rig.last.source == "safe_stop"


def test_what_others_have_seen_stops_nothing_once_a_command_was_sent(rig):
    rig.arbiter.on_status("nmpc", (), False, rig.now_s, "safe_stop")
    rig.arbiter.on_command(1, "safe_stop", MANUAL)
    assert rig.run(5).last.source == "decentral"


@pytest.mark.requirement("S27")
@pytest.mark.parametrize("sensor", ["depth", "torque", "thermocouple"])
def test_a_blind_manual_mode_ends_in_a_safe_stop(make_rig, sensor):
    rig = make_rig(SupervisorParameters.from_values({"operator_hold_timeout_s": 2.0})).run(10)
    good = dict(rig.values)
    assert ask(rig, "manual")[0]
    rig.run(30)
    assert rig.last.source == "manual", "with valid sensors it lasts"
    for _ in range(2):
        rig.values[sensor] = NAN
        rig.run(20)
        rig.values.update(good)
        rig.run(10)
    assert rig.last.source == "manual", "the time restarts once all are valid"
    rig.values[sensor] = NAN
    rig.run(26)
    assert rig.last.source == "safe_stop"
    assert sensor in rig.arbiter.machine.reason.chain[1].sensors


def stop_blind(rig):
    """The operator stops a weld whose thermocouple shows nothing any more: nothing trips."""
    rig.values["thermocouple"] = NAN
    rig.run(10)
    ask(rig, "safe_stop")
    rig.run(3)
    assert not rig.arbiter.safety.tripped
    return rig


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("mode", OUT)
def test_a_blind_safe_stop_is_not_left(rig, mode):
    stop_blind(rig)
    ok, why = acknowledge(rig)
    assert (ok, why.code) == (False, "cause_unknown")
    assert why.data["causes"][0].data == {"sensor": "thermocouple", "flaw": "not finite"}
    assert not ask(rig, mode)[0]
    assert not rig.arbiter.machine.acknowledged
    cool(rig)
    assert acknowledge(rig)[0]
    assert ask(rig, mode)[0]


@pytest.mark.requirement("S25")
def test_a_sensor_that_becomes_invalid_voids_the_acknowledgement(rig):
    ask(rig, "safe_stop")
    rig.run(3)
    assert acknowledge(rig)[0]
    rig.values["depth"] = NAN
    rig.run(10)
    rig.values["depth"] = 2.66
    rig.run(10)
    assert not ask(rig, "manual")[0]
    assert rig.last.source == "safe_stop"
