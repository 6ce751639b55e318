"""Plain English for pages and tables of a judgement, from one table."""

from __future__ import annotations

from typing import Any, Literal

from fsw_analysis.judgement import Account
from fsw_analysis.rules import FactCode, Rule, Verdict
from fsw_control.sensors import SENSORS
from fsw_control.weld import TICK_S

Level = Literal["good", "medium", "high"]
_LEVELS: dict[Verdict, Level] = {
    Verdict.ACCEPT: "good",
    Verdict.REVIEW: "medium",
    Verdict.REJECT: "high",
}
VARIABLES = {
    **{row.signal: row.label.lower() for row in SENSORS.values()},
    "force_kn": "force",
    "speed_rpm": "speed",
    "power_kw": "power",
    "traverse_mm_per_min": "traverse speed",
    "depth_error_mm": "depth error",
    "temperature_error_c": "temperature error",
    "set_point_depth_mm": "set-point of the depth",
    "set_point_temperature_c": "set-point of the temperature",
}
#: by name of the rule that decides
_TITLES = {
    "all": "Good",
    "complete": "Programme not completed",
    "recording": "Record incomplete",
    "essential": "{subject} beyond an essential limit",
    "quality": "{subject} outside its quality limit",
    "set-point": "{subject} outside the permitted range",
    "missing": "{subject} not on record throughout",
    "procedure": "Welded by another procedure",
    "sensor": "Sensor {subject} not usable throughout",
    "controller": "Commands from a source that is not permitted",
    "tuning": "Controller {subject} with another tuning",
    "tool": "Another tool than specified",
    "tool_life": "Tool beyond its life",
    "machine": "Another machine than specified",
    "hold": "Programme held too long",
    "swaps": "Controller changed",
    "mode": "Not in automatic control throughout",
    "interlocks": "Interlock tripped",
}

#: rules of which a missing sample breaks one, too
_LIMITS = ("essential", "quality", "set-point")


def title(rule: Rule) -> str:
    """The deciding rule, in a few words."""
    codes = {fact.code for fact in rule.facts}
    lacks = FactCode.MISSING in codes and FactCode.BEYOND not in codes and rule.name in _LIMITS
    words = _TITLES["missing" if lacks else rule.name]
    words = words.format(subject=VARIABLES.get(rule.subject, rule.subject))
    return words[:1].upper() + words[1:]


def page_account(account: Account, offset_s: float = 0.0) -> dict[str, Any]:
    """Headline and places on the unrolled canister, ready for JSON.

    ``offset_s``: to the page's clock.
    """
    rule = account.deciding
    good = rule.verdict is Verdict.ACCEPT
    place = account.course.place
    marks = [
        gap_mark(begin_s + offset_s, lasts_s, place(begin_s, lasts_s))
        for begin_s, lasts_s in account.course.gaps
    ]
    for run in account.unusable:
        lasts_s, text = run.end_s - run.begin_s + TICK_S, f"sensor {run.sensor}: {run.flaw}"
        at_s, where = run.begin_s + offset_s, place(run.begin_s, lasts_s)
        marks.append(_mark("medium", text, at_s, lasts_s, where))
    for over in account.exceedances:
        state = "missing" if over.missing == over.samples else "outside"
        text = f"{VARIABLES[over.limit.variable]} {state}: {over.limit.words}"
        level: Level = "high" if over.limit.kind == "essential" else "medium"
        at_s = over.begin_s + offset_s
        marks.append(_mark(level, text, at_s, over.duration_s, over.angle_deg))
    return {
        "verdict": str(rule.verdict),
        "level": _LEVELS[rule.verdict],
        "rule": rule.name,
        "text": title(rule),
        "detail": "every limit is kept" if good else f"{rule.words}: {rule.figure}",
        "marks": marks,
    }


def gap_mark(begin_s: float, lasts_s: float, place: tuple[float, float] | None) -> dict[str, Any]:
    """The mark of a time that is not on record, at a time of the page."""
    return _mark("high", "not on record", begin_s, lasts_s, place)


def _mark(
    level: Level, text: str, begin_s: float, lasts_s: float, place: tuple[float, float] | None
) -> dict[str, Any]:
    return {
        "level": level,
        "text": text,
        "time_s": round(begin_s, 3),
        "lasts_s": round(lasts_s, 3),
        "from_deg": None if place is None else round(place[0], 3),
        "to_deg": None if place is None else round(place[1], 3),
    }
