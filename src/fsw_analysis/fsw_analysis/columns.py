"""Reads fields of many serialized messages of one type at once, as numpy arrays.

Decoding a 45-minute weld message by message takes minutes, in whatever library. The offsets of a message's fields
depend only on the lengths of its strings and sequences; so messages of equal size are compared in these length words,
one of each group is walked to find the offsets, and the group's values are taken as columns of a byte matrix: a second,
without any message class. Encoding: OMG CDR (XCDR1), alignment counted after the 4-byte header, at most 8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype

from fsw_recorder.definitions import Definitions

Kind = Literal["number", "text", "numbers", "texts"]
#: per kind: float64 (n,), object (n,) of str, object (n,) of float64 arrays, object (n,) of tuples of str
Column = npt.NDArray[Any]

_CODES = {
    **dict.fromkeys(("bool", "byte", "char", "uint8"), "u1"),
    **{"int8": "i1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float32": "f4", "float64": "f8"},
}
_HEADER_BYTES = 4
_MOST_ELEMENTS = 1_000_000


@dataclass(slots=True)
class _Layout:
    """Where the fields of one message are: numbers (offset, code, count), texts (offset, size), lists (count).

    ``guards`` are the offsets of all lengths: messages that agree there agree in all offsets.
    """

    order: Literal["little", "big"]
    numbers: dict[str, tuple[int, str, int]] = field(default_factory=dict)
    texts: dict[str, tuple[int, int]] = field(default_factory=dict)
    lists: dict[str, int] = field(default_factory=dict)
    guards: list[int] = field(default_factory=list)


class MessageColumns:
    """Columns of messages of one type.

    Parameters
    ----------
    type_name : str
        E.g. ``fsw_msgs/msg/ShoulderDepth``.
    definition : str
        Its ``ros2msg`` definition with all nested ones, as the bag holds it.

    Raises
    ------
    BagError
        The definition cannot be parsed.
    """

    def __init__(self, type_name: str, definition: str) -> None:
        store = Definitions().typestore(type_name, definition)
        self._fields: dict[str, list[tuple[str, Any]]] = {name: list(one[1]) for name, one in store.fielddefs.items()}
        self._type_name = type_name

    def has(self, path: str) -> bool:
        """Whether the type has a field of this path, e.g. ``header.stamp.sec``."""
        type_name = self._type_name
        *parents, last = path.split(".")
        for parent in parents:
            kind, type_name = dict(self._fields[type_name]).get(parent, (None, ""))
            if kind != Nodetype.NAME:
                return False
        return last in dict(self._fields[type_name])

    def extract(
        self, payloads: Sequence[bytes], wanted: Mapping[str, Kind]
    ) -> tuple[dict[str, Column], npt.NDArray[np.bool_]]:
        """Take fields out of many messages.

        Parameters
        ----------
        payloads : sequence of bytes, length n
            Serialized messages.
        wanted : mapping
            Path of each field and what it is.

        Returns
        -------
        columns : dict of arrays, shape (n,)
            NaN, empty text or empty sequence where a message is damaged or has no such field.
        good : bool array, shape (n,)
            False where a message is damaged.
        """
        count = len(payloads)
        columns: dict[str, Column] = {}
        for path, kind in wanted.items():
            columns[path] = np.full(count, np.nan) if kind == "number" else np.empty(count, dtype=object)
            if kind != "number":
                columns[path][:] = [{"text": "", "texts": (), "numbers": np.empty(0)}[kind]] * count
        good = np.ones(count, dtype=bool)
        by_size: dict[int, list[int]] = {}
        for row, payload in enumerate(payloads):
            by_size.setdefault(len(payload), []).append(row)
        for size, row_list in by_size.items():
            rows = np.array(row_list)
            matrix = np.frombuffer(b"".join(payloads[row] for row in row_list), np.uint8).reshape(len(row_list), size)
            while rows.size:
                try:
                    layout = self._layout(payloads[int(rows[0])])
                except ValueError:
                    good[rows[0]] = False
                    rows, matrix = rows[1:], matrix[1:]
                    continue
                same = (matrix[:, :2] == matrix[0, :2]).all(axis=1)
                for guard in layout.guards:
                    same &= (matrix[:, guard : guard + 4] == matrix[0, guard : guard + 4]).all(axis=1)
                for path, kind in wanted.items():
                    _fill(columns[path], rows[same], matrix[same], layout, path, kind)
                rows, matrix = rows[~same], matrix[~same]
        return columns, good

    def _layout(self, payload: bytes) -> _Layout:
        if len(payload) < _HEADER_BYTES or payload[0] != 0 or payload[1] > 1:
            raise ValueError("not plain CDR")
        layout = _Layout("little" if payload[1] else "big")
        _Walk(self._fields, payload, layout).message(self._type_name, "")
        return layout


class _Walk:
    """Finds the offsets of one message's fields; raises ValueError where it is damaged."""

    def __init__(self, fields: Mapping[str, list[tuple[str, Any]]], payload: bytes, layout: _Layout) -> None:
        self._fields, self._payload, self._layout = fields, payload, layout
        self._at = _HEADER_BYTES

    def message(self, type_name: str, prefix: str) -> None:
        for name, description in self._fields[type_name]:
            self._field(f"{prefix}{name}", description)

    def _field(self, path: str, description: Any) -> None:
        kind, detail = description
        if kind == Nodetype.BASE:
            if detail[0] in _CODES:
                self._numbers(path, detail[0], 1)
            elif detail[0] == "string":
                size = self._length()
                self._layout.texts[path] = (self._at, max(size - 1, 0))
                self._skip(size)
            else:
                raise ValueError(f"{detail[0]} is not supported")
        elif kind == Nodetype.NAME:
            self.message(detail, f"{path}.")
        else:
            inner, count = detail
            if kind == Nodetype.SEQUENCE:
                count = self._length()
            if count > min(len(self._payload), _MOST_ELEMENTS):
                raise ValueError("sequence longer than the message")
            self._layout.lists[path] = count
            if inner[0] == Nodetype.BASE and inner[1][0] in _CODES:
                if count:
                    self._numbers(path, inner[1][0], count)
                return
            for index in range(count):
                self._field(f"{path}[{index}]", inner)

    def _numbers(self, path: str, name: str, count: int) -> None:
        code = _CODES[name]
        self._align(int(code[1]))
        self._layout.numbers[path] = (self._at, code, count)
        self._skip(int(code[1]) * count)

    def _length(self) -> int:
        self._align(4)
        self._layout.guards.append(self._at)
        self._skip(4)
        return int.from_bytes(self._payload[self._at - 4 : self._at], self._layout.order)

    def _align(self, size: int) -> None:
        self._at += -(self._at - _HEADER_BYTES) % size

    def _skip(self, size: int) -> None:
        self._at += size
        if self._at > len(self._payload):
            raise ValueError("message too short")


def _fill(
    column: Column, rows: npt.NDArray[np.int64], group: npt.NDArray[np.uint8], layout: _Layout, path: str, kind: Kind
) -> None:
    if kind == "number" and path in layout.numbers:
        column[rows] = _numbers(group, layout, path)[:, 0]
    elif kind == "text" and path in layout.texts:
        column[rows] = _texts(group, *layout.texts[path])
    elif kind == "numbers" and path in layout.numbers:
        for row, values in zip(rows, _numbers(group, layout, path).astype(float), strict=True):
            column[row] = values
    elif kind == "texts":
        names = [f"{path}[{index}]" for index in range(layout.lists.get(path, 0))]
        parts = [_texts(group, *layout.texts[name]) for name in names if name in layout.texts]
        for position, row in enumerate(rows):
            column[row] = tuple(part[position] for part in parts)


def _numbers(group: npt.NDArray[np.uint8], layout: _Layout, path: str) -> npt.NDArray[Any]:
    offset, code, count = layout.numbers[path]
    raw = np.ascontiguousarray(group[:, offset : offset + int(code[1]) * count])
    return raw.view(np.dtype(code).newbyteorder("<" if layout.order == "little" else ">"))


def _texts(group: npt.NDArray[np.uint8], offset: int, size: int) -> npt.NDArray[np.object_]:
    result = np.empty(len(group), dtype=object)
    if not size:
        result[:] = ""
        return result
    words: dict[bytes, str] = {}
    for row, key in enumerate(np.ascontiguousarray(group[:, offset : offset + size]).view(f"V{size}")[:, 0].tolist()):
        if key not in words:
            words[key] = key.decode("utf-8", "replace")
        result[row] = words[key]
    return result
