"""What a controller lacks, in words, and as the messages number it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fsw_control.cause import Cause, Severity
from fsw_control.coded import Coded
from fsw_control.reason import Lack, Readiness, Reason

MESSAGES = Path(__file__).resolve().parents[2] / "fsw_msgs" / "msg"


@pytest.mark.parametrize(
    ("given", "why", "words"),
    [
        (Readiness(), "", ""),
        (Readiness(Lack.UNKNOWN), "is unknown", "nmpc is unknown"),
        (Readiness(Lack.INHIBITED, Reason.of("late")), "late", "nmpc is inhibited: late"),
        (Readiness(Lack.UNUSABLE, Reason.of("late")), "late", "nmpc is not usable: late"),
        (
            Readiness(Lack.WARMING, good=2, required=5),
            "2 of 5 good proposals in a row",
            "nmpc is not ready: 2 of 5 good proposals in a row",
        ),
        (
            Readiness(Lack.BLIND, sensors=("depth", "torque")),
            "requires the sensor depth, torque",
            None,
        ),
        (
            Readiness(Lack.INHIBITED, Reason.of("{detail} {0}")),
            "{detail} {0}",
            "nmpc is inhibited: {detail} {0}",
        ),
    ],
)
def test_words(given: Readiness, why: str, words: str | None) -> None:
    assert given.why == why
    assert given.words("nmpc") == (words if words is not None else f"nmpc {why}")


@pytest.mark.parametrize("kind", list(Lack))
def test_every_lack_has_words(kind: Lack) -> None:
    assert bool(Readiness(kind, Reason.of("x")).words("nmpc")) == (kind is not Lack.NONE)


@pytest.mark.parametrize("kind", list(Cause))
def test_every_cause_has_words(kind: Cause) -> None:
    assert kind.words


@pytest.mark.parametrize(
    ("message", "kind"),
    [("SupervisorState", Cause), ("ControllerHealth", Lack), ("Interlock", Severity)],
)
def test_the_messages_number_them_alike(message: str, kind: type[Coded]) -> None:
    text = (MESSAGES / f"{message}.msg").read_text(encoding="utf-8")
    numbers = {
        name: int(value)
        for name, value in re.findall(r"^uint8 ([A-Z_]+)=(\d+)$", text, re.MULTILINE)
    }
    assert numbers == {member.name: member.value for member in kind}


def test_unknown_codes_decode_safely() -> None:
    unknown = Cause(77)
    assert not unknown.on_request and not unknown.at_start and Lack(77) is not Lack.NONE
