"""The active controller fails: who answers, in which tick, and what becomes of the failed one."""

from dataclasses import replace

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Lack, Reason, ReasonCode
from fsw_control.reports_ros import OK, WARN
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.reports_ros import diagnostics
from fsw_supervisor.state_machine import Mode

NAN = float("nan")


def test_the_configured_controller_is_applied_from_the_first_tick(make_rig):
    rig = make_rig().run(1)
    assert rig.last.source == "decentral"
    assert rig.arbiter.machine.mode is Mode.AUTO


@pytest.mark.requirement("S6")
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"command": Command(NAN, 407.5)}, Reason(ReasonCode.NOT_FINITE, subject="force")),
        (
            {"command": Command(78.4, float("inf"))},
            Reason(ReasonCode.NOT_FINITE, subject="speed"),
        ),
        ({"command": Command(95.5, 407.5)}, Reason(ReasonCode.OUT_OF_RANGE, subject="force")),
        ({"command": Command(78.4, 299.0)}, Reason(ReasonCode.OUT_OF_RANGE, subject="speed")),
        ({"command": Command(80.4, 407.5)}, Reason(ReasonCode.JUMP, subject="force")),
        ({"command": Command(78.4, 412.5)}, Reason(ReasonCode.JUMP, subject="speed")),
        ({"healthy": False, "reason": Reason.of("solver failed")}, Reason.of("solver failed")),
        ({"healthy": False}, Reason(ReasonCode.UNHEALTHY)),
        ({"source": "nmpc"}, Reason(ReasonCode.OTHER_SOURCE, subject="nmpc")),
    ],
)
def test_a_refused_proposal_is_replaced_in_the_same_tick(rig, changes, reason):
    rig.spoil("decentral", **changes)
    rig.run(1)
    assert rig.last.source == "nmpc"
    record = rig.arbiter.registry.get("decentral")
    assert record.inhibited == reason
    assert rig.arbiter.machine.reason == Reason(
        ReasonCode.FAILED, subject="decentral", because=record.inhibited
    )
    assert rig.arbiter.machine.cause is Cause.SWAP_FAILED
    assert rig.arbiter.machine.target == "decentral"
    assert record.rejected == (0 if changes.get("healthy") is False else 1)


@pytest.mark.requirement("S6")
def test_a_silent_controller_is_replaced_at_the_deadline_of_the_same_tick(rig):
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.source == "nmpc"
    assert rig.last.latency_s == pytest.approx(0.08)
    assert rig.arbiter.registry.get("decentral").inhibited.code is ReasonCode.NO_PROPOSAL
    rig.run(1)
    assert rig.last.latency_s == pytest.approx(0.005)


def test_tick_without_sensors_holds_without_blame(rig):
    """The plant was stopped just after it had told the drives' feedback."""
    values, rig.values, rig.silent = rig.values, {}, {"decentral", "nmpc"}
    held = rig.arbiter.applied
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("hold", held)
    rig.values, rig.silent = values, set()
    rig.run(1)
    assert rig.last.source == "decentral"
    assert [record.missed for record in rig.arbiter.registry] == [0, 0]


@pytest.mark.requirement("S6")
def test_a_controller_late_by_150_ms_is_replaced_and_counted(rig):
    rig.delays_s["decentral"] = 0.15
    rig.run(10)
    assert {decision.source for tick in rig.ticks[10:] for decision in tick} == {"nmpc"}
    record = rig.arbiter.registry.get("decentral")
    assert record.late >= 8
    assert record.missed >= 8
    assert record.problem.code in (ReasonCode.LATE, ReasonCode.OUTDATED, ReasonCode.NO_PROPOSAL)


@pytest.mark.requirement("S6")
def test_a_controller_that_repeats_old_stamps_is_replaced(rig):
    old = rig.stamp_ns
    rig.edit["decentral"] = lambda proposal: replace(proposal, stamp_ns=old)
    rig.run(3)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.registry.get("decentral").rejected == 3


@pytest.mark.requirement("S6")
def test_a_stamp_from_the_future_answers_nothing(rig):
    rig.edit["decentral"] = lambda proposal: replace(proposal, stamp_ns=proposal.stamp_ns + 10**12)
    rig.run(3)
    assert rig.last.source == "nmpc"


@pytest.mark.requirement("S3", "S7")
def test_no_controller_left_means_hold_then_safe_stop(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"hold_timeout_s": 2.0})).run(10)
    rig.silent |= {"decentral", "nmpc"}
    held = rig.arbiter.applied
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("hold", held)
    assert rig.arbiter.machine.target_mode is Mode.AUTO
    rig.run(19)
    assert (rig.arbiter.machine.mode, rig.arbiter.applied) == (Mode.HOLD, held)
    rig.run(1)
    assert rig.arbiter.machine.mode is Mode.SAFE_STOP
    rig.run(200)
    assert rig.arbiter.applied == Command(65.0, held.speed_rpm)
    assert rig.ticks[-100][0].source == "safe_stop"
    rig.silent.clear()
    rig.run(50)
    assert rig.arbiter.machine.mode is Mode.SAFE_STOP, "only the operator leads out of a safe stop"


def test_hold_ends_when_a_controller_is_ready_again(rig):
    rig.silent |= {"decentral", "nmpc"}
    rig.run(3)
    rig.silent.discard("nmpc")
    rig.run(rig.arbiter.settings.warm_ticks + 1)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.machine.mode is Mode.AUTO


def test_the_failed_one_is_readmitted_after_good_shadow_ticks_and_not_before(rig):
    settings = rig.arbiter.settings
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(settings.readmit_ticks - 1)
    assert rig.arbiter.registry.readiness("decentral").lack is Lack.INHIBITED
    rig.run(1)
    assert rig.arbiter.registry.is_ready("decentral")
    assert rig.last.source == "nmpc", "coming back is no reason to swap"


def test_return_to_target_goes_back_by_itself_when_asked_for(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"return_to_target": True})).run(10)
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(rig.arbiter.settings.readmit_ticks + 1)
    assert rig.last.source == "decentral"


def test_the_operator_readmits_with_auto(rig):
    rig.spoil("decentral", healthy=False, reason=Reason.of("x"))
    rig.run(1)
    rig.edit.clear()
    rig.run(6)
    assert rig.arbiter.operator.ask_mode("auto", None, "operator")[0]
    assert rig.arbiter.registry.is_ready("decentral")


def test_a_fallback_that_is_not_warm_is_not_taken(make_rig):
    rig = make_rig()
    rig.names = ["decentral"]
    rig.run(10)
    rig.names = ["decentral", "nmpc"]
    rig.run(2)
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.source == "hold"


def test_the_fallback_list_is_followed_in_order(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"fallbacks": ("third", "nmpc")}))
    rig.names = ["decentral", "nmpc", "third"]
    rig.run(10)
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.source == "third"
    rig.silent.add("third")
    rig.run(1)
    assert rig.last.source == "nmpc"


def test_a_fallback_that_nobody_runs_is_told_unless_it_is_one_by_default(make_rig):
    alone = make_rig()
    alone.names = ["decentral"]
    alone.run(5)
    status = diagnostics(alone.arbiter, 1, {}, (0.05, 0.1))[0]
    assert (status.level, status.code) == (OK, "several")
    misspelt = make_rig(
        SupervisorParameters.from_values({"fallbacks": ("decentral", "nmcp")})
    ).run(5)
    status = diagnostics(misspelt.arbiter, 1, {}, (0.05, 0.1))[0]
    assert status.level == WARN
    absent = next(fact for fact in status.what.data["facts"] if fact.code == "absent")
    assert absent.data["controllers"] == ("nmcp",)


def test_switching_storms_end_in_hold(make_rig):
    settings = SupervisorParameters.from_values(
        {"storm_swaps": 3, "readmit_ticks": 1, "warm_ticks": 1}
    )
    rig = make_rig(settings).run(5)
    for count in range(4):
        failing = rig.arbiter.machine.active
        rig.silent = {failing}
        rig.run(1)
        rig.silent = set()
        rig.run(2)
        assert (rig.last.source == "hold") == (count == 3)
    assert rig.arbiter.machine.reason.code is ReasonCode.STORM


def test_two_controllers_of_one_name_are_distrusted_and_reported(rig):
    def second_voice(count):
        for _ in range(count):
            rig.run(1)
            proposal = rig.proposal("decentral")
            other = replace(
                proposal,
                command=Command(proposal.command.force_kn + 0.2, proposal.command.speed_rpm),
            )
            assert rig.arbiter.on_proposal("decentral", other, rig.now_s + 0.09) == []

    second_voice(3)
    assert rig.last.source == "decentral"
    second_voice(1)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.machine.reason.chain[1].code is ReasonCode.NAMESAKE
    assert {"controller": "decentral"} in rig.facts("doubled")
    record = rig.arbiter.registry.get("decentral")
    assert record.duplicates >= 4
    assert record.inhibited, "it has to prove itself again when the other one is gone"


@pytest.mark.requirement("S12")
def test_all_controllers_follow_whatever_is_applied_so_the_swap_is_bumpless(rig):
    rig.force_wish_kn = 90.0
    rig.run(5)
    before = rig.arbiter.applied
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.source == "nmpc"
    assert abs(rig.arbiter.applied.force_kn - before.force_kn) <= 0.5 + 1e-9
