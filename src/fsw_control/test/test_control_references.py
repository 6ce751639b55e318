"""Which reference holds, for who hears all and for who starts in mid-weld."""

import pytest

from fsw_control.contract import Reference
from fsw_control.references import ReferenceQueue

SECOND = 1_000_000_000
REFERENCE, OTHER, THIRD = Reference(2.66, 850.0), Reference(2.86, 850.0), Reference(2.5, 840.0)


def test_reference_begins_at_its_stamp():
    queue = ReferenceQueue()
    assert queue.at(0) is None
    queue.add(0, REFERENCE)
    queue.add(2 * SECOND, OTHER)
    assert [queue.at(k * SECOND) for k in range(4)] == [REFERENCE, REFERENCE, OTHER, OTHER]


def test_past_and_foreign_stamps_begin_at_once():
    queue = ReferenceQueue()
    queue.add(SECOND, REFERENCE)
    assert queue.at(5 * SECOND) == REFERENCE
    queue.add(1_700_000_000 * SECOND, OTHER)
    assert queue.at(6 * SECOND) == OTHER


def test_a_newer_message_overrides_one_held_back():
    queue = ReferenceQueue()
    queue.add(9 * SECOND, OTHER)
    assert queue.at(SECOND) is None
    queue.add(0, REFERENCE)
    assert [queue.at(k * SECOND) for k in (2, 9, 10)] == [REFERENCE] * 3


def test_who_starts_in_mid_weld_begins_with_what_is_handed_on():
    queue = ReferenceQueue()
    queue.hand_on(3 * SECOND, OTHER)
    assert queue.at(5 * SECOND) == OTHER
    queue.hand_on(6 * SECOND, THIRD)
    assert queue.at(7 * SECOND) == THIRD, "until there is something of its own"
    queue.add(0, REFERENCE)
    assert queue.at(8 * SECOND) == REFERENCE
    queue.hand_on(8 * SECOND, THIRD)
    assert queue.at(9 * SECOND) == REFERENCE


def test_who_was_here_hears_for_himself():
    queue = ReferenceQueue()
    queue.add(0, REFERENCE)
    queue.at(SECOND)
    for since_s in (1, 5):
        queue.hand_on(since_s * SECOND, OTHER)
        assert queue.at(5 * SECOND) == REFERENCE


@pytest.mark.parametrize("handed_on_first", [False, True])
@pytest.mark.parametrize("ticks_between", [0, 2])
def test_what_a_sender_that_is_still_here_sent_for_earlier_is_superseded(handed_on_first, ticks_between):
    queue = ReferenceQueue()
    calls = [
        lambda: [queue.add(k * SECOND, reference) for k, reference in ((1, REFERENCE), (3, THIRD), (20, REFERENCE))],
        lambda: queue.hand_on(5 * SECOND, OTHER),
    ]
    first, second = reversed(calls) if handed_on_first else calls
    first()
    for k in range(ticks_between):
        queue.at((10 + k) * SECOND)
    second()
    assert [queue.at(k * SECOND) for k in (12, 19, 20)] == [OTHER, OTHER, REFERENCE]


def test_a_sender_that_says_now_is_believed_before_what_is_handed_on():
    queue = ReferenceQueue()
    queue.hand_on(5 * SECOND, OTHER)
    queue.add(0, REFERENCE)
    assert queue.at(10 * SECOND) == REFERENCE


def test_when_time_begins_anew_own_references_count():
    queue = ReferenceQueue()
    queue.hand_on(100 * SECOND, OTHER)
    assert queue.at(101 * SECOND) == OTHER
    assert queue.at(SECOND) == OTHER
    queue.add(2 * SECOND, REFERENCE)
    assert queue.at(2 * SECOND) == REFERENCE
