"""What is counted and reported of each controller.

Good, late, missing, doubled and refused proposals.
"""

import pytest

from fsw_control.contract import Command
from fsw_control.reason import Lack, Readiness, Reason, ReasonCode
from fsw_supervisor.controller_registry import LOCKSTEP_LAG, ControllerRegistry
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import Machine
from fsw_supervisor.tick import Decision, ProposalInput, Tick

STEP_NS = 100_000_000
STEADY = Command(80.0, 410.0)


class Counted:
    """A registry of controllers, fed tick by tick; ``a`` is the controller in question."""

    def __init__(self, lockstep=False, **values):
        self.machine = Machine(SupervisorParameters.from_values(values))
        self.registry = ControllerRegistry(self.machine, SafetyMonitor(self.machine), lockstep)
        self.now_s = 50.0
        self.ticks = []
        self.stamp_ns = 10**12

    def begin(self, after_ns=STEP_NS):
        """End the tick, and begin one."""
        if self.ticks:
            self.registry.close(self.ticks[-1])
        self.now_s += 0.1
        self.stamp_ns += after_ns
        self.ticks.append(
            Tick(self.stamp_ns, self.now_s, self.now_s + 0.08, STEADY, samples={"depth": 2.6})
        )
        self.ticks[-1] = self.registry.take_early(self.ticks[-1], self.now_s)
        return self

    def change(self, **changes):
        """Change the present tick."""
        self.ticks[-1] = self.ticks[-1]._replace(**changes)

    def take(self, name, proposal, now_s):
        """Take a proposal."""
        tick = self.ticks[-1] if self.ticks else None
        tick = self.registry.take(name, proposal, tick, now_s)
        if tick is not None:
            self.ticks[-1] = tick

    def propose(self, behind=0, after_s=0.01, force_kn=80.0, name="a", **changes):
        """Propose to the tick so many ticks ago."""
        proposal = ProposalInput(
            self.stamp_ns - behind * STEP_NS, name, Command(force_kn, 410.0), **changes
        )
        self.take(name, proposal, self.now_s + after_s)
        return self.record

    @property
    def record(self):
        return self.registry.get("a")

    def facts(self, code):
        return [event.fact.data for event in self.machine.events if event.fact.code == code]


def counts(record):
    return {
        name: value
        for name in (
            "late",
            "missed",
            "rejected",
            "duplicates",
            "consecutive_good",
            "silent_ticks",
        )
        if (value := getattr(record, name))
    }


@pytest.fixture
def counted():
    """Five ticks that ``a`` has answered well, and a sixth that nobody has answered yet."""
    counted = Counted()
    for _ in range(5):
        counted.begin().propose()
    assert counts(counted.record) == {"consecutive_good": 5}
    return counted.begin()


def test_a_proposal_in_time_is_good_and_its_latency_is_kept(counted):
    record = counted.propose(after_s=0.03)
    assert counts(record) == {"consecutive_good": 6}
    assert record.latencies_s[-1] == pytest.approx(0.03)
    counted.begin()
    assert counted.propose(after_s=-0.01).latencies_s[-1] == 0.0, "it came before the measurement"
    assert counted.registry.is_ready("a")


@pytest.mark.parametrize(("after_s", "late"), [(0.079, False), (0.081, True)])
def test_a_proposal_after_the_deadline_is_late_and_no_candidate(counted, after_s, late):
    record = counted.propose(after_s=after_s)
    assert (record.late, "a" not in counted.ticks[-1].candidates) == (int(late), late)
    if late:
        assert record.problem == Reason(ReasonCode.LATE, limit_s=pytest.approx(0.081))
        assert record.consecutive_good == 0
        assert record.latencies_s[-1] == pytest.approx(0.081)


def test_wall_clock_is_ignored_in_lockstep():
    counted = Counted(lockstep=True).begin()
    assert counts(counted.propose(after_s=9.0)) == {"consecutive_good": 1}


def test_an_answer_to_an_older_measurement_is_late(counted):
    record = counted.begin().propose(behind=1)
    assert record.problem == Reason(ReasonCode.OUTDATED, limit_s=0.1)
    assert counts(record) == {"late": 1, "missed": 1, "silent_ticks": 1}
    assert not counted.ticks[-1].candidates
    assert "a" not in counted.ticks[-2].candidates


def test_an_old_answer_that_was_given_before_is_a_duplicate_and_refused(counted):
    counted.propose()
    assert counts(counted.propose(behind=1)) == {
        "duplicates": 1,
        "rejected": 1,
        "consecutive_good": 6,
    }
    assert counts(counted.propose(behind=3)) == {
        "duplicates": 2,
        "rejected": 2,
        "consecutive_good": 6,
    }
    counted.begin()
    assert counts(counted.propose(behind=1))["duplicates"] == 3


def test_late_answer_after_a_supervisor_stall_is_not_a_failure(counted):
    counted.change(stalled=True)
    counted.ticks[-1] = counted.ticks[-1].settle()
    record = counted.begin().propose(behind=1)
    assert record.problem == Reason()
    assert counts(record) == {"late": 1, "consecutive_good": 5, "silent_ticks": 1}


def test_in_lockstep_an_answer_to_an_older_measurement_is_as_good_as_another():
    counted = Counted(lockstep=True)
    for _ in range(LOCKSTEP_LAG):
        counted.begin()
    counted.registry.join("a")
    assert counted.propose(behind=LOCKSTEP_LAG - 1).consecutive_good == 1
    for behind in range(LOCKSTEP_LAG - 2, -1, -1):
        counted.propose(behind=behind)
    assert counts(counted.record) == {"consecutive_good": LOCKSTEP_LAG}


def test_in_lockstep_an_answer_is_checked_against_what_was_applied_then():
    counted = Counted(lockstep=True).begin().begin()
    counted.change(previous=Command(82.0, 410.0))
    assert counted.propose(behind=1, force_kn=80.5).consecutive_good == 1
    counted.begin()
    jump = Reason(ReasonCode.JUMP, subject="force")
    assert counted.propose(behind=1, force_kn=80.5).problem == jump


def test_lockstep_answer_to_an_unknown_measurement_is_late():
    counted = Counted(lockstep=True).begin().begin()
    stamp_ns = counted.stamp_ns - STEP_NS // 2
    counted.registry.take(
        "a", ProposalInput(stamp_ns, "a", STEADY), counted.ticks[-1], counted.now_s
    )
    assert counts(counted.record) == {"late": 1}
    assert counted.record.problem == Reason(ReasonCode.OUTDATED, limit_s=0.05)


@pytest.mark.parametrize("lockstep", [False, True])
def test_silence_is_reported_once_and_counts_as_a_miss(lockstep):
    counted = Counted(lockstep=lockstep)
    for _ in range(3):
        counted.begin().propose()
    lag = LOCKSTEP_LAG if lockstep else 1
    for _ in range(lag):
        counted.begin()
    assert (counted.record.problem, counted.record.missed) == (Reason(), 0), "the tick is not over"
    counted.begin()
    assert (counted.record.problem.code, counted.record.missed) == (ReasonCode.NO_PROPOSAL, 1)
    counted.begin()
    assert counted.record.missed == 2
    assert counted.record.silent_ticks == lag + 1
    counted.registry.leave("a")
    counted.begin().begin()
    assert counted.record.missed == 2
    assert counted.facts("silent") == [{"controller": "a"}]


def test_silence_does_not_replace_an_earlier_problem(counted):
    counted.propose(healthy=False, reason=Reason.of("solver failed"))
    counted.begin().begin()
    assert counted.record.problem == Reason.of("solver failed")
    assert counted.facts("silent") == []


def test_who_never_proposed_is_told_to_be_silent_without_a_warning(counted):
    counted.registry.join("b")
    counted.begin()
    assert counted.registry.get("b").problem.code is ReasonCode.NO_PROPOSAL
    assert {"controller": "b"} not in counted.facts("silent")


def test_silence_in_an_excused_tick_is_not_a_failure(counted):
    counted.change(stalled=True)
    counted.begin()
    assert (counted.record.problem, counts(counted.record)) == (
        Reason(),
        {"consecutive_good": 5, "silent_ticks": 1},
    )
    decision = Decision(counted.stamp_ns, STEADY, "hold")
    counted.ticks[-1] = counted.ticks[-1].settle(decision, "an excuse")
    assert counted.propose().consecutive_good == 5, "an answer to it is neither good nor bad"
    assert counted.ticks[-1].candidates == {}
    assert counted.record.last_stamp_ns == counted.stamp_ns


def test_a_good_proposal_ends_the_silence(counted):
    counted.begin().begin()
    assert counted.record.silent_ticks == 2
    assert counts(counted.propose()) == {"consecutive_good": 1, "missed": 2}
    assert counted.record.problem == Reason()


# ---------------------------------------------------------------- before the measurement


def test_proposals_before_their_measurements_are_kept_for_them():
    counted = Counted()
    for ahead in (1, 2):
        counted.propose(behind=-ahead)
    assert counts(counted.record) == {}
    for count in (1, 2):
        counted.begin()
        assert counts(counted.record) == {"consecutive_good": count}


def test_of_many_early_proposals_the_last_eight_are_kept():
    counted = Counted()
    for ahead in range(1, 10):
        counted.propose(behind=-ahead)
    counted.begin()
    assert counts(counted.record) == {}, "the first has gone"
    for count in range(1, 9):
        counted.begin()
        assert counted.record.consecutive_good == count


def test_the_first_of_two_early_proposals_counts():
    counted = Counted()
    counted.propose(behind=-1)
    counted.propose(behind=-1, force_kn=80.7)
    counted.begin()
    assert counted.ticks[-1].candidates["a"].command == STEADY


def test_early_proposals_to_measurements_that_never_came_are_forgotten(counted):
    counted.propose(behind=-1)
    counted.begin(after_ns=2 * STEP_NS)
    assert counted.record.early == {}
    assert "a" not in counted.ticks[-1].candidates


@pytest.mark.requirement("S15")
def test_proposal_counts_restart_when_the_clock_goes_back(counted):
    counted.propose()
    back_ns = -3600 * 10**9
    early_ns = counted.stamp_ns + back_ns
    for stamp_ns in (early_ns, counted.stamp_ns + STEP_NS):
        counted.registry.take(
            "a", ProposalInput(stamp_ns, "a", STEADY), counted.ticks[-1], counted.now_s
        )
    assert counts(counted.record) == {"consecutive_good": 6}, "the measurement may come later"
    counted.registry.forget_time(early_ns)
    counted.begin(after_ns=back_ns)
    assert counts(counted.record) == {"consecutive_good": 7}
    counted.begin()
    assert counts(counted.propose()) == {"consecutive_good": 8}
    assert counted.record.early == {}


@pytest.mark.parametrize(("behind", "early"), [(10, False), (11, True)])
def test_only_an_answer_to_a_time_more_than_a_second_ago_may_be_one_of_a_clock_that_went_back(
    counted, behind, early
):
    counted.registry.forget_time(0)
    counted.record.last_stamp_ns = -1
    record = counted.propose(behind=behind)
    assert (len(record.early), record.late) == ((1, 0) if early else (0, 1))


# ---------------------------------------------------------------- two of one name


def test_two_answers_to_one_measurement_are_counted_and_the_first_stays(counted):
    counted.propose()
    counted.propose(force_kn=80.5)
    assert counted.ticks[-1].candidates["a"].command == STEADY
    assert counts(counted.record) == {"consecutive_good": 6, "duplicates": 1}
    assert counted.ticks[-1].duplicates == {"a": True}


def test_equal_duplicate_answers_do_not_conflict(counted):
    counted.propose()
    counted.propose()
    assert counted.ticks[-1].duplicates == {"a": False}


@pytest.mark.requirement("S6")
def test_a_name_that_two_controllers_use_is_ambiguous_after_some_ticks_in_a_row_and_told_once(
    counted,
):
    ticks = counted.machine.settings.duplicate_ticks
    for count in range(1, ticks + 3):
        counted.propose()
        counted.propose(force_kn=80.5)
        counted.begin()
        assert (counted.record.doubled, counted.record.conflicts) == (count, count)
        assert len(counted.facts("doubled")) == int(count >= ticks)
        lack = counted.registry.readiness("a").lack
        assert (lack is Lack.AMBIGUOUS) == (count >= ticks)
    counted.propose()
    counted.begin()
    assert (counted.record.doubled, counted.record.conflicts) == (0, 0)
    assert counted.registry.is_ready("a")


# ---------------------------------------------------------------- who may be selected


def test_joining_and_leaving_are_logged_once_each(counted):
    registry = counted.registry
    registry.leave("nobody")
    for _ in range(2):
        registry.leave("a")
        assert not counted.record.present
    for _ in range(2):
        registry.join("a")
        assert counted.record.present
    assert len(counted.facts("left")) == 1
    assert len(counted.facts("joined")) == 2
    assert registry.get("nobody") is None


def test_departed_controller_is_selectable_only_while_it_proposes(counted):
    registry = counted.registry
    registry.leave("a")
    assert registry.is_ready("a")
    counted.begin()
    assert registry.readiness("a") == Readiness(Lack.UNUSABLE, Reason(ReasonCode.NO_PROPOSAL))
    registry.join("b")
    registry.leave("b")
    assert registry.readiness("b") == Readiness(Lack.LEFT)


def test_a_full_registry_still_knows_those_that_it_has():
    counted = Counted()
    for number in range(40):
        counted.registry.join(f"c{number}")
    assert len(list(counted.registry)) == 32
    counted.registry.leave("c3")
    counted.registry.join("c3")
    assert counted.registry.get("c3").present
    counted.begin().propose(name="c99")
    assert counted.registry.get("c99") is None


def test_all_have_told_their_status_when_each_in_the_graph_has(counted):
    registry = counted.registry
    assert not Counted().registry.all_reported(), "nobody is there to tell"
    assert not registry.on_status("nobody", ())
    assert not registry.all_reported()
    assert registry.on_status("a", ())
    assert registry.all_reported()
    registry.join("b")
    assert not registry.all_reported()
    registry.leave("b")
    assert registry.all_reported()


def test_only_sensors_that_there_are_can_be_done_without(counted):
    counted.registry.on_status("a", ("torque", "smell"))
    assert counted.record.tolerated_sensors == ("torque",)


@pytest.mark.parametrize("readmit_ticks", [0, 4])
def test_who_has_failed_is_readmitted_after_so_many_good_proposals_or_never(readmit_ticks):
    counted = Counted(readmit_ticks=readmit_ticks, warm_ticks=2)
    counted.begin().propose()
    counted.record.inhibit(Reason.of("it failed"))
    failed = Reason.of("it failed")
    assert counted.registry.readiness("a") == Readiness(Lack.INHIBITED, failed)
    for count in range(1, 8):
        counted.begin().propose()
        assert (counted.record.inhibited == Reason()) == (0 < readmit_ticks <= count)
    assert len(counted.facts("recovered")) == int(readmit_ticks > 0)
    assert counted.facts("ready") == []


def test_readiness_is_logged_once():
    counted = Counted(warm_ticks=3)
    for count in range(1, 6):
        counted.begin().propose()
        assert len(counted.facts("ready")) == int(count >= 3)
        assert (counted.registry.is_ready("a")) == (count >= 3)
    assert counted.registry.all_ready() == {"a"}


def test_refusal_is_logged_once_and_counted(counted):
    for _ in range(3):
        counted.propose(force_kn=99.0)
        counted.begin()
    assert counts(counted.record) == {"rejected": 3}
    assert [fact["force_kn"] for fact in counted.facts("refused")] == [99.0]
    counted.propose(healthy=False, reason=Reason.of("solver failed"))
    assert counts(counted.record) == {"rejected": 3}
    assert counted.record.problem == Reason.of("solver failed")


def test_candidates_are_checked_again_once_it_is_known_what_is_applied(counted):
    counted.change(previous=None)
    counted.registry.join("b")
    counted.propose(force_kn=85.0)
    counted.propose(name="b", healthy=False, reason=Reason.of("not yet"))
    assert counted.ticks[-1].candidates["a"].refusal == Reason()
    tick = counted.registry.check_again(counted.ticks[-1]._replace(previous=STEADY))
    assert tick.candidates["a"].jump
    assert counts(counted.record) == {"rejected": 1}
    assert counted.record.problem == Reason(ReasonCode.JUMP, subject="force")
    assert counted.facts("refused")[-1]["force_kn"] == 85.0
    assert tick.candidates["b"].refusal == Reason.of("not yet")


def test_all_are_readmitted_at_once_and_it_is_told_who(counted):
    counted.registry.readmit_all("operator")
    assert counted.facts("readmitted") == []
    counted.record.inhibit(Reason.of("it failed"))
    counted.registry.readmit_all("operator")
    assert counted.record.inhibited == Reason()
    assert counted.facts("readmitted") == [{"who": "operator", "controllers": ("a",)}]


def test_who_is_readmitted_is_usable_only_after_good_proposals(counted):
    counted.propose()
    counted.record.inhibit(Reason.of("it failed"))
    counted.registry.readmit_all("operator")
    assert counted.registry.readiness("a") == Readiness(Lack.UNUSABLE, Reason.of("it failed"))
    warm_ticks = counted.machine.settings.warm_ticks
    for count in range(1, warm_ticks + 1):
        counted.begin().propose()
        lacks = Readiness(Lack.WARMING, good=count, required=warm_ticks)
        expected = Readiness() if count == warm_ticks else lacks
        assert counted.registry.readiness("a") == expected


def test_a_standby_inhibits_exactly_those_that_the_leader_has_inhibited(counted):
    counted.registry.join("b")
    counted.record.inhibit(Reason.of("it failed"))
    theirs = Readiness(Lack.INHIBITED, Reason.of("the leader says so"))
    counted.registry.mirror_inhibitions({"b": theirs.reason})
    assert counted.record.inhibited == Reason()
    assert counted.registry.readiness("b") == theirs
    for _ in range(2):  # one takes over from the other again and again
        counted.registry.mirror_inhibitions({"b": counted.registry.readiness("b").reason})
    assert counted.registry.readiness("b") == theirs
