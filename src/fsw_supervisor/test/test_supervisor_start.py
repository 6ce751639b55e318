"""Start, restart in mid-weld, gaps, jumps of the clock and own hold-ups."""

import pytest

from fsw_control.contract import Command
from fsw_control.fence import ActuatorState
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import ProposalInput

SECOND_NS = 1_000_000_000


@pytest.mark.requirement("S9")
def test_a_restart_goes_on_with_the_controller_that_was_active(make_rig):
    rig = make_rig()
    rig.drives = Command(83.0, 420.0)
    rig.force_wish_kn = 84.0
    name = {"nmpc": True}

    arbiter, tick = rig.arbiter, rig.stamp_ns
    for count in range(2):
        tick += SECOND_NS // 10
        now_s = 100.0 + 0.1 * count
        out = arbiter.on_drives(tick, rig.drives, now_s)
        for sensor, value in rig.values.items():
            out += arbiter.on_sample(sensor, tick, value, now_s)
        for other in ("decentral", "nmpc"):
            out += arbiter.on_proposal(
                other, ProposalInput(tick, other, Command(83.2, 420.0)), now_s + 0.004
            )
            out += arbiter.on_status(other, (), name.get(other, False), now_s + 0.005)
        out += arbiter.on_time(now_s + 0.08)
        assert [decision.source for decision in out] == ["nmpc"]
        name.clear()
    assert arbiter.machine.target == "nmpc"
    assert arbiter.machine.reason == Reason(ReasonCode.ACTIVE_BEFORE, subject="nmpc")
    assert out[-1].command.force_kn == pytest.approx(83.2)


@pytest.mark.requirement("S9")
def test_a_restart_waits_for_the_controller_that_acts_and_has_not_been_found_yet(make_rig):
    """Discovery of its topics may take longer than that of the configured one's."""
    rig = make_rig()
    rig.drives = Command(83.0, 420.0)
    arbiter, tick, sources = rig.arbiter, rig.stamp_ns, []
    for count in range(6):
        tick += SECOND_NS // 10
        now_s = 100.0 + 0.1 * count
        arbiter.on_actuator(
            ActuatorState(1, "before", min(count, 3), "nmpc", answered_ns=rig.stamp_ns)
        )
        out = arbiter.on_drives(tick, rig.drives, now_s)
        for sensor, value in rig.values.items():
            out += arbiter.on_sample(sensor, tick, value, now_s)
        for other in ("decentral", "nmpc")[: 1 + (count > 3)]:
            out += arbiter.on_proposal(
                other, ProposalInput(tick, other, Command(83.2, 420.0)), now_s + 0.004
            )
            out += arbiter.on_status(other, (), False, now_s + 0.005)
        out += arbiter.on_time(now_s + 0.08)
        sources += [decision.source for decision in out]
    assert set(sources) == {"hold", "nmpc"} and sources[-1] == "nmpc"


@pytest.mark.requirement("S12")
def test_the_first_command_starts_from_what_the_drives_say(make_rig):
    rig = make_rig()
    rig.drives = Command(70.0, 350.0)
    rig.edit["decentral"] = lambda p: ProposalInput(p.stamp_ns, p.source, Command(90.0, 450.0))
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("hold", Command(70.0, 350.0))
    rig.edit.clear()
    rig.run(1)
    assert rig.last.source == "decentral"


def test_without_drives_feedback_the_first_proposal_is_the_start(make_rig):
    rig = make_rig()
    rig.drives = None
    for _ in range(5):
        rig.tick()
    assert rig.arbiter.machine.mode is Mode.AUTO
    assert rig.arbiter.ticks.lost <= 4
    assert rig.last.command.force_kn == pytest.approx(78.4)


@pytest.mark.requirement("S7")
def test_without_any_controller_it_holds_and_waits(make_rig):
    rig = make_rig()
    rig.names = []
    for _ in range(120):
        rig.tick()
    assert (rig.last.source, rig.arbiter.machine.mode) == ("hold", Mode.START)
    assert rig.arbiter.ticks.lost <= 21
    rig.names = ["decentral"]
    rig.run(1)
    assert rig.last.source == "decentral"


def test_an_unhealthy_configured_controller_is_waited_for(make_rig):
    rig = make_rig()
    rig.spoil("decentral", healthy=False, reason=Reason.of("no set-point yet"))
    rig.names = ["decentral"]
    for _ in range(20):
        rig.tick()
    assert rig.last.source == "hold"
    waiting, own = rig.arbiter.machine.reason.chain
    assert waiting == Reason(ReasonCode.WAITING_FOR_CONTROLLER, subject="decentral")
    assert (own, rig.last.reason) == (Reason.of("no set-point yet"), waiting), (
        "which is what an operator sees"
    )
    rig.edit.clear()
    rig.run(1)
    assert rig.last.source == "decentral"


def test_a_patient_fallback_takes_over_when_the_configured_one_never_comes(make_rig):
    rig = make_rig()
    rig.names = ["nmpc"]
    for _ in range(rig.arbiter.settings.readmit_ticks + 5):
        rig.tick()
    assert rig.last.source == "nmpc"
    assert rig.arbiter.machine.target == "decentral"


def test_a_restart_whose_controller_is_gone_holds_then_takes_the_fallback(make_rig):
    rig = make_rig()
    rig.arbiter.registry.join("decentral")
    rig.arbiter.on_status("decentral", (), True, rig.now_s)
    rig.names = ["nmpc"]
    for _ in range(4):
        rig.tick()
    assert rig.last.source == "hold"
    rig.run(4)
    assert Reason(ReasonCode.ABANDONED, subject="decentral") in [
        fact["reason"] for fact in rig.facts("mode")
    ]
    assert rig.last.source == "nmpc"


@pytest.mark.requirement("S12")
def test_after_a_gap_it_starts_from_what_acts_then(rig):
    rig.now_s += 5.0
    rig.stamp_ns += 5 * SECOND_NS
    rig.arbiter.on_time(rig.now_s)
    assert not rig.arbiter.ticks.measuring
    before = rig.arbiter.applied
    acting = Command(before.force_kn - 4.0, before.speed_rpm)
    rig.stamp_ns += SECOND_NS // 10
    out = rig.arbiter.on_drives(rig.stamp_ns, acting, rig.now_s)
    for sensor, value in rig.values.items():
        out += rig.arbiter.on_sample(sensor, rig.stamp_ns, value, rig.now_s)
    assert out == []
    out = rig.arbiter.on_proposal(
        "decentral", ProposalInput(rig.stamp_ns, "decentral", before), rig.now_s + 0.004
    )
    assert [(decision.source, decision.command) for decision in out] == [("hold", acting)]
    rig.now_s += 0.001
    rig.run(1)
    assert rig.last.source == "decentral"
    assert rig.facts("gap")


@pytest.mark.requirement("S15")
@pytest.mark.parametrize("jump_s", [-3600, -0.5 * 3600, 3600])
def test_a_jump_of_the_clock_costs_no_tick(rig, jump_s):
    rig.stamp_ns += int(jump_s * SECOND_NS)
    rig.run(10)
    assert rig.last.source == "decentral"
    assert rig.arbiter.ticks.lost == 0
    assert rig.arbiter.machine.transitions == 1


@pytest.mark.requirement("S15")
def test_single_broken_sensor_clock_has_no_effect(rig):
    for count in range(20):
        rig.arbiter.on_sample("depth", rig.stamp_ns + 10**15 + count, 2.66, rig.now_s + 0.0999)
        rig.run(1)
    assert rig.last.source == "decentral"


@pytest.mark.requirement("S5")
def test_a_repeated_or_old_sample_begins_no_tick(rig):
    assert rig.arbiter.on_sample("depth", rig.stamp_ns, 2.6, rig.now_s + 0.09) == []
    assert (
        rig.arbiter.on_sample("depth", rig.stamp_ns - SECOND_NS // 10, 2.6, rig.now_s + 0.09) == []
    )
    assert rig.arbiter.machine.tick == 10


def test_supervisor_stalls_are_excused(rig):
    arbiter = rig.arbiter
    rig.now_s += 0.1
    rig.stamp_ns += SECOND_NS // 10
    for sensor, value in rig.values.items():
        arbiter.on_sample(sensor, rig.stamp_ns, value, rig.now_s)
    late_s = rig.now_s + 0.5
    assert arbiter.on_time(late_s) == []
    out = arbiter.on_proposal("decentral", rig.proposal("decentral"), late_s + 0.001)
    assert [decision.source for decision in out] == ["decentral"]
    assert arbiter.ticks.stalls == 1
    rig.now_s = late_s
    rig.run(3)
    assert rig.last.source == "decentral"
    assert arbiter.registry.is_ready("decentral")


@pytest.mark.requirement("S5")
def test_a_queue_of_ticks_after_a_hold_up_is_worked_off_one_command_each(rig):
    arbiter, out, now_s = rig.arbiter, [], rig.now_s + 0.9
    stamps = [rig.stamp_ns + count * SECOND_NS // 10 for count in range(1, 9)]
    for stamp in stamps:
        for sensor, value in rig.values.items():
            out += arbiter.on_sample(sensor, stamp, value, now_s)
    for stamp in stamps:
        for name in rig.names:
            proposal = ProposalInput(
                stamp, name, Command(arbiter.applied.force_kn, arbiter.applied.speed_rpm)
            )
            out += arbiter.on_proposal(name, proposal, now_s + 0.001)
    assert [decision.stamp_ns for decision in out] == stamps
    assert out[-1].source == "decentral"
    assert arbiter.machine.mode is Mode.AUTO
    assert arbiter.registry.is_ready("nmpc")


@pytest.mark.requirement("S11")
def test_a_foreign_command_is_reported_once_and_counted(rig):
    for _ in range(3):
        rig.arbiter.on_command(rig.stamp_ns, "decentral", Command(60.0, 300.0))
    assert rig.arbiter.watch.seen_lately(rig.arbiter.ticks.now_s)
    assert rig.arbiter.watch.foreign_commands == 3
    assert rig.facts("foreign_command") == [
        {"force_kn": 60.0, "speed_rpm": 300.0, "source": "decentral"}
    ]
    assert rig.run(1).last.source == "decentral"
    rig.run(60)
    assert not rig.arbiter.watch.seen_lately(rig.arbiter.ticks.now_s)


@pytest.mark.requirement("S11")
def test_a_controller_misled_by_a_foreign_command_is_not_blamed(rig):
    rig.arbiter.on_command(1, "x", Command(61.0, 310.0))
    for name in rig.names:
        rig.spoil(name, command=Command(61.0, 310.0))
    rig.run(1)
    assert (rig.last.source, rig.last.reason.code) == ("hold", ReasonCode.FOREIGN)
    rig.edit.clear()
    rig.run(1)
    assert rig.last.source == "decentral"
    for name in rig.names:
        rig.spoil(name, command=Command(61.0, 310.0))
    rig.run(1)
    assert rig.facts("failed")[-1]["reason"].subject == "decentral", "later there is no excuse"


def test_a_repeated_copy_of_an_own_command_is_foreign(rig):
    last = rig.last
    rig.arbiter.on_command(last.stamp_ns, last.source, last.command)
    assert rig.arbiter.watch.foreign_commands == 1


def test_a_babbling_graph_does_not_fill_the_memory():
    arbiter = Arbiter(SupervisorParameters.from_values({}))
    for count in range(1000):
        arbiter.on_proposal(f"c{count}", ProposalInput(0, f"c{count}", Command(78.0, 400.0)), 0.0)
    assert len(list(arbiter.registry)) == 32
