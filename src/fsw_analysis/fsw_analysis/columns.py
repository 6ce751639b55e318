"""Reads fields of many serialized messages of one type at once, as numpy arrays.

Decoding the messages of a 45-minute weld one by one takes several times as long. The offsets of a message's fields
depend only on the lengths of its strings and sequences; so one message is walked to find them, and all messages with
the same lengths are one structured array. Encoding: little-endian OMG CDR (XCDR1), aligned to at most 8 after the
4-byte header.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count, takewhile
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype

from fsw_recorder.definitions import Definitions

Kind = Literal["number", "text", "numbers", "texts"]
#: per kind: float64 (n,), object (n,) of str, object (n,) of float64 arrays, object (n,) of tuples of str
Column = npt.NDArray[Any]
Fields = Mapping[str, Sequence[tuple[str, Any]]]

_MISSING: dict[Kind, Any] = {"number": np.nan, "text": "", "numbers": np.empty(0), "texts": ()}
_CODES = {
    **dict.fromkeys(("bool", "byte", "char", "uint8"), "u1"),
    **{"int8": "i1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float32": "f4", "float64": "f8"},
}
_HEADER_BYTES = 4
_MOST_ELEMENTS = 1_000_000


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
        self._fields: Fields = {name: list(one[1]) for name, one in store.fielddefs.items()}
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
        columns: dict[str, Column] = {}
        for path, kind in wanted.items():
            columns[path] = np.full(len(payloads), np.nan) if kind == "number" else np.empty(len(payloads), object)
            columns[path][:] = [_MISSING[kind]] * len(payloads)
        good = np.ones(len(payloads), dtype=bool)
        by_size: dict[int, list[int]] = {}
        for row, payload in enumerate(payloads):
            by_size.setdefault(len(payload), []).append(row)
        for size, row_list in by_size.items():
            rows = np.array(row_list)
            messages = np.frombuffer(b"".join(payloads[row] for row in row_list), f"V{size}" if size else "u1")
            while rows.size:
                try:
                    layout = _Layout(self._fields, self._type_name, payloads[int(rows[0])])
                except ValueError:
                    good[rows[0]] = False
                    rows, messages = rows[1:], messages[1:]
                    continue
                fields = messages.view(layout.dtype())
                same = np.all([fields[name] == fields[name][0] for name in layout.lengths], axis=0)
                for path, kind in wanted.items():
                    _fill(columns[path], rows[same], fields[same], path, kind)
                rows, messages = rows[~same], messages[~same]
        return columns, good


class _Layout:
    """Formats and offsets of one message's fields; raises ValueError where the message is damaged.

    Messages that agree in all ``lengths`` (and the encoding) agree in all offsets.
    """

    def __init__(self, fields: Fields, type_name: str, payload: bytes) -> None:
        if len(payload) < _HEADER_BYTES or payload[:2] != b"\0\1":
            raise ValueError("not plain little-endian CDR")
        self._fields, self._payload = fields, payload
        self._at = _HEADER_BYTES
        self._places: dict[str, tuple[Any, int]] = {"#encoding": ("u2", 0)}
        self.lengths = ["#encoding"]
        self._message(type_name, "")

    def dtype(self) -> np.dtype[np.void]:
        """Type of the whole message as an element of a structured array."""
        formats, offsets = zip(*self._places.values(), strict=True)
        description = {"names": list(self._places), "formats": formats, "offsets": offsets}
        return np.dtype({**description, "itemsize": len(self._payload)})  # type: ignore[call-overload, no-any-return]

    def _message(self, type_name: str, prefix: str) -> None:
        for name, description in self._fields[type_name]:
            self._field(f"{prefix}{name}", description)

    def _field(self, path: str, description: Any) -> None:
        kind, detail = description
        if kind == Nodetype.NAME:
            self._message(detail, f"{path}.")
        elif kind == Nodetype.BASE and detail[0] == "string":
            size = self._length(path)
            self._place(path, f"S{size}", size)
        elif kind == Nodetype.BASE:
            self._numbers(path, detail[0], ())
        else:
            inner, elements = detail
            if kind == Nodetype.SEQUENCE:
                elements = self._length(path)
            if elements > min(len(self._payload), _MOST_ELEMENTS):
                raise ValueError("sequence longer than the message")
            if inner[0] == Nodetype.BASE and inner[1][0] in _CODES:
                self._numbers(path, inner[1][0], (elements,))
            else:
                for index in range(elements):
                    self._field(f"{path}[{index}]", inner)

    def _numbers(self, path: str, name: str, shape: tuple[int, ...]) -> None:
        if name not in _CODES:
            raise ValueError(f"{name} is not supported")
        code = np.dtype(_CODES[name])
        if shape == (0,):
            return  # not even aligned
        self._align(code.itemsize)
        self._place(path, (code, shape), code.itemsize * (shape[0] if shape else 1))

    def _length(self, path: str) -> int:
        self._align(4)
        name = f"#{path}"
        self.lengths.append(name)
        self._place(name, "u4", 4)
        return int.from_bytes(self._payload[self._at - 4 : self._at], "little")

    def _place(self, path: str, form: Any, size: int) -> None:
        self._places[path] = (form, self._at)
        self._at += size
        if self._at > len(self._payload):
            raise ValueError("message too short")

    def _align(self, size: int) -> None:
        self._at += -(self._at - _HEADER_BYTES) % size


def _fill(column: Column, rows: npt.NDArray[np.int64], fields: npt.NDArray[Any], path: str, kind: Kind) -> None:
    """Put the values of a field into the rows; nothing where the messages have no such field of that kind."""
    names = fields.dtype.names or ()
    values: Sequence[Any] = ()
    if kind == "texts":
        items = takewhile(names.__contains__, (f"{path}[{index}]" for index in count()))
        values = list(zip(*(_texts(fields[item]) for item in items), strict=True))
    elif path in names and (fields[path].dtype.kind == "S") == (kind == "text"):
        found = fields[path]
        if kind == "number" and found.ndim == 1:
            column[rows] = found
        elif kind == "text":
            values = _texts(found)
        elif kind == "numbers" and found.ndim == 2:
            values = list(found.astype(float))
    for row, value in zip(rows, values, strict=False):
        column[row] = value


def _texts(values: npt.NDArray[np.bytes_]) -> list[str]:
    raw = values.tolist()
    words = {one: one.decode("utf-8", "replace") for one in set(raw)}
    return [words[one] for one in raw]
