"""Plain English for pages and tables of a judgement, from one table."""

from __future__ import annotations

from typing import Any, Literal

from fsw_analysis.judgement import Account
from fsw_analysis.rules import VARIABLES, Verdict
from fsw_control.weld import TICK_S

Level = Literal["good", "medium", "high"]
_LEVELS: dict[Verdict, Level] = {
    Verdict.ACCEPT: "good",
    Verdict.REVIEW: "medium",
    Verdict.REJECT: "high",
}


def page_account(account: Account, offset_s: float = 0.0) -> dict[str, Any]:
    """Headline and places on the unrolled canister, ready for JSON; ``offset_s``: to the page's clock."""
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
        "text": rule.title,
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
