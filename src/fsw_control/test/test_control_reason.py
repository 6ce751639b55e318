"""Reasons of commands: in words from one table, and as the messages number them.

So are requests and alarms.
"""

from __future__ import annotations

import re
from enum import IntEnum
from pathlib import Path
from types import SimpleNamespace

import pytest

from fsw_control.cause import AlarmChange, RequestKind
from fsw_control.reason import Reason, ReasonCode
from fsw_control.stop import StopCause

MESSAGES = Path(__file__).resolve().parents[2] / "fsw_msgs" / "msg"


@pytest.mark.parametrize("code", list(ReasonCode))
def test_every_reason_has_words(code: ReasonCode) -> None:
    assert (
        bool(Reason(code, ("depth",), 3.0, "x").words)
        == bool(Reason(code))
        == (code is not ReasonCode.NONE)
    )


def test_words_have_the_arguments() -> None:
    assert (
        Reason(ReasonCode.BLIND, ("depth", "torque"), 3.0).words
        == "no valid depth, torque for more than 3 s"
    )
    assert (
        Reason(ReasonCode.RAISED, detail="{0} {sensors}").words
        == "controller raised {0} {sensors}"
    )


@pytest.mark.parametrize("cause", [one for one in StopCause if one is not StopCause.NONE])
def test_stop_that_was_heard_of_says_its_cause_without_its_code(cause: StopCause) -> None:
    code = cause.name.lower()
    words, bare = (Reason(ReasonCode.STOP_HEARD, subject=one).words for one in (code, "?"))
    assert words != bare.replace("?", code) and "_" not in words


def test_words_of_a_controller_are_its_own() -> None:
    assert Reason.of("no set-point yet").code is ReasonCode.OTHER
    assert Reason.of("no depth").words == "no depth" and not Reason.of("")
    reason = Reason(ReasonCode.OVERFLOW)
    assert Reason.of(reason) is reason


def test_reason_carries_its_causes_as_a_chain() -> None:
    lost = Reason(ReasonCode.INVALID_SENSOR, ("depth",))
    failed = Reason(ReasonCode.FAILED, subject="nmpc", because=lost)
    held = Reason(ReasonCode.TIMEOUT, limit_s=30.0, subject="hold", because=failed)
    assert held.words == "hold for 30 s: nmpc failed: invalid sensor: depth"
    assert held.chain == [held.head, failed.head, lost] and held.head.because is None
    messages = [SimpleNamespace(**item.fields) for item in held.chain]
    assert Reason.of_messages(messages) == held
    assert Reason.of_messages([]) == Reason() and Reason().chain == []


@pytest.mark.parametrize(
    ("kind", "message"),
    [(ReasonCode, "Reason"), (RequestKind, "OperatorAction"), (AlarmChange, "AlarmEvent")],
)
def test_messages_number_them_alike(kind: type[IntEnum], message: str) -> None:
    text = (MESSAGES / f"{message}.msg").read_text("utf-8")
    numbers = {
        name: int(number)
        for name, number in re.findall(r"^uint8 ([A-Z_]+)=(\d+)$", text, re.MULTILINE)
    }
    assert numbers == {member.name: member.value for member in kind}


def test_codes_of_later_versions_are_unknown() -> None:
    assert ReasonCode(99) is ReasonCode.UNKNOWN and AlarmChange(99) is AlarmChange.UNKNOWN
    assert RequestKind(99) is RequestKind.of("dance") is RequestKind.UNKNOWN
    assert RequestKind.of("set_reference") is RequestKind.SET_REFERENCE
