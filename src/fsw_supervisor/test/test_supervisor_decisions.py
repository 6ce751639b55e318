"""When a tick is decided, from what the first command starts, and what is applied without the active controller."""

from dataclasses import replace

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_control.sensors import REQUIRED
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import ProposalInput

STEP_NS = 100_000_000


class Hand:
    """Hands the messages of a tick over one by one; times count from its begin."""

    def __init__(self, rig):
        self.rig, self.arbiter = rig, rig.arbiter
        rig.now_s += 0.1
        rig.stamp_ns += STEP_NS
        self.out = []

    def drives(self, after_s=0.0):
        self.wait(after_s)
        acting = self.arbiter.applied or self.rig.drives
        self.out += self.arbiter.on_drives(self.rig.stamp_ns, acting, self.rig.now_s + after_s)
        return self

    def samples(self, *names, after_s=0.0):
        self.wait(after_s)
        for name in names or REQUIRED:
            value = self.rig.values[name]
            self.out += self.arbiter.on_sample(
                name, self.rig.stamp_ns, value, self.rig.now_s + after_s
            )
        return self

    def proposal(self, name="decentral", after_s=0.001, **changes):
        self.wait(after_s)
        proposal = replace(self.rig.proposal(name), **changes)
        self.out += self.arbiter.on_proposal(name, proposal, self.rig.now_s + after_s)
        return self

    def status(self, name="decentral", after_s=0.001):
        self.wait(after_s)
        self.out += self.arbiter.on_status(name, (), False, self.rig.now_s + after_s)
        return self

    def wait(self, until_s):
        while (at_s := self.arbiter.wakeup_s) is not None and at_s <= self.rig.now_s + until_s:
            self.out += self.arbiter.on_time(at_s)
        return self

    @property
    def sources(self):
        return [decision.source for decision in self.out]


def in_lockstep(make_rig):
    """A rig in lockstep after the start, in which it is asked who was selected."""
    rig = make_rig(lockstep=True)
    for _ in range(10):
        rig.tick()
    return rig.run(10)


# ---------------------------------------------------------------- when a tick is decided


def test_a_tick_is_decided_once_all_sensors_and_the_active_proposal_are_there(rig):
    hand = Hand(rig).drives().samples("depth", "torque").proposal(after_s=0.002)
    assert hand.out == [], "the thermocouple may still come"
    assert hand.samples("thermocouple", after_s=0.004).sources == ["decentral"]
    assert hand.out[0].latency_s == pytest.approx(0.004)


def test_a_sensor_that_does_not_come_is_waited_for_no_longer_than_the_grace(rig):
    hand = Hand(rig).drives().samples("depth", "torque").proposal(after_s=0.002).wait(0.0099)
    assert hand.out == []
    assert hand.wait(0.0101).sources == ["decentral"]
    assert hand.out[0].latency_s == pytest.approx(rig.arbiter.settings.sensor_grace_s)


def test_a_sensor_that_is_known_to_be_lost_is_not_waited_for_once_the_proposal_is_there(rig):
    rig.tolerated = dict.fromkeys(rig.names, ("torque",))
    del rig.values["torque"]
    rig.run(6)
    hand = Hand(rig).drives().samples("depth", "thermocouple")
    assert hand.out == []
    assert hand.proposal(after_s=0.001).sources == ["decentral"]
    rig.values["torque"] = 1052.0
    hand = Hand(rig).drives().samples("depth").proposal(after_s=0.001)
    assert hand.out == [], "the thermocouple is not lost"


def test_after_the_grace_the_active_proposal_is_still_waited_for(rig):
    hand = Hand(rig).drives().samples("depth", "torque").wait(0.03)
    assert hand.out == []
    assert not rig.arbiter.ticks.present.judged, (
        "the thermocouple may be late, too, on a busy machine"
    )
    assert hand.proposal(after_s=0.04).sources == ["decentral"]


def test_a_mode_without_a_controller_waits_for_the_sensors_only(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.run(1)
    assert Hand(rig).drives().samples().sources == ["hold"]
    hand = Hand(rig).drives().samples("depth")
    assert hand.wait(0.0099).out == []
    assert hand.wait(0.0101).sources == ["hold"]


def test_in_lockstep_a_late_sample_is_waited_for_a_second(make_rig):
    rig = in_lockstep(make_rig)
    hand = Hand(rig).drives().samples("depth", "torque").proposal().proposal("nmpc").wait(0.99)
    assert hand.out == []
    assert hand.wait(1.01).sources == ["decentral"]


def test_in_lockstep_shadows_that_keep_up_are_waited_for_and_others_are_not(make_rig):
    rig = in_lockstep(make_rig)
    rig.arbiter.registry.join("never")
    hand = Hand(rig).drives().samples().proposal()
    assert hand.out == []
    assert hand.proposal("nmpc", after_s=0.4).sources == ["decentral"]
    hand = Hand(rig).drives().samples().proposal()
    assert hand.wait(0.499).out == []
    assert hand.wait(0.501).sources == ["decentral"]
    assert Hand(rig).drives().samples().proposal().sources == ["decentral"], (
        "nmpc has fallen silent"
    )


# ---------------------------------------------------------------- the first command


def started(make_rig, **values):
    """A rig whose drives report nothing, at its first tick."""
    rig = make_rig(SupervisorParameters.from_values(values))
    rig.drives = None
    return rig


def test_command_in_force_is_unknown_without_drives_and_controllers(make_rig):
    rig = started(make_rig)
    rig.names = []
    for _ in range(10):
        assert rig.tick() == []
    assert rig.arbiter.machine.reason.code is ReasonCode.COMMAND_UNKNOWN
    assert (rig.arbiter.ticks.commands, rig.arbiter.ticks.lost) == (0, 10)
    assert rig.arbiter.applied is None


def test_the_last_command_seen_of_the_supervisor_before_is_the_start(make_rig):
    rig = started(make_rig)
    rig.arbiter.on_command(1, "decentral", Command(84.0, 420.0))
    rig.arbiter.on_command(1, "decentral", Command(float("nan"), 420.0))
    rig.force_wish_kn = 84.0
    for name in rig.names:
        rig.spoil(name, command=Command(84.2, 420.0))
    for _ in range(5):
        rig.tick()
    first = next(tick[0] for tick in rig.ticks if tick)
    assert first.command == Command(84.2, 420.0)
    assert rig.facts("taking_over")[0] == {
        "force_kn": 84.0,
        "speed_rpm": 420.0,
        "origin": Fact.of(Code.FROM_COMMAND),
    }


def test_a_command_seen_is_no_start_once_a_command_has_been_sent(rig):
    rig.arbiter.on_command(1, "stranger", Command(62.0, 310.0))
    rig.now_s += 5.0
    rig.stamp_ns += 50 * STEP_NS
    rig.drives = None
    for _ in range(10):
        rig.tick()
    assert rig.last.command.force_kn == pytest.approx(78.4)


def test_a_first_proposal_that_is_refused_is_no_start(make_rig):
    rig = started(make_rig)
    rig.spoil("decentral", healthy=False, reason=Reason.of("not yet"))
    for _ in range(8):
        assert rig.tick() == []
    rig.edit.clear()
    rig.run(1)
    assert rig.facts("taking_over")[-1] == {
        "force_kn": 78.4,
        "speed_rpm": 407.5,
        "origin": Fact.of(Code.FROM_PROPOSAL, controller="decentral"),
    }


def test_the_operators_values_are_a_start_when_nothing_else_is_known(make_rig):
    rig = started(make_rig, first_report_wait_s=0.3)
    rig.names = []
    for _ in range(5):
        rig.tick()
    assert rig.arbiter.operator.ask_mode("manual", Command(70.0, 350.0), "operator")[0]
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("manual", Command(70.0, 350.0))
    assert rig.facts("taking_over")[-1]["origin"].code is Code.FROM_OPERATOR


def test_the_controllers_are_given_time_to_tell_who_was_selected(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"takeover_wait_s": 0.25, "first_report_wait_s": 0.0})
    )
    for _ in range(3):
        Hand(rig).drives().samples().proposal().wait(0.099)
    assert rig.arbiter.ticks.commands == 1
    assert rig.arbiter.machine.mode is Mode.AUTO
    assert rig.arbiter.ticks.lost == 2


def test_start_from_drives_beyond_the_limits_is_clipped(make_rig):
    rig = make_rig()
    rig.drives = Command(95.3, 200.0)
    rig.names = []
    for _ in range(25):
        rig.tick()
    limits = rig.arbiter.settings.drive_limits
    first = next(tick[0] for tick in rig.ticks if tick)
    assert first.command == Command(limits.force_max_kn, limits.speed_min_rpm)


@pytest.mark.parametrize(
    ("values", "patience"), [({"readmit_ticks": 8}, 8), ({"readmit_ticks": 3, "warm_ticks": 6}, 6)]
)
def test_a_fallback_replaces_the_configured_controller_after_so_many_good_proposals(
    make_rig, values, patience
):
    rig = make_rig(
        SupervisorParameters.from_values(
            values
            | {"takeover_wait_s": 0.0, "first_report_wait_s": 0.0, "fallbacks": ("nobody", "nmpc")}
        )
    )
    rig.names = ["nmpc"]
    rig.run(patience)
    assert rig.last.source == "hold"
    rig.run(1)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.machine.reason == Reason(ReasonCode.SUBSTITUTED, subject="decentral")
    assert rig.arbiter.machine.cause is Cause.READY


def test_at_a_start_a_sample_that_is_late_on_a_busy_machine_is_not_missing(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"takeover_wait_s": 0.0, "first_report_wait_s": 0.0})
    )
    hand = Hand(rig).drives().samples("depth", "torque").wait(0.03)
    hand.samples("thermocouple", after_s=0.04).proposal(after_s=0.05).status(after_s=0.05)
    assert hand.sources == ["decentral"]
    assert rig.arbiter.safety.invalid_sensors == ()
    assert rig.facts("sensor_invalid") == []


def test_a_fallback_that_does_not_cope_with_a_lost_sensor_is_passed_over_at_a_start(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"readmit_ticks": 6, "fallbacks": ("nmpc", "third")})
    )
    rig.names = ["nmpc", "third"]
    rig.tolerated = {"third": ("torque",)}
    del rig.values["torque"]
    for _ in range(12):
        rig.tick()
    assert rig.last.source == "third"
    assert [fact["reason"].subject for fact in rig.facts("failed")].count("nmpc") == 0


def test_previously_active_controller_is_awaited_for_some_ticks(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"warm_ticks": 4})).run(20)
    rig.silent.add("decentral")
    rig.now_s += 5.0
    rig.stamp_ns += 50 * STEP_NS
    rig.run(5)
    assert rig.last.source == "hold"
    assert rig.arbiter.machine.mode is Mode.START
    rig.run(1)
    assert rig.arbiter.machine.mode is not Mode.START
    rig.run(1)
    left = [
        fact for fact in rig.facts("mode") if (fact["before"], fact["mode"]) == ("start", "hold")
    ]
    abandoned = Reason(ReasonCode.ABANDONED, subject="decentral")
    assert [fact["reason"] for fact in left] == [abandoned]


def test_start_is_logged_with_its_reason(rig):
    machine = rig.arbiter.machine
    assert (machine.reason, machine.cause) == (
        Reason(ReasonCode.CONFIGURED, subject="decentral"),
        Cause.READY,
    )
    rig.now_s += 5.0
    rig.stamp_ns += 50 * STEP_NS
    rig.run(1)
    assert (machine.reason, machine.cause) == (
        Reason(ReasonCode.ACTIVE_BEFORE, subject="decentral"),
        Cause.READY,
    )


def test_a_wait_before_the_start_is_told_with_the_controller_that_is_waited_for(make_rig):
    rig = make_rig()
    rig.names = []
    for _ in range(25):
        rig.tick()
    waiting = Reason(
        ReasonCode.WAITING_FOR_CONTROLLER,
        subject="decentral",
        because=Reason(ReasonCode.NO_PROPOSAL_YET),
    )
    assert rig.arbiter.machine.reason == waiting
    rig.arbiter.registry.join("decentral")
    rig.run(3)
    assert rig.arbiter.registry.get("decentral").missed == 3, (
        "that it is waited for does not excuse its silence"
    )
    assert (rig.last.source, rig.last.reason) == ("hold", waiting.head)


@pytest.mark.requirement("S6")
def test_without_any_usable_controller_the_force_is_held_and_it_is_told_why(rig):
    rig.silent |= set(rig.names)
    rig.run(1)
    machine = rig.arbiter.machine
    codes = [item.code for item in machine.reason.chain]
    assert codes == [ReasonCode.NO_FALLBACK, ReasonCode.FAILED, ReasonCode.NO_PROPOSAL]
    assert (machine.cause, rig.last.reason) == (Cause.NO_CONTROLLER, machine.reason.head)
    assert {"reason": machine.reason.because} in rig.facts("failed")


# ---------------------------------------------------------------- the active controller fails


@pytest.mark.requirement("S6")
def test_a_measurement_cut_short_is_an_excuse_for_one_tick_only(rig):
    rig.tolerated = dict.fromkeys(rig.names, REQUIRED)
    rig.run(2)
    rig.silent.add("decentral")
    del rig.values["torque"]
    rig.run(1)
    assert rig.last.source == "hold"
    assert rig.last.reason == Reason(ReasonCode.INCOMPLETE, ("torque",))
    assert rig.arbiter.registry.get("decentral").inhibited == Reason()
    del rig.values["depth"]
    rig.run(1)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.registry.get("decentral").inhibited.code is ReasonCode.NO_PROPOSAL


def test_a_later_measurement_cut_short_is_an_excuse_again(rig):
    rig.tolerated = dict.fromkeys(rig.names, REQUIRED)
    rig.run(2)
    rig.silent.add("decentral")
    del rig.values["torque"]
    rig.run(1)
    rig.silent.clear()
    rig.run(1)
    rig.silent.add("decentral")
    del rig.values["depth"]
    rig.run(1)
    assert rig.last.reason == Reason(ReasonCode.INCOMPLETE, ("depth",))
    rig.silent.clear()
    rig.run(1)
    record = rig.arbiter.registry.get("decentral")
    assert (record.missed, record.problem) == (0, Reason())


@pytest.mark.parametrize("blind", [True, False])
def test_blind_controller_is_replaced_but_not_inhibited(rig, blind):
    rig.tolerated = {"nmpc": REQUIRED, "decentral": () if blind else REQUIRED}
    rig.run(1)
    rig.values["torque"] = float("nan")
    rig.run(10)
    assert rig.last.source == ("nmpc" if blind else "decentral")
    assert rig.arbiter.registry.get("decentral").inhibited == Reason()
    if blind:
        required = Reason(ReasonCode.SENSOR_REQUIRED, ("torque",))
        assert rig.arbiter.machine.reason == Reason(
            ReasonCode.FAILED, subject="decentral", because=required
        )


@pytest.mark.requirement("S6")
def test_a_fallback_that_refuses_or_is_missing_is_passed_over(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"fallbacks": ("nmpc", "third")}))
    rig.names = ["decentral", "nmpc", "third"]
    rig.run(10)
    rig.spoil("decentral", healthy=False, reason=Reason.of("x"))
    rig.spoil("nmpc", healthy=False, reason=Reason.of("y"))
    rig.run(1)
    assert rig.last.source == "third"


@pytest.mark.requirement("S6")
def test_a_fallback_is_waited_for_until_the_deadline(rig):
    hand = Hand(rig).drives().samples().proposal(healthy=False, reason=Reason.of("x"))
    assert hand.wait(0.05).out == []
    assert hand.proposal("nmpc", after_s=0.06).sources == ["nmpc"]


def test_in_lockstep_a_fallback_has_the_time_that_the_active_one_had(make_rig):
    rig = in_lockstep(make_rig)
    hand = Hand(rig).drives().samples()
    assert hand.wait(2.99).out == []
    assert hand.wait(3.01).sources == ["hold"]


def test_in_lockstep_a_supervisor_that_was_held_up_itself_gives_no_more_time(make_rig):
    rig = in_lockstep(make_rig)
    hand = Hand(rig).drives().samples()
    assert rig.arbiter.on_time(rig.now_s + 9.0) == []
    assert hand.proposal(after_s=9.001, healthy=False, reason=Reason.of("x")).out == []
    assert hand.wait(9.74).out == []
    assert hand.wait(9.76).sources == ["hold"]


def test_a_swap_storm_ends_when_the_swaps_are_long_ago(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values(
            {"storm_swaps": 1, "storm_window_s": 3.0, "warm_ticks": 1}
        )
    ).run(5)
    rig.spoil("decentral", healthy=False, reason=Reason.of("x"))
    rig.run(1)
    assert rig.last.source == "nmpc"
    rig.edit.clear()
    rig.arbiter.registry.readmit_all("operator")
    rig.run(3)
    rig.spoil("nmpc", healthy=False, reason=Reason.of("x"))
    rig.run(1)
    assert rig.last.source == "hold"
    storm, failed, own = rig.arbiter.machine.reason.chain
    assert (storm.code, storm.limit_s) == (ReasonCode.STORM, 3.0)
    assert (failed.code, failed.subject, own) == (ReasonCode.FAILED, "nmpc", Reason.of("x"))
    assert rig.arbiter.machine.cause is Cause.STORM
    rig.edit.clear()
    rig.run(25)
    assert rig.last.source == "hold"
    rig.run(2)
    assert rig.last.source == "decentral"


# ---------------------------------------------------------------- after a swap, and without a controller


@pytest.mark.requirement("S12")
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_after_a_swap_force_and_speed_slew_to_the_new_controllers_values(make_rig, sign):
    settings = SupervisorParameters.from_values(
        {
            "force_transition_kn": 0.2,
            "speed_transition_rpm": 0.5,
            "transition_ticks": 4,
            "warm_ticks": 2,
        }
    )
    rig = make_rig(settings).run(30)
    requested = Command(78.4 + sign * 0.3, 407.5 + sign * 1.2)
    rig.spoil("nmpc", command=requested)
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.command.force_kn == pytest.approx(78.4 + sign * 0.2)
    assert rig.last.command.speed_rpm == pytest.approx(407.5 + sign * 0.5)
    rig.run(1)
    assert rig.last.command.force_kn == pytest.approx(requested.force_kn)
    assert rig.last.command.speed_rpm == pytest.approx(407.5 + sign * 1.0)
    rig.run(1)
    assert (rig.last.command, rig.last.reason) == (requested, Reason())
    rig.spoil("nmpc", command=Command(requested.force_kn + 0.9, requested.speed_rpm))
    rig.run(1)
    assert rig.last.command.force_kn == pytest.approx(requested.force_kn + 0.9), (
        "it has arrived: the limits are over"
    )


@pytest.mark.requirement("S12")
def test_the_slew_after_a_swap_ends_after_so_many_ticks(make_rig):
    settings = SupervisorParameters.from_values(
        {"force_transition_kn": 0.1, "transition_ticks": 3}
    )
    rig = make_rig(settings).run(30)
    rig.edit["nmpc"] = lambda p: ProposalInput(
        p.stamp_ns,
        p.source,
        Command((rig.arbiter.applied or p.command).force_kn + 0.9, p.command.speed_rpm),
    )
    rig.silent.add("decentral")
    steps = []
    for _ in range(5):
        before = rig.arbiter.applied.force_kn
        rig.run(1)
        steps.append(rig.last.command.force_kn - before)
    assert steps == pytest.approx([0.1, 0.1, 0.1, 0.9, 0.9])


@pytest.mark.requirement("S3")
@pytest.mark.parametrize(
    ("force_kn", "after"), [(66.0, [65.8, 65.6, 65.4, 65.2, 65.0, 65.0]), (63.0, [63.0] * 6)]
)
def test_a_safe_stop_ramps_down_to_the_safe_force_and_never_up(make_rig, force_kn, after):
    rig = make_rig()
    rig.drives = Command(force_kn, 400.0)
    rig.force_wish_kn = force_kn
    rig.run(10)
    rig.arbiter.operator.ask_mode("safe_stop", None, "operator")
    forces = []
    for _ in after:
        rig.run(1)
        forces.append(rig.last.command.force_kn)
        assert rig.last.command.speed_rpm == 400.0
    assert forces == pytest.approx(after)
