"""Every measurement is answered, and which commands a plant or a gateway passes on."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control import Command, Measurement, Proposal, Reference
from fsw_control.coded import Fact, Worded
from fsw_control.command_gate import REASONS, CommandGate, answer
from fsw_control.contract import Limits
from fsw_control.reason import Reason, ReasonCode


class Own(Worded):
    HELD = "words"


GOOD, S = Command(78.4, 407.5), 1_000_000_000
NOW = 100 * S


def gate(sources=()):
    return CommandGate(Limits(), 0.5, sources, more_reasons=tuple(Own))


@pytest.mark.parametrize(
    ("age_ns", "reason"),
    [(-1, "future"), (0, ""), (1, ""), (S // 2, ""), (S // 2 + 1, "too_old"), (50 * S, "too_old")],
)
def test_a_command_answers_a_measurement_that_is_neither_old_nor_to_come(age_ns, reason):
    tried = gate()
    assert tried.check(GOOD, NOW - age_ns, "nmpc", True, NOW) == reason
    assert tried.last_stamp_ns == (None if reason else NOW - age_ns)


def test_nothing_is_answered_before_the_first_measurement():
    assert gate().check(GOOD, NOW, "nmpc", True, None) == "future"


def test_each_measurement_is_answered_once_and_in_order():
    tried = gate()
    reasons = [tried.check(GOOD, NOW + k, "nmpc", True, NOW + 5) for k in (1, 1, 0, 2)]
    assert reasons == ["", "repeated", "repeated", ""]


@pytest.mark.parametrize(
    ("command", "healthy", "source", "reason"),
    [
        (Command(math.nan, 407.5), False, "nmpc", "not_finite"),
        (Command(math.nan, 407.5), True, "nmpc", "not_finite"),
        (Command(200.0, 407.5), False, "nmpc", "unhealthy"),
        (Command(200.0, 407.5), True, "nmpc", "out_of_range"),
        (GOOD, False, "nmpc", "unhealthy"),
        (GOOD, True, "other", "source"),
        (Command(math.nan, 407.5), False, "other", "source"),
    ],
)
def test_worst_flaw_is_reported(command, healthy, source, reason):
    tried = gate(sources=("nmpc",))
    assert tried.check(command, NOW, source, healthy, NOW) == reason
    assert tried.last.code == reason and len(tried.last.words) > 10
    assert tried.last_stamp_ns is None


def test_refusals_are_counted_by_reason():
    tried = gate()
    assert (tried.total(), tried.last, set(tried.refused)) == (0, None, {*REASONS, "held"})
    for _ in range(3):
        tried.check(GOOD, NOW, "nmpc", False, NOW)
    tried.refuse(Fact.of(Own.HELD))
    assert (tried.refused["unhealthy"], tried.refused["held"], tried.total()) == (3, 1, 4)


def test_other_settings_hold_from_then_on_and_nothing_is_forgotten():
    tried = gate()
    assert tried.check(GOOD, NOW, "nmpc", True, NOW) == ""
    tried.configure(Limits(force_max_kn=70.0), 2.0, ["decentral"])
    assert tried.check(GOOD, NOW + S, "nmpc", True, NOW + S) == "source"
    assert tried.check(GOOD, NOW + S, "decentral", True, NOW + S) == "out_of_range"
    assert tried.check(Command(65.0, 400.0), NOW, "decentral", True, NOW + S) == "repeated"
    assert tried.check(Command(65.0, 400.0), NOW + S, "decentral", True, NOW + 3 * S) == ""


APPLIED = Command(78.0, 400.0)
REFERENCE = Reference(2.66, 850.0)
MEASURED = Measurement(0.0, 2.66, 1052.0, 850.0)


class Scripted:
    """A controller that does what the test says."""

    name = "scripted"
    tolerated_sensors = ("torque",)

    def __init__(self, result):
        self.result = result

    def step(self, measurement, reference, applied, dt_s):
        if isinstance(self.result, Exception):
            raise self.result
        return self.result

    def reset(self, applied):
        pass


def test_good_proposal_passes_unchanged():
    proposal = Proposal(Command(79.0, 401.0))
    assert answer(Scripted(proposal), MEASURED, REFERENCE, APPLIED, 0.1) is proposal


def test_exception_becomes_an_unhealthy_proposal_in_one_line():
    proposal = answer(Scripted(RuntimeError("no\nsolution")), MEASURED, REFERENCE, APPLIED, 0.1)
    assert proposal.command == APPLIED and not proposal.healthy
    assert proposal.reason.code is ReasonCode.RAISED
    text, place = proposal.reason.detail.split(" (")
    assert (text, place.partition(":")[0]) == ("RuntimeError: no solution", Path(__file__).name)


@pytest.mark.parametrize(
    "result",
    [
        None,
        "nonsense",
        Proposal(Command("a", 1.0)),
        Proposal(None),
        Proposal(APPLIED, healthy="yes"),
        Proposal(APPLIED, healthy=None),
        Proposal(APPLIED, reason=3),
    ],
)
def test_nonsense_becomes_an_unhealthy_proposal(result):
    proposal = answer(Scripted(result), MEASURED, REFERENCE, APPLIED, 0.1)
    assert proposal.command == APPLIED and not proposal.healthy and proposal.reason


@given(st.floats(), st.floats())
def test_the_command_is_always_finite(force, speed):
    proposal = answer(Scripted(Proposal(Command(force, speed))), MEASURED, REFERENCE, APPLIED, 0.1)
    assert math.isfinite(proposal.command.force_kn) and math.isfinite(proposal.command.speed_rpm)
    assert proposal.healthy == (math.isfinite(force) and math.isfinite(speed))


def test_needed_sensor_makes_unhealthy_and_tolerated_does_not():
    proposal = Proposal(APPLIED)
    no_torque = Measurement(0.0, 2.66, math.nan, 850.0, torque_valid=False)
    assert answer(Scripted(proposal), no_torque, REFERENCE, APPLIED, 0.1).healthy
    no_depth = Measurement(0.0, math.nan, math.nan, 850.0, depth_valid=False, torque_valid=False)
    refused = answer(Scripted(proposal), no_depth, REFERENCE, APPLIED, 0.1)
    assert not refused.healthy and refused.reason == Reason(ReasonCode.INVALID_SENSOR, ("depth",))


def test_tolerated_sensors_that_are_nonsense_make_unhealthy():
    controller = Scripted(Proposal(APPLIED))
    controller.tolerated_sensors = None
    proposal = answer(
        controller,
        Measurement(0.0, 2.66, math.nan, 850.0, torque_valid=False),
        REFERENCE,
        APPLIED,
        0.1,
    )
    assert proposal.command == APPLIED and not proposal.healthy


def test_proposal_without_reference_is_unhealthy():
    proposal = answer(Scripted(Proposal(Command(1.0, 1.0))), MEASURED, None, APPLIED, 0.1)
    assert proposal.command == APPLIED and proposal.reason.code is ReasonCode.NO_SET_POINT
