"""The stop register and the fence, checked exhaustively within bounds.

One changed line of them breaks an invariant.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stop_model import SHORT, Bounds, search

from fsw_control.coded import Fact
from fsw_control.contract import SAFE_STOP
from fsw_control.fence import Barrier, Fence
from fsw_control.stop import Stop, StopRegister
from fsw_supervisor.confirmation import Confirmations
from fsw_supervisor.failover import Failover
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.state_machine import Machine


@pytest.mark.slow
@pytest.mark.requirement("S9", "S25", "S38")
@pytest.mark.parametrize("bounds", SHORT, ids=str)
def test_no_state_within_the_bounds_breaks_an_invariant(bounds):
    result = search(bounds)
    assert not result.broken, (result.path, result.broken)
    assert result.states > 1000


def merge_the_last(self, other):
    changed, self.value = other != self.value, other
    return changed


def acknowledge_in_the_same_epoch(self, who, since_ns):
    if self.value.stopped:
        self.value = Stop(self.value.epoch, False, self.value.cause, who, since_ns)


def stop_in_the_same_epoch(self, cause, who, since_ns):
    self.merge(Stop(max(self.value.epoch, 1), True, cause, who, since_ns))


def check_with(same_term=False, any_term=False, during_stop=False, unknowing=False):
    """The fence's check with one condition changed."""

    def check(self, signature, source):
        self.hear(signature.stop)
        same = signature.term == self._term and (same_term or signature.leader == self._leader)
        if not same and signature.term <= self._term and not any_term:
            return Fact.of(Barrier.LEADER)
        self._term, self._leader, self._answered = signature.term, signature.leader, True
        if source != SAFE_STOP and self.register.stopped and not during_stop:
            return Fact.of(Barrier.STOPPED)
        if source != SAFE_STOP and signature.stop < self.register.value and not unknowing:
            return Fact.of(Barrier.STOPPED)
        return None

    return check


def react_without_a_stop(self, cause, since_ns):
    self._source, self._reacted = "", True


def react_only_if_not_stopped(self, cause, since_ns):
    if not self.register.stopped:
        self.register.stop(cause, "plant", since_ns)
    self._source, self._reacted = "", True


def react_unless_no_source(self, cause, since_ns):
    if not (self.register.stopped and self._source == ""):
        self.register.stop(cause, "plant", since_ns)
    self._source, self._reacted = "", True


def react_and_forget(self, cause, since_ns):
    self.register = StopRegister()
    self.register.stop(cause, "plant", since_ns)
    self._source, self._reacted = "", True


def acknowledge_unconfirmed(self, who):
    if self.machine.register.stopped:
        self.machine.acknowledge(who)
    return True, ""


def lead_with_the_first_term(self, decisions, now_s):
    if not self.term:
        self.heard_term, self.actuator = 0, self.actuator._replace(term=0)
    return pass_on(self, decisions, now_s)


pass_on = Failover.pass_on


def of_stop_by(effect):
    return lambda self, now_s: self._add(
        effect(self._failover.signature.stop, self._failover.machine), now_s
    )


def by_epoch(asked, machine):
    """The rule of an earlier version."""
    return lambda state: (
        state.stop.stopped and state.stop.epoch >= asked.epoch and machine.register.stopped
    )


def before_the_echo(asked, machine):
    return lambda state: True


def merge_only(self, stop):
    self.register.merge(stop)


def nothing(self, *args):
    return None


#: by name: class, method, its replacement, bounds in which a counter-example exists
MUTANTS = {
    "a merge takes the last value": (StopRegister, "merge", merge_the_last, Bounds(1, 2, 0, 0, 1)),
    "an acknowledgement takes no new epoch": (
        StopRegister,
        "acknowledge",
        acknowledge_in_the_same_epoch,
        Bounds(1, 2, 0, 0, 1),
    ),
    "a stop takes no new epoch": (
        StopRegister,
        "stop",
        stop_in_the_same_epoch,
        Bounds(2, 1, 0, 0, 1),
    ),
    "one term has two leaders": (
        Fence,
        "check",
        check_with(same_term=True),
        Bounds(1, 2, 1, 0, 0),
    ),
    "an older term passes": (Fence, "check", check_with(any_term=True), Bounds(1, 2, 0, 0, 1)),
    # alone it is not seen: a supervisor that knows the stop commands nothing else, and one that
    # does not is refused
    "control passes in a stop": (
        Fence,
        "check",
        check_with(during_stop=True, unknowing=True),
        Bounds(1, 1, 0, 0, 0),
    ),
    "control passes that does not know the epoch": (
        Fence,
        "check",
        check_with(unknowing=True),
        Bounds(2, 2, 0, 0, 0),
    ),
    "the end's reaction is no stop": (Fence, "stop", react_without_a_stop, Bounds(1, 1, 0, 0, 0)),
    "a reaction in a stop takes no new epoch": (
        Fence,
        "stop",
        react_only_if_not_stopped,
        Bounds(3, 2, 0, 0, 0),
    ),
    "a reaction without a source takes no new epoch": (
        Fence,
        "stop",
        react_unless_no_source,
        Bounds(3, 2, 1, 0, 0),
    ),
    "the end forgets the register": (Fence, "stop", react_and_forget, Bounds(2, 1, 0, 0, 0)),
    "two stops of an epoch are one": (Fence, "hear", merge_only, Bounds(2, 2, 0, 1, 0)),
    "an acknowledgement is not compared": (
        OperatorRequests,
        "acknowledge",
        acknowledge_unconfirmed,
        Bounds(3, 2, 0, 1, 0),
    ),
    "a lead begins with term 1": (
        Failover,
        "pass_on",
        lead_with_the_first_term,
        Bounds(1, 2, 0, 0, 0),
    ),
    "a stop is answered before the echo": (
        Confirmations,
        "of_stop",
        of_stop_by(before_the_echo),
        Bounds(1, 1, 0, 1, 1),
    ),
    "a stop is answered by its epoch": (
        Confirmations,
        "of_stop",
        of_stop_by(by_epoch),
        Bounds(2, 2, 0, 1, 0),
    ),
    "a stop in a stop takes no new epoch": (Machine, "stop_again", nothing, Bounds(2, 2, 0, 1, 0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_a_changed_line_breaks_an_invariant(name, monkeypatch):
    owner, method, replacement, bounds = MUTANTS[name]
    monkeypatch.setattr(owner, method, replacement)
    result = search(bounds)
    assert result.broken, f"{result.states} states"
    print(name, *result.path, result.broken, sep="\n  ")
