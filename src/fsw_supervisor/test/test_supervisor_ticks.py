"""Ticks one by one.

Gaps, time-outs, what is counted, and what a standby takes over from the leader.
"""

from math import isnan

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.parameters import defaults
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor import ticks
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import Decision, ProposalInput

SECOND_NS = 1_000_000_000
STEP_NS = SECOND_NS // 10


def samples(rig, stamp_ns, now_s):
    """All sensors at a stamp; returns what is decided."""
    return [
        decision
        for sensor, value in rig.values.items()
        for decision in rig.arbiter.on_sample(sensor, stamp_ns, value, now_s)
    ]


# ---------------------------------------------------------------- settings


def test_new_settings_hold_from_the_next_tick_on(rig):
    changed = {"storm_swaps": 0, "interlocks.temperature_high.trip": 905.0}
    rig.arbiter.configure(SupervisorParameters.from_values(changed))
    assert rig.arbiter.settings.storm_swaps == 0
    for rig.values["thermocouple"] in (880.0, 906.0):
        rig.run(10)
    assert rig.arbiter.safety.tripped == ("temperature_high",)
    assert rig.last.source == "safe_stop"


# ---------------------------------------------------------------- samples


def test_an_optional_sensor_begins_no_tick_and_enters_the_one_it_belongs_to(leader, monkeypatch):
    monkeypatch.setattr(ticks, "OPTIONAL", ("lvdt",))
    now, ahead_ns = leader.arbiter.ticks, leader.stamp_ns + STEP_NS
    now.on_stamp("lvdt", ahead_ns, 2.7, leader.now_s)
    assert now.present.stamp_ns == leader.stamp_ns and "lvdt" not in now.present.samples
    now.on_stamp("depth", ahead_ns, 2.66, leader.now_s)
    assert now.present.stamp_ns == ahead_ns and now.present.samples == {"lvdt": 2.7, "depth": 2.66}


def test_a_depth_that_is_not_known_leads_to_a_safe_stop(rig):
    """Its standard deviation counts in the tick of its sample only, and clears the trip again."""
    rig.run(20)
    trip_mm = defaults(SupervisorParameters)["interlocks.depth_deviation_high.trip"]
    for deviation_mm, tripped in ((trip_mm + 0.01, ("depth_deviation_high",)), (0.02, ())):
        for _ in range(4):
            ahead_ns = rig.stamp_ns + STEP_NS
            rig.arbiter.on_depth_deviation(ahead_ns, deviation_mm)
            rig.run(1)
            assert rig.arbiter.ticks.present.depth_deviation_mm == deviation_mm
        assert rig.arbiter.safety.tripped == tripped
    assert rig.last.source == "safe_stop"
    rig.run(1)
    assert isnan(rig.arbiter.ticks.present.depth_deviation_mm)


def test_a_depth_that_comes_twice_counts_with_the_deviation_of_the_first(rig):
    rig.run(20)
    ahead_ns = rig.stamp_ns + STEP_NS
    for depth_mm, deviation_mm in ((2.66, 0.4), (2.71, 0.02)):
        rig.arbiter.on_depth_deviation(ahead_ns, deviation_mm)
        rig.arbiter.on_sample("depth", ahead_ns, depth_mm, rig.now_s)
    present = rig.arbiter.ticks.present
    assert (present.samples["depth"], present.depth_deviation_mm) == (2.66, 0.4)


# ---------------------------------------------------------------- gaps


@pytest.mark.parametrize("lockstep", [False, True])
def test_missing_measurements_are_logged_once(make_rig, lockstep):
    rig = make_rig(lockstep=lockstep)
    for _ in range(15):
        rig.tick()
    begun_s = rig.arbiter.ticks.present.started_s
    rig.arbiter.on_time(begun_s + 0.95)
    assert rig.arbiter.ticks.measuring
    for after_s in (1.05, 2.0, 3.0):
        rig.arbiter.on_time(begun_s + after_s)
    assert rig.arbiter.ticks.measuring == lockstep
    assert rig.facts("no_measurement") == [{"limit_s": 1.0}] * (not lockstep)
    assert rig.arbiter.ticks.stalls == 0, "it was not held up itself"
    rig.now_s += 5.0
    rig.tick()
    assert rig.arbiter.ticks.measuring


def test_before_the_first_measurement_nothing_is_measured_or_waited_for():
    arbiter = Arbiter(SupervisorParameters.from_values({}))
    assert arbiter.on_time(50.0) == []
    assert not arbiter.ticks.measuring
    assert arbiter.wakeup_s is None
    assert (arbiter.ticks.stalls, list(arbiter.machine.events)) == (0, [])


@pytest.mark.parametrize("gap_s", [0.9, 1.1])
def test_after_more_than_a_second_what_is_applied_is_found_out_again(rig, gap_s):
    rig.now_s += gap_s - 0.1
    rig.stamp_ns += round((gap_s - 0.1) * 10) * STEP_NS
    rig.run(1)
    assert bool(rig.facts("gap")) == (gap_s > 1.0)
    assert rig.arbiter.machine.mode is Mode.AUTO


@pytest.mark.requirement("S12")
def test_after_a_gap_a_proposal_is_held_against_what_acts_then(rig):
    """It may come before the drives' feedback, and is no jump from what acted before the gap."""
    arbiter = rig.arbiter
    rig.now_s += 5.0
    rig.stamp_ns += 5 * SECOND_NS
    acting = Command(73.0, 407.5)
    out = arbiter.on_sample("depth", rig.stamp_ns, rig.values["depth"], rig.now_s)
    assert arbiter.machine.mode is Mode.START
    assert (arbiter.machine.reason, arbiter.machine.cause) == (
        Reason(ReasonCode.GAP),
        Cause.INTERRUPTED,
    )
    for name in rig.names:
        out += arbiter.on_proposal(name, ProposalInput(rig.stamp_ns, name, acting), rig.now_s)
    out += arbiter.on_drives(rig.stamp_ns, acting, rig.now_s)
    out += samples(rig, rig.stamp_ns, rig.now_s)
    assert [(decision.source, decision.command) for decision in out] == [("decentral", acting)]


def test_each_tick_in_which_a_gap_begins_is_lost(rig):
    lost = rig.arbiter.ticks.lost
    for count in range(4):
        assert rig.arbiter.on_sample("depth", rig.stamp_ns, 2.66, rig.now_s) == []
        assert rig.arbiter.ticks.lost == lost + max(0, count - 1)
        rig.now_s += 5.0
        rig.stamp_ns += 5 * SECOND_NS


def test_a_tick_that_is_not_decided_when_the_next_one_begins_is_decided_then(rig):
    arbiter, commands = rig.arbiter, rig.arbiter.ticks.commands
    rig.now_s += 0.1
    out = [
        sample
        for ahead in (1, 2)
        for sample in samples(rig, rig.stamp_ns + ahead * STEP_NS, rig.now_s)
    ]
    assert out == [arbiter.ticks.last]
    assert arbiter.ticks.commands == commands + 1
    assert arbiter.ticks.last.stamp_ns == rig.stamp_ns + STEP_NS
    assert arbiter.ticks.last.source == "hold"
    assert arbiter.ticks.last.reason == Reason(ReasonCode.STALLED)


@pytest.mark.parametrize("held_up_s", [0.12, 0.14])
def test_a_hold_up_of_more_than_the_tolerance_gives_the_queues_time_to_drain(rig, held_up_s):
    """The deadline is 80 ms after the measurement, the tolerance 50 ms."""
    rig.silent.add("decentral")
    rig.now_s += 0.1
    rig.stamp_ns += STEP_NS
    samples(rig, rig.stamp_ns, rig.now_s)
    rig.arbiter.on_drives(rig.stamp_ns, rig.arbiter.applied, rig.now_s)
    rig.arbiter.on_proposal("nmpc", rig.proposal("nmpc"), rig.now_s)
    out = rig.arbiter.on_time(rig.now_s + held_up_s)
    if held_up_s < 0.13:
        assert ([decision.source for decision in out], rig.arbiter.ticks.stalls) == (["nmpc"], 0)
        return
    assert (out, rig.arbiter.ticks.stalls) == ([], 1)
    assert rig.facts("stalled") == [{"time_s": pytest.approx(0.14)}]
    assert rig.arbiter.wakeup_s == pytest.approx(rig.now_s + held_up_s + 0.025)
    out = rig.arbiter.on_time(rig.arbiter.wakeup_s)
    assert [(decision.source, decision.reason.code) for decision in out] == [
        ("hold", ReasonCode.STALLED)
    ]
    assert rig.arbiter.ticks.stalls == 1


def test_it_is_woken_at_the_end_of_the_grace_and_at_the_deadline(rig):
    rig.now_s += 0.1
    rig.stamp_ns += STEP_NS
    rig.arbiter.on_sample("depth", rig.stamp_ns, 2.66, rig.now_s)
    assert rig.arbiter.wakeup_s == pytest.approx(rig.now_s + 0.01)
    rig.arbiter.on_time(rig.now_s + 0.01)
    assert rig.arbiter.wakeup_s == pytest.approx(rig.now_s + 0.08)
    samples(rig, rig.stamp_ns, rig.now_s + 0.02)
    assert rig.arbiter.wakeup_s == pytest.approx(rig.now_s + 0.08)
    assert len(rig.arbiter.on_time(rig.now_s + 0.08)) == 1
    assert rig.arbiter.wakeup_s is None


def test_in_lockstep_it_is_woken_for_the_shadows_and_at_the_start_for_the_controllers(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"takeover_wait_s": 0.2, "first_report_wait_s": 0.0}),
        lockstep=True,
    )
    begun_s, woken = rig.now_s, []
    rig.arbiter.on_drives(rig.stamp_ns, rig.drives, begun_s)
    samples(rig, rig.stamp_ns, begun_s)
    while (at_s := rig.arbiter.wakeup_s) is not None:
        woken.append(at_s - begun_s)
        rig.arbiter.on_time(at_s)
    assert woken == pytest.approx([0.2, 0.5, 1.5])


# ---------------------------------------------------------------- time-outs


@pytest.mark.requirement("S27")
@pytest.mark.parametrize("mode", ["hold", "manual", "start", "abandoned"])
def test_time_outs_are_logged_with_mode_and_reason(make_rig, mode):
    values = {
        "start_timeout_s": 3.0,
        "hold_timeout_s": 2.0,
        "operator_hold_timeout_s": 4.0,
        "takeover_wait_s": 0.0,
        "first_report_wait_s": 0.0,
    }
    rig = make_rig(SupervisorParameters.from_values(values))
    desk, machine = rig.arbiter.operator, rig.arbiter.machine
    if mode == "start":
        rig.names = []
        ticks, limit_s, why = (
            29,
            3.0,
            [ReasonCode.WAITING_FOR_CONTROLLER, ReasonCode.NO_PROPOSAL_YET],
        )
    else:
        rig.run(10)
        if mode == "hold":
            desk.ask_mode("hold", None, "operator")
            ticks, limit_s, why = 39, 4.0, [ReasonCode.REQUESTED]
        elif mode == "manual":
            desk.ask_mode("manual", Command(78.4, 407.5), "operator")
            rig.values["depth"] = float("nan")
            rig.run(5)
            assert (machine.time_ns - rig.arbiter.safety.blind_since_ns) / 1e9 == pytest.approx(
                0.1
            )
            ticks, limit_s, why = 38, 4.0, [ReasonCode.INVALID_SENSOR]
        else:
            rig.silent |= set(rig.names)
            rig.run(1)
            assert machine.mode is Mode.HOLD
            ticks, limit_s, why = (
                19,
                2.0,
                [ReasonCode.NO_FALLBACK, ReasonCode.FAILED, ReasonCode.NO_PROPOSAL],
            )
    before = str(machine.mode)
    for _ in range(ticks):
        rig.tick()
        assert machine.mode is not Mode.SAFE_STOP
    rig.tick()
    assert machine.mode is Mode.SAFE_STOP
    assert machine.reason.head == Reason(ReasonCode.TIMEOUT, limit_s=limit_s, subject=before)
    assert [item.code for item in machine.reason.chain[1:]] == why
    assert machine.cause in (Cause.HOLD_TIMEOUT, Cause.START_TIMEOUT, Cause.BLIND_TIMEOUT)


def test_auto_never_times_out(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"hold_timeout_s": 1.0, "start_timeout_s": 1.0})
    ).run(50)
    assert rig.last.source == "decentral"


# ---------------------------------------------------------------- back in control by itself


def test_hold_ends_with_the_configured_controller_first_and_it_is_told(rig):
    rig.silent |= set(rig.names)
    rig.run(2)
    rig.silent.clear()
    rig.arbiter.registry.readmit_all("operator")
    rig.run(7)
    assert rig.last.source == "decentral"
    assert (rig.arbiter.machine.reason, rig.arbiter.machine.cause) == (
        Reason(ReasonCode.READY_AGAIN, subject="decentral"),
        Cause.CONTROLLER_BACK,
    )


def test_a_hold_of_the_operator_is_not_ended_by_a_controller_that_is_ready(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.run(30)
    assert rig.last.source == "hold"


@pytest.mark.parametrize("why", ["storm", "request", "not ready", "not asked for"])
def test_the_target_is_not_returned_to_while_something_speaks_against_it(make_rig, why):
    values = {
        "return_to_target": why != "not asked for",
        "readmit_ticks": 3,
        "warm_ticks": 2,
        "storm_window_s": 5.0,
    }
    rig = make_rig(
        SupervisorParameters.from_values(values | {"storm_swaps": 1 if why == "storm" else 0})
    )
    rig.names.append("third")
    rig.run(10)
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.source == "nmpc"
    if why != "not ready":
        rig.silent.clear()
    if why == "request":
        rig.silent.add("third")
        rig.run(2)
        rig.arbiter.operator.ask_switch("third", False, 3.0, "operator", rig.now_s)
    rig.run(20)
    assert rig.last.source == "nmpc"
    rig.silent.clear()
    rig.run(60)
    assert rig.last.source == {"not asked for": "nmpc", "request": "third"}.get(why, "decentral")


def test_the_return_to_the_target_is_told_and_counts_as_an_automatic_swap(make_rig):
    values = {"return_to_target": True, "readmit_ticks": 3, "warm_ticks": 2, "storm_swaps": 2}
    rig = make_rig(SupervisorParameters.from_values(values)).run(10)
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(5)
    assert rig.last.source == "decentral"
    assert rig.arbiter.machine.reason == Reason(ReasonCode.READY_AGAIN, subject="decentral")
    assert rig.arbiter.machine.cause is Cause.SWAP_BACK
    assert rig.arbiter.machine.storming()


# ---------------------------------------------------------------- what the plant asks for again


def test_in_lockstep_a_measurement_that_is_sent_again_is_answered_again_by_the_leader_only(
    make_rig,
):
    rig = make_rig(lockstep=True)
    for _ in range(15):
        rig.tick()
    arbiter, last = rig.arbiter, rig.arbiter.ticks.last
    assert arbiter.on_drives(rig.stamp_ns, rig.drives, rig.now_s) == [last]
    assert arbiter.on_command(last.stamp_ns, last.source, last.command), "it is an own command"
    arbiter.ticks.leading = False
    assert arbiter.on_drives(rig.stamp_ns, rig.drives, rig.now_s) == []


def test_in_real_time_no_measurement_is_answered_twice(rig):
    assert rig.arbiter.on_drives(rig.stamp_ns, rig.drives, rig.now_s) == []


def test_in_lockstep_a_measurement_that_is_not_answered_yet_is_answered_once(make_rig):
    rig = make_rig(lockstep=True)
    for _ in range(15):
        rig.tick()
    stamp_ns = rig.stamp_ns + STEP_NS
    for _ in range(2):
        assert rig.arbiter.on_drives(stamp_ns, rig.drives, rig.now_s) == []


# ---------------------------------------------------------------- standby


@pytest.fixture
def standby():
    """A standby before its first measurement."""
    arbiter = Arbiter(SupervisorParameters.from_values({}))
    arbiter.ticks.leading = False
    return arbiter


def test_a_standby_knows_what_the_leader_has_commanded_last(standby):
    standby.follow(STEP_NS, "nmpc", Command(200.0, 400.0))
    limited = Command(standby.settings.drive_limits.force_max_kn, 400.0)
    assert standby.ticks.last == Decision(STEP_NS, limited, "nmpc")
    assert standby.applied == limited
    assert (standby.machine.mode, standby.machine.active) == (Mode.AUTO, "nmpc")
    assert standby.ticks.commands == 0


def test_an_answer_to_the_present_tick_settles_it_and_an_older_one_is_what_it_starts_from(standby):
    standby.on_drives(10**12, Command(80.0, 410.0), 50.0)
    standby.follow(10**12 - STEP_NS, "nmpc", Command(80.5, 410.0))
    assert (standby.ticks.present.answered, standby.ticks.present.previous) == (
        False,
        Command(80.5, 410.0),
    )
    standby.follow(10**12, "nmpc", Command(81.0, 410.0))
    assert (standby.ticks.present.answered, standby.ticks.present.previous) == (
        True,
        Command(80.5, 410.0),
    )
    assert standby.wakeup_s is not None, "what the leader decided is still checked"


def test_in_lockstep_a_standby_gives_slow_controllers_as_much_time_as_the_leader():
    arbiter = Arbiter(SupervisorParameters.from_values({}), lockstep=True)
    arbiter.ticks.leading = False
    arbiter.on_drives(10**12, Command(80.0, 410.0), 50.0)
    for sensor, value in {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}.items():
        arbiter.on_sample(sensor, 10**12, value, 50.0)
    assert arbiter.ticks.present.deadline_s == pytest.approx(
        50.0 + arbiter.settings.takeover_s(lockstep=True)
    )
    arbiter.on_time(52.9)
    assert not arbiter.ticks.present.settled
    arbiter.on_proposal(
        "decentral", ProposalInput(10**12, "decentral", Command(80.5, 410.0)), 52.95
    )
    arbiter.on_time(53.0)
    assert [decision.source for decision in arbiter.lead(2)] == ["decentral"]


@pytest.mark.parametrize(
    ("mode", "wanted"), [("hold", "hold"), ("start", "auto"), ("nonsense", "auto")]
)
def test_a_standby_takes_over_only_modes_that_an_operator_can_ask_for(standby, mode, wanted):
    standby.registry.join("nmpc")
    standby.follow_operator("nmpc", mode, {"nmpc": Reason.of("it failed there")})
    assert (standby.machine.target, standby.machine.target_mode) == ("nmpc", wanted)
    assert standby.registry.get("nmpc").inhibited == Reason.of("it failed there")


@pytest.mark.requirement("S12")
def test_a_former_leader_in_manual_goes_on_with_what_the_leader_after_it_has_commanded(rig):
    arbiter = rig.arbiter
    arbiter.operator.ask_mode("manual", Command(79.0, 407.5), "operator")
    rig.run(5)
    arbiter.step_down()
    for ahead in range(1, 4):
        stamp_ns = rig.stamp_ns + ahead * STEP_NS
        arbiter.on_drives(stamp_ns, Command(75.0, 400.0), rig.now_s + 0.1 * ahead)
        arbiter.follow(stamp_ns, "manual", Command(75.0, 400.0))
    rig.now_s, rig.stamp_ns = rig.now_s + 0.3, stamp_ns
    arbiter.lead(2)
    rig.run(5)
    assert (rig.last.source, rig.last.command) == ("manual", Command(75.0, 400.0))


def test_who_steps_down_refuses_what_the_operator_waits_for_and_sends_nothing(rig):
    rig.silent.add("nmpc")
    rig.run(2)
    request = rig.arbiter.operator.ask_switch("nmpc", False, 5.0, "operator", rig.now_s)
    rig.arbiter.step_down()
    assert request.done and not request.ok
    assert rig.arbiter.applied is None
    assert rig.tick() == []


def test_a_standby_that_takes_over_with_a_controller_that_it_has_never_seen_falls_back(rig):
    arbiter = rig.arbiter
    arbiter.step_down()
    arbiter.follow(rig.stamp_ns, "exotic", Command(78.4, 407.5))
    arbiter.lead(2)
    rig.run(1)
    assert rig.last.source == "decentral"
    unknown = Reason(ReasonCode.UNKNOWN_CONTROLLER)
    assert rig.facts("failed") == [
        {"reason": Reason(ReasonCode.FAILED, subject="exotic", because=unknown)}
    ]


@pytest.mark.requirement("S25")
def test_earlier_safe_stop_is_reported_after_a_restart(make_rig):
    arbiter = make_rig().arbiter
    arbiter.on_source("hold")
    assert arbiter.machine.mode is Mode.START
    arbiter.on_source("safe_stop")
    assert arbiter.machine.mode is Mode.SAFE_STOP
    assert arbiter.machine.cause is Cause.RESTARTED
    assert arbiter.machine.reason.code is ReasonCode.STOPPED_BEFORE
