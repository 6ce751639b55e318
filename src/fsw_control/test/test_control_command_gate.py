"""Which commands a plant or a gateway passes on, and how it counts those that it refuses."""

import math

import pytest

from fsw_control.coded import Fact, Worded
from fsw_control.command_gate import REASONS, CommandGate
from fsw_control.contract import Command, Limits


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
