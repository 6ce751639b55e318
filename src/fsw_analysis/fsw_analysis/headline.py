"""Plain English for pages and tables of a judgement, from one table."""

from __future__ import annotations

from typing import Any, Literal

from fsw_analysis.judgement import Account
from fsw_analysis.rule_book import Bounds
from fsw_analysis.rules import VARIABLES, FactCode, Rule, Verdict
from fsw_control.weld import TICK_S

Level = Literal["good", "medium", "high"]
_LEVELS: dict[Verdict, Level] = {
    Verdict.ACCEPT: "good",
    Verdict.REVIEW: "medium",
    Verdict.REJECT: "high",
}
_NOT_ON_RECORD, _UNSEEN = "not on record", "this page has not seen a part of the weld"
#: rules of which the finding says all
_OF_ITSELF = ("complete", "recording", "hold", "swaps", "mode", "interlocks")


def page_account(account: Account, offset_s: float = 0.0, recorded: bool = True) -> dict[str, Any]:
    """Headline and places on the unrolled canister, ready for JSON.

    ``offset_s``: to the page's clock; ``recorded``: gaps are of the record, not of this page.
    """
    rule = account.deciding
    place, gaps = account.course.place, account.course.gaps
    worst = next(rule.verdict for rule in account.rules if rule.name == "recording")
    gap: tuple[Level, str] = (_LEVELS[worst], _NOT_ON_RECORD) if recorded else ("medium", _UNSEEN)
    marks = [
        _mark(*gap, begin_s + offset_s, lasts_s, place(begin_s, lasts_s))
        for begin_s, lasts_s in gaps
    ]
    for run in account.unusable:
        lasts_s, text = run.end_s - run.begin_s + TICK_S, f"sensor {run.sensor}: {run.flaw}"
        at_s, where = run.begin_s + offset_s, place(run.begin_s, lasts_s)
        marks.append(_mark("medium", text, at_s, lasts_s, where))
    for over in account.exceedances:
        state = "missing" if over.missing == over.samples else "outside"
        text = f"{VARIABLES[over.limit.variable]} {state}: {over.limit.words}"
        is_worst = over.limit.kind == "essential" and state == "outside"
        level: Level = "high" if is_worst else "medium"
        at_s = over.begin_s + offset_s
        marks.append(_mark(level, text, at_s, over.duration_s, over.angle_deg))
    shown = {
        "verdict": str(rule.verdict),
        "level": _LEVELS[rule.verdict],
        "rule": rule.name,
        "text": rule.title,
        "detail": _detail(rule),
        "marks": marks,
    }
    if gaps and not recorded and rule.verdict is Verdict.ACCEPT:  # who has not seen, cannot judge
        shown |= {"level": "medium", "text": "Not seen throughout", "detail": _UNSEEN}
    return shown


def _detail(rule: Rule) -> str:
    """What decides, without figures that change at every tick."""
    if rule.verdict is Verdict.ACCEPT:
        return "every limit is kept"
    if "variable" not in rule.data:
        return rule.figure if rule.name in _OF_ITSELF else f"{rule.words}: {rule.figure}"
    limit, facts = Bounds(**rule.data), {fact.code: fact for fact in rule.facts}
    parts = [facts[code].words for code in (FactCode.BEYOND, FactCode.MISSING) if code in facts]
    often = "outside once" if facts[FactCode.OUTSIDE].data["times"] == 1 else "outside repeatedly"
    label = VARIABLES.get(limit.variable, limit.variable)
    return ", ".join([f"{label} {limit.span}: {often}", *parts])


def gap_mark(
    begin_s: float, lasts_s: float, place: tuple[float, float] | None, verdict: Verdict
) -> dict[str, Any]:
    """The mark of a time that is not on record, at a time of the page."""
    return _mark(_LEVELS[verdict], _NOT_ON_RECORD, begin_s, lasts_s, place)


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
