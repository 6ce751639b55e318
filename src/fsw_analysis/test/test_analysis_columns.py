"""Columns of serialized messages are what decoding each message gives."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_analysis.columns import MessageColumns
from fsw_recorder.definitions import Definitions

TYPE = "a_msgs/msg/A"
SCHEMA = """a_msgs/B[] items
string[] words
bool flag
float32[3] three
int16[] numbers
uint8 small
B one
string text
float64 last
================================================================================
MSG: a_msgs/B
int8 tiny
string name
uint64 large
"""
ITEM = "a_msgs/msg/B"
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=5)
item = st.tuples(st.integers(-128, 127), texts, st.integers(0, 2**53))
message = st.tuples(
    st.lists(item, max_size=3),
    st.lists(texts, max_size=3),
    st.booleans(),
    st.lists(st.integers(-1000, 1000), max_size=4),
    item,
    texts,
    st.floats(allow_nan=False),
)
store = Definitions().typestore(TYPE, SCHEMA)


def build(values: tuple) -> tuple[bytes, object]:  # type: ignore[type-arg]
    kinds = store.types

    def make(fields: tuple[int, str, int]) -> object:
        return kinds[ITEM](tiny=fields[0], name=fields[1], large=fields[2])

    items, words, flag, numbers, one, text, last = values
    built = kinds[TYPE](
        items=[make(fields) for fields in items],
        words=words,
        flag=flag,
        three=np.arange(3, dtype=np.float32),
        numbers=np.array(numbers, dtype=np.int16),
        small=7,
        one=make(one),
        text=text,
        last=last,
    )
    return bytes(store.serialize_cdr(built, TYPE)), built


@settings(deadline=None, max_examples=40)
@given(st.lists(message, min_size=1, max_size=8))
def test_equal_to_decoding_one_by_one(rows: list[tuple]) -> None:  # type: ignore[type-arg]
    payloads, built = zip(*[build(row) for row in rows + rows], strict=True)
    columns, good = MessageColumns(TYPE, SCHEMA).extract(
        payloads,
        {
            "flag": "number",
            "small": "number",
            "one.large": "number",
            "one.name": "text",
            "text": "text",
            "words": "texts",
            "numbers": "numbers",
            "last": "number",
            "missing": "number",
        },
    )
    assert good.all()
    for row, one in enumerate(built):
        assert columns["flag"][row] == one.flag and columns["small"][row] == 7
        assert columns["one.large"][row] == one.one.large and columns["one.name"][row] == one.one.name
        assert columns["text"][row] == one.text and columns["words"][row] == tuple(one.words)
        assert columns["numbers"][row].tolist() == one.numbers.tolist()
        assert columns["last"][row] == one.last
    assert np.isnan(columns["missing"]).all()


@settings(deadline=None, max_examples=40)
@given(message, st.data())
def test_damage_is_marked_and_never_raises(row: tuple, data: st.DataObject) -> None:  # type: ignore[type-arg]
    payload, _ = build(row)
    damaged = bytearray(payload)
    damaged[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    cut = payload[: data.draw(st.integers(0, len(payload) - 1))]
    columns, good = MessageColumns(TYPE, SCHEMA).extract(
        [cut, bytes(damaged), payload], {"last": "number", "text": "text"}
    )
    assert not good[0] and good[2]
    assert np.isnan(columns["last"][0]) and columns["last"][2] == row[-1]


def test_big_endian_messages_are_left_out() -> None:
    payload, built = build(([], [], True, [], (1, "a", 2), "b", 3.0))
    big_endian = bytes(store.serialize_cdr(built, TYPE, little_endian=False))
    columns, good = MessageColumns(TYPE, SCHEMA).extract([payload, big_endian, payload], {"last": "number"})
    assert good.tolist() == [True, False, True]
    assert np.array_equal(columns["last"], [3.0, np.nan, 3.0], equal_nan=True)


def test_paths() -> None:
    columns = MessageColumns(TYPE, SCHEMA)
    assert columns.has("one.name") and columns.has("last")
    assert not columns.has("two") and not columns.has("last.x") and not columns.has("one.two")
