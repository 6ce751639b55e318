"""The command that a controller has to follow is the one before the tick, whoever else writes to the topic."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.applied import AppliedCommand, AppliedCommands
from fsw_control.contract import Command

INITIAL, FIRST, SECOND = Command(78.4, 407.0), Command(79.0, 408.0), Command(80.0, 409.0)
WILD = Command(61.0, 310.0)
STEP_NS = 100_000_000


def see(applied, stamp_ns, command, source="nmpc", writer="s1", newest_ns=None, now_s=0.0, **more):
    return applied.add(AppliedCommand(stamp_ns, command, source, writer, **more), newest_ns, now_s)


def test_initial_until_the_first_command():
    applied = AppliedCommands(INITIAL)
    assert applied.before(100) == applied.latest.command == INITIAL
    assert applied.latest.source == ""


def test_a_command_that_answers_the_tick_itself_does_not_count_yet():
    applied = AppliedCommands(INITIAL)
    assert see(applied, 100, FIRST)
    assert see(applied, 200, SECOND, "decentral")
    assert applied.before(100) == INITIAL
    assert applied.before(200) == FIRST
    assert applied.before(300) == applied.latest.command == SECOND
    assert applied.latest.source == "decentral"


def test_only_the_first_command_of_a_stamp_counts():
    applied = AppliedCommands(INITIAL)
    see(applied, 200, FIRST)
    assert not see(applied, 200, FIRST)
    assert (applied.ignored, applied.complaint) == (0, ""), "lockstep sends a command again"
    assert not see(applied, 200, SECOND)
    assert not see(applied, 100, SECOND)
    assert applied.ignored == 2
    assert applied.before(300) == FIRST


@pytest.mark.parametrize("bad", [Command(float("nan"), 400.0), Command(78.0, float("inf"))])
def test_commands_rejected_by_the_plant_do_not_count(bad):
    applied = AppliedCommands(INITIAL)
    assert not see(applied, 100, bad)
    assert not see(applied, 100, FIRST, healthy=False)
    assert applied.before(200) == INITIAL


def test_backward_jump_keeps_the_command_in_force():
    applied = AppliedCommands(INITIAL)
    see(applied, 5000 * STEP_NS, FIRST, newest_ns=5000 * STEP_NS)
    applied.restart()
    assert applied.before(STEP_NS) == FIRST
    assert see(applied, STEP_NS, SECOND, newest_ns=STEP_NS)
    assert applied.before(2 * STEP_NS) == SECOND


def test_a_command_of_another_time_blocks_nothing():
    applied = AppliedCommands(INITIAL)
    assert see(applied, 10**18, WILD), "before the first measurement any time may be right"
    assert applied.before(STEP_NS) == INITIAL
    assert see(applied, STEP_NS, FIRST, newest_ns=STEP_NS)
    for stamp_ns in (1, 10**18):
        assert not see(applied, stamp_ns + 20 * STEP_NS, WILD, newest_ns=STEP_NS)
    assert applied.before(2 * STEP_NS) == FIRST


def test_a_standby_that_takes_over_is_followed_at_its_first_command():
    applied = AppliedCommands(INITIAL)
    see(applied, STEP_NS, FIRST, newest_ns=STEP_NS, now_s=0.105)
    assert see(applied, 3 * STEP_NS, SECOND, writer="s2", newest_ns=3 * STEP_NS, now_s=0.3)
    assert not see(applied, 4 * STEP_NS, WILD, writer="s1", newest_ns=4 * STEP_NS, now_s=0.4), (
        "it was stopped"
    )
    assert applied.before(5 * STEP_NS) == SECOND


def test_lockstep_command_answers_the_next_measurement():
    applied = AppliedCommands(INITIAL)
    see(applied, STEP_NS, FIRST, newest_ns=STEP_NS, now_s=0.0)
    assert see(applied, 2 * STEP_NS, SECOND, writer="s2", newest_ns=2 * STEP_NS, now_s=3.0)


def test_foreign_command_for_a_future_measurement_is_rejected():
    applied = AppliedCommands(INITIAL)
    see(applied, STEP_NS, FIRST, newest_ns=STEP_NS)
    assert not see(applied, 5 * STEP_NS, WILD, writer="", newest_ns=STEP_NS)
    assert see(applied, 2 * STEP_NS, SECOND, newest_ns=STEP_NS), (
        "the one that is followed may be ahead of the samples"
    )


foreign = st.tuples(
    st.integers(-20, 20) | st.integers(-(10**9), 10**9),  # ticks from the present one
    st.sampled_from(["", "s2"]),
    st.floats(allow_nan=True, allow_infinity=True),
)


@given(
    ticks=st.lists(
        st.tuples(st.booleans(), st.lists(foreign, max_size=3), st.lists(foreign, max_size=3)),
        max_size=30,
    ),
    jump_at=st.integers(1, 40),
    jump=st.sampled_from([-900, -40, 40]),
)
def test_whatever_others_write_while_the_supervisor_commands_nothing_of_it_counts(
    ticks, jump_at, jump
):
    applied = AppliedCommands(INITIAL)
    k, now_s, acting = 1000, 0.0, INITIAL
    for count, (ahead, before, after) in enumerate([(False, [], []), *ticks]):
        if count == jump_at:
            k += jump
            applied.restart()
        stamp_ns, newest_ns = k * STEP_NS, (k - ahead) * STEP_NS
        answer = Command(70.0 + 0.01 * count, 400.0)
        # After the jump nobody is followed yet; until then whoever comes first is.
        for others, own in ((before if count != jump_at else [], True), (after, False)):
            for offset, writer, force_kn in others:
                see(
                    applied,
                    max(k + offset, 0) * STEP_NS,
                    Command(force_kn, 300.0),
                    "x",
                    writer,
                    newest_ns,
                    now_s,
                )
            if own:
                assert see(applied, stamp_ns, answer, newest_ns=newest_ns, now_s=now_s + 0.005)
        assert applied.before(stamp_ns) == acting
        assert applied.latest.command == answer
        acting = answer
        k, now_s = k + 1, now_s + 0.1
    assert applied.before(k * STEP_NS) == acting


def test_memory_is_bounded():
    applied = AppliedCommands(INITIAL)
    for tick in range(1000):
        see(applied, tick, Command(float(tick), 400.0))
    assert applied.before(10) == Command(900.0, 400.0)
    assert applied.before(2000) == Command(999.0, 400.0)
