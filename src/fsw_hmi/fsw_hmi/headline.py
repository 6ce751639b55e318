"""The line at the top of the page: whether the weld is good and, if not, what is worst.

The judgement of the weld so far is ``fsw_analysis.judgement``'s; what is worse, or more urgent,
comes before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from fsw_analysis.headline import VARIABLES
from fsw_hmi.alarm_rules import DONE

#: no ticks for longer than this: the values on the page are old
TICK_AGE_S = 0.5


@dataclass(frozen=True, slots=True)
class Now:
    """What the headline is made of, each as the page gets it."""

    tick_age_s: float | None = None  #: None before the first
    alarms: Sequence[Mapping[str, Any]] = ()  #: the worst first
    flags: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    state: Mapping[str, Any] = field(default_factory=dict)
    account: Mapping[str, Any] | None = None
    programme: str = ""  #: its state


def headline(now: Now) -> dict[str, str]:
    """Level, text and detail."""
    silent = now.tick_age_s is None or now.tick_age_s > TICK_AGE_S
    if now.programme == DONE and silent:
        return _urgent(now.alarms) or _end(now.account)
    if now.tick_age_s is None:
        return _line("attention", "No measurements yet")
    if now.tick_age_s > TICK_AGE_S:
        return _line(
            "high",
            "No measurements",
            f"for {now.tick_age_s:.0f} s" if now.tick_age_s >= 1.0 else "",
        )
    return (
        _urgent(now.alarms)
        or _of_flags(now.flags)
        or _of_state(now.state)
        or (_end(now.account) if now.programme == DONE else _of_account(now.account))
        or _of_alarms(now.alarms, "low")
        or _line("good", "Good", "every limit is kept so far")
    )


def _line(level: str, text: str, detail: str = "") -> dict[str, str]:
    return {"level": level, "text": text, "detail": detail}


def _urgent(alarms: Sequence[Mapping[str, Any]]) -> dict[str, str] | None:
    """The alarm that needs a person first: one that nobody has acknowledged before all others."""
    return (
        _of_alarms(alarms, "high", new=True)
        or _of_alarms(alarms, "medium", new=True)
        or _of_alarms(alarms, "high")
        or _of_alarms(alarms, "medium")
    )


def _of_alarms(
    alarms: Sequence[Mapping[str, Any]], priority: str, new: bool = False
) -> dict[str, str] | None:
    present = [one for one in alarms if one["state"] not in ("cleared", "shelved")]
    first = next(
        (
            one
            for one in present
            if one["priority"] == priority and (one["state"] == "active" or not new)
        ),
        None,
    )
    if first is None:
        return None
    more = f", {len(present) - 1} more" if len(present) > 1 else ""
    why = f"{first['why']} · " if first["why"] else ""
    return _line(priority, first["what"], f"{why}{priority} alarm{more}")


def _of_flags(flags: Mapping[str, Mapping[str, str]]) -> dict[str, str] | None:
    first = next(
        (name for level in ("high", "medium") for name in flags if flags[name]["level"] == level),
        None,
    )
    return (
        None
        if first is None
        else _line(
            flags[first]["level"], f"{VARIABLES[first].capitalize()}: {flags[first]['text']}"
        )
    )


def _of_state(state: Mapping[str, Any]) -> dict[str, str] | None:
    """What is wrong with the state is an alarm; the rest is what somebody wants."""
    if not state.get("known"):
        return _line("medium", "No supervisor", "nobody is known to command the weld")
    mode = state["actual_mode"]
    if mode == "auto":
        return None
    return _line(
        "high" if mode == "safe_stop" else "attention",
        f"In {mode.replace('_', ' ')}",
        state["reason"],
    )


def _end(account: Mapping[str, Any] | None) -> dict[str, str]:
    """The weld has ended as its programme has it: what the rules of its record say."""
    if account is None:
        return _line("attention", "Weld done", "not judged")
    return _line(account["level"], f"Weld done: {account['text']}", account["detail"])


def _of_account(account: Mapping[str, Any] | None) -> dict[str, str] | None:
    """How the weld so far is judged, by the rules of its record."""
    if account is None:
        return _line("attention", "Not judged yet")
    return (
        None
        if account["level"] == "good"
        else _line(account["level"], account["text"], account["detail"])
    )
