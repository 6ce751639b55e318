"""The stop register and the fence of the actuator end."""

import hypothesis.strategies as st
import pytest
from hypothesis import given

from fsw_control import messages_ros as convert
from fsw_control.contract import Command
from fsw_control.fence import ActuatorState, Fence, Signature
from fsw_control.stop import LAST_EPOCH, Stop, StopCause, StopRegister

stops = st.builds(
    Stop,
    st.integers(0, 4),
    st.booleans(),
    st.sampled_from(StopCause),
    st.sampled_from(["", "anna", "plant"]),
    st.integers(0, 2),
)
sources = st.sampled_from(["nmpc", "manual", "hold", "safe_stop"])
signatures = st.builds(Signature, st.integers(0, 4), st.sampled_from(["", "a", "b"]), stops)


@pytest.mark.requirement("S25")
@given(st.lists(stops), st.randoms())
def test_copies_that_have_heard_the_same_are_equal_in_any_order(heard, random):
    copies = [StopRegister(), StopRegister()]
    for value in heard:
        copies[0].merge(value)
    for value in random.sample(heard * 2, 2 * len(heard)):
        copies[1].merge(value)
    assert copies[0].value == copies[1].value


@pytest.mark.requirement("S25")
@given(stops, stops)
def test_stop_beats_acknowledgement_of_the_same_epoch(one, other):
    register = StopRegister()
    register.merge(one)
    register.merge(other)
    epoch = max(one.epoch, other.epoch)
    assert register.stopped == any(
        value.stopped for value in (one, other, Stop()) if value.epoch == epoch
    )


@pytest.mark.requirement("S25")
@given(stops)
def test_a_new_stop_is_greater_than_any_acknowledgement_that_was_heard(heard):
    register, acknowledging = StopRegister(), StopRegister()
    for copy in (register, acknowledging):
        copy.merge(heard)
    acknowledging.acknowledge("anna", 0)
    register.stop(StopCause.INTERLOCK, "interlock", 0)
    register.merge(acknowledging.value)
    assert register.stopped


@pytest.mark.requirement("S25")
@given(stops.filter(lambda value: not value.stopped))
def test_acknowledgement_needs_knowledge_of_the_stop(acknowledgement):
    """A supervisor that restarts without a link knows neither the epoch nor the time."""
    register = StopRegister()
    register.stop(StopCause.OPERATOR, "anna", 0)
    register.merge(acknowledgement)
    assert register.stopped and register.value > acknowledgement
    other = StopRegister()
    other.merge(register.value)
    register.merge(other.value)
    other.acknowledge("anna", 0)
    register.merge(other.value)
    assert not register.stopped


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("second", ["aaron", "zoe"])
def test_acknowledgement_of_one_stop_does_not_cover_another_of_its_epoch(second):
    fence, acknowledging = Fence(), StopRegister()
    first = Stop(1, True, StopCause.OPERATOR, "anna")
    fence.hear(first)
    acknowledging.merge(first)
    acknowledging.acknowledge("anna", 0)
    for _ in range(2):
        fence.hear(Stop(1, True, StopCause.OPERATOR, second))
    fence.hear(acknowledging.value)
    assert fence.register.value.stopped and fence.register.value.epoch == 2


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("since_ns", [1_795_000_000 * 10**9, 2**62])
def test_an_acknowledgement_of_an_earlier_weld_does_not_cover_a_stop(since_ns):
    """A part that outlived the others has kept it."""
    earlier, fence = StopRegister(), Fence()
    for second in range(5):
        earlier.stop(StopCause.OPERATOR, "anna", 1_794_000_000 * 10**9 + second)
        earlier.acknowledge("anna", 0)
    fence.stop(StopCause.WATCHDOG, since_ns)
    fence.hear(earlier.value)
    assert fence.register.stopped
    fence.register.acknowledge("bert", since_ns)
    assert not fence.register.stopped, "also with a clock that is far ahead"


def test_the_last_epoch_is_a_stop_for_ever():
    register = StopRegister()
    register.merge(Stop(LAST_EPOCH - 1, True))
    register.acknowledge("anna", 0)
    assert not register.stopped
    register.stop(StopCause.OPERATOR, "anna", 0)
    register.acknowledge("anna", 0)
    assert register.stopped


events = st.one_of(
    st.tuples(st.just("command"), signatures, sources),
    st.tuples(st.just("heard"), stops, st.none()),
    st.tuples(st.just("measure"), st.none(), st.none()),
    st.tuples(st.just("watchdog"), st.none(), st.none()),
)


@pytest.mark.requirement("S9", "S25")
@given(st.lists(events, max_size=30))
def test_fence_invariants_hold_whatever_arrives(happened):
    fence, leaders = Fence(), {}
    before = fence.state
    for action, value, source in happened:
        if action == "command":
            passed = fence.check(value, source) is None
            state = fence.state
            if passed:
                fence.take(source, 0)
                assert (value.term, value.leader) == (state.term, state.leader)
                assert source == "safe_stop" or not state.stop.stopped
                assert source == "safe_stop" or value.stop == state.stop, (
                    "it knows the present epoch"
                )
                assert leaders.setdefault(value.term, value.leader) == value.leader
        elif action == "heard":
            fence.hear(value)
        elif action == "measure":
            fence.measure()
        else:
            fence.stop(StopCause.WATCHDOG, 0)
            assert fence.register.stopped
        state = fence.state
        assert state.term >= before.term and state.stop >= before.stop
        assert state.term > before.term or state.leader == before.leader
        before = state


def test_unanswered_measurements_are_counted():
    fence, leader = Fence(), Signature(1, "a")
    fence.measure()
    assert fence.state.unanswered == 0, "there was none before"
    for count in (1, 2, 3):
        fence.measure()
        assert fence.state.unanswered == count
    assert fence.check(Signature(0, "z"), "nmpc").code == "leader"
    fence.measure()
    assert fence.state.unanswered == 4, "a command of who does not lead answers nothing"
    fence.check(leader, "nmpc")
    fence.measure()
    assert fence.state == ActuatorState(1, "a", 0)


def test_unexecuted_stop_is_overdue():
    fence = Fence()
    fence.take("nmpc", 0)
    fence.register.stop(StopCause.OPERATOR, "anna", 0)
    due = []
    for _ in range(6):
        due.append(fence.overdue)
        fence.measure()
    assert due == [False] * 4 + [True] * 2
    fence.take("safe_stop", 0)
    fence.measure()
    assert not fence.overdue


stamps = st.integers(0, (2**31 - 1) * 10**9)  # of a message


@given(
    st.builds(
        ActuatorState,
        st.integers(0, 9),
        st.text(max_size=3),
        st.integers(0, 9),
        sources,
        stops,
        stamps,
    )
)
def test_the_actuators_state_survives_its_message(state):
    assert convert.actuator_state(convert.drives_message(Command(78.0, 400.0), 5, state)) == state


@given(signatures)
def test_a_signature_survives_its_message(signature):
    message = convert.command_message(Command(78.0, 400.0), 5, "nmpc")
    convert.sign(message, signature)
    assert convert.signature(message) == signature
