"""Messages that are missing are counted, and only these, however publishers come and go."""

from hypothesis import given
from hypothesis import strategies as st

from fsw_recorder.topic import Sequences


@given(st.lists(st.integers(1, 50), min_size=1, unique=True))
def test_single_publisher_gaps_are_counted_exactly(numbers):
    numbers.sort()
    sequences = Sequences()
    missing = sum(sequences.take(number, lambda: 1) for number in numbers)
    assert missing + len(numbers) == numbers[-1] - numbers[0] + 1


@given(st.lists(st.integers(0, 2), max_size=60), st.tuples(*[st.integers(1, 40)] * 3))
def test_lossless_publishers_have_no_gaps(order, first):
    sequences, following = Sequences(), list(first)
    for publisher in order:
        assert sequences.take(following[publisher], lambda: 3) == 0
        following[publisher] += 1


def test_a_publisher_that_was_started_again_begins_at_one():
    sequences = Sequences()
    taken = [sequences.take(number, lambda: 1) for number in (1, 2, 3, 1, 2, 4, 7)]
    assert taken == [0, 0, 0, 0, 0, 0, 2]


def test_a_gap_belongs_to_the_closest_sequence_before_it():
    sequences = Sequences()
    for number in (10, 100):
        sequences.take(number, lambda: 2)
    assert [sequences.take(number, lambda: 2) for number in (13, 101, 103, 14)] == [2, 0, 1, 0]
