"""Texts of the alarms: one cause, one consequence, one action each; all are in ``alarms.yaml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any

from pydantic import BaseModel

from fsw_control.cause import Cause
from fsw_control.schema.yaml_text import load_yaml
from fsw_hmi.alarms import Alarm, Priority
from fsw_hmi.limits import Flag

#: advice that only helps while the weld is controlled
_OF_SET_POINTS = ("raise_temperature", "lower_temperature", "lower_depth")


class _Texts(BaseModel):
    """Content of ``alarms.yaml``."""

    kinds: dict[str, Alarm]
    sensors: dict[str, str]
    interlocks: dict[str, tuple[str, str]]
    limits: dict[str, tuple[str, str]]
    standby: dict[str, str]
    expected: dict[str, frozenset[str]]
    actions: dict[str, str]
    next_of_bag: dict[str, str]


def _texts() -> _Texts:
    content = load_yaml(files("fsw_hmi").joinpath("alarms.yaml").read_text(encoding="utf-8"))
    for kind in content["kinds"].values():
        kind["advice"] = ""  # by its code, when the alarm is made
    return _Texts(**content)


TEXTS = _texts()
#: by code: what to do, and by state of the recording the code when the weld is over
ACTIONS, NEXT_OF_BAG = TEXTS.actions, TEXTS.next_of_bag


def alarm(kind: str, cause: object = "", /, **values: object) -> Alarm:
    """An alarm of a kind, with ``values`` in its texts.

    ``cause`` is a code where there are several.
    """
    text = TEXTS.kinds[kind]
    parts = {key: getattr(text, key).format(**values) for key in ("what", "why", "action")}
    advice = ACTIONS[parts["action"]].format(**values)
    return replace(text, **parts, advice=advice, cause=str(cause))


def of_interlock(name: str, level: str) -> Alarm:
    """The alarm of an interlock that warns or has tripped."""
    what, action = TEXTS.interlocks.get(name, (name, "see_supervisor"))
    kind = level if level in ("warn", "trip") else "warn"
    if kind == "trip" and action in _OF_SET_POINTS:  # no set-point helps a stopped weld
        action = "inspect_first"
    return alarm(kind, name, what=what, action=action)


def of_limit(kind: str, flag: Flag) -> Alarm:
    """The alarm of a value outside a limit by which the weld is judged, or off its command."""
    what, unit = TEXTS.limits[flag["variable"]]
    low, high = flag["min"], flag["max"]
    if high is None:
        why = f"below {low:g}"
    elif low is None:
        why = f"above {high:g}"
    else:
        why = f"outside {low:g} to {high:g}"
    return alarm(kind, what=what, why=f"{why} {unit}")


def of_errors(node: str, errors: Sequence[tuple[str, str]]) -> Alarm:
    """The alarm of a node that reports errors, by part; the first is told."""
    (what, text), more = errors[0], len(errors) - 1
    why = (f"{what}: {text}" if what else text) + (f"; {more} more of its parts" if more else "")
    return alarm("part_error", what, node=node, why=why)


def flood(count: int, priority: Priority) -> Alarm:
    """The alarm that stands for so many of a priority."""
    return replace(alarm("flood", count=count), priority=priority)


def tripped(state: Mapping[str, Any]) -> str:
    """What the interlock says by which the weld stops; empty if another cause does."""
    if state["cause"] is not Cause.INTERLOCK_TRIP:
        return ""
    # not those that are tripped now: most of them are the stop's consequences
    names = [name for name in state["tripped"] if name in TEXTS.interlocks]
    return ", ".join(TEXTS.interlocks[name][0] for name in names)
