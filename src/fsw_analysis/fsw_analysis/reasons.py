"""Reasons of recorded commands and of controllers' reports, of any version of the messages."""

from __future__ import annotations

from fsw_analysis.messages import Kind, Table
from fsw_control.host import NO_SET_POINT
from fsw_control.reason import Reason, ReasonCode

#: fields of a message that has a reason; those of bags before it was an enum have ``reason``, in
#: words
FIELDS: dict[str, Kind] = {
    "why.code": "number",
    "why.sensors": "texts",
    "why.limit": "number",
    "why.detail": "text",
    "why.subject": "text",
    "why.interlocks": "texts",
    "reason": "text",
}


def reasons(table: Table) -> list[Reason]:
    """The reason of each message; of older bags its words, as those of a controller of its own."""
    columns = (table.column(path).tolist() for path in FIELDS)
    return [
        _old(words)
        if code != code
        else Reason(
            ReasonCode(int(code)), tuple(sensors), limit_s, detail, subject, tuple(interlocks)
        )
        for code, sensors, limit_s, detail, subject, interlocks, words in zip(
            *columns, strict=True
        )
    ]


def _old(words: str) -> Reason:
    return NO_SET_POINT if words == NO_SET_POINT.words else Reason.of(words)
