"""The one check of a command, as supervisor, plant and controllers make it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.command_gate import ROUNDING, Flaw, refusal
from fsw_control.contract import Command, Limits

LIMITS, BEFORE = Limits(), Command(78.4, 407.5)


@pytest.mark.parametrize(
    ("command", "flaw", "facts"),
    [
        (Command(math.nan, 407.5), Flaw.NOT_FINITE, ["force nan kN"]),
        (Command(78.4, -math.inf), Flaw.NOT_FINITE, ["speed -inf rpm"]),
        (Command(95.1, 407.5), Flaw.OUT_OF_RANGE, ["force 95.100 kN", "60 to 95 kN"]),
        (Command(78.4, 299.9), Flaw.OUT_OF_RANGE, ["speed 299.900 rpm", "300 to 500 rpm"]),
        (Command(79.5, 407.5), Flaw.JUMP, ["force", "1.100 kN", "1 kN per"]),
        (
            Command(78.4, 404.0),
            Flaw.JUMP,
            ["speed", "3.500 rpm", "3 rpm per"],
        ),
    ],
)
def test_a_bad_command_is_refused_in_words(command, flaw, facts):
    refused = refusal(command, LIMITS, BEFORE)
    assert refused.flaw is flaw
    assert [fact for fact in facts if fact not in refused.words] == []


def test_change_is_not_checked_without_a_previous_command():
    assert refusal(Command(1.0, 2.0)) is None
    assert refusal(Command(math.nan, 2.0)).flaw is Flaw.NOT_FINITE
    assert refusal(Command(95.0, 500.0), LIMITS) is None, (
        "without the command before there is no jump"
    )


@given(st.floats(), st.floats(), st.floats(60.0, 95.0), st.floats(300.0, 500.0))
def test_clipped_commands_pass_the_check_and_valid_ones_stay_unclipped(
    force, speed, force_before, speed_before
):
    before, command = Command(force_before, speed_before), Command(force, speed)
    if refusal(command, LIMITS, before) is None:
        clipped = LIMITS.clip(command, before)
        assert clipped.force_kn == pytest.approx(force, abs=2e-6)
        assert clipped.speed_rpm == pytest.approx(speed, abs=2e-6)
    if refusal(command) is None:
        assert refusal(LIMITS.clip(command, before), LIMITS, before) is None


@pytest.mark.parametrize("force", [60.0 - ROUNDING, 60.0, 95.0, 95.0 + ROUNDING])
def test_value_at_its_bound_is_not_refused(force):
    assert "speed" in refusal(Command(force, 299.0), LIMITS).words
    assert refusal(Command(force, 300.0 - ROUNDING), LIMITS) is None


@pytest.mark.parametrize("largest", [1.0, 0.0])
def test_the_largest_move_is_allowed(largest):
    wide = Limits(
        force_min_kn=-9.0,
        force_max_kn=9.0,
        speed_min_rpm=-9.0,
        speed_max_rpm=9.0,
        force_step_kn=largest,
    )
    assert refusal(Command(largest + ROUNDING, 0.0), wide, Command(0.0, 0.0)) is None
    assert refusal(Command(largest + 2 * ROUNDING, 0.0), wide, Command(0.0, 0.0)).flaw is Flaw.JUMP
