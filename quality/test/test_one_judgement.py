"""One recorded weld, given to all who judge.

Record, recorded page, running page and campaign say the same.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any

import numpy as np
import pytest
import yaml

from fsw_analysis.judgement import Account, judge
from fsw_analysis.procedure import rule_book
from fsw_analysis.rule_book import RuleBook, default
from fsw_analysis.rules import Verdict
from fsw_analysis.weld_signals import WeldEvent, WeldSignals
from fsw_control.cause import Cause
from fsw_hmi import bag_view
from fsw_hmi.frames import COLUMNS
from fsw_hmi.live_weld import LiveWeld
from fsw_hmi.weld_view import Row
from fsw_quality.record import assemble
from fsw_quality.record_content import Record
from fsw_test_support.judged_weld import TICKS, good_weld, short_procedure

PROCEDURE = short_procedure()


def frozen(weld: WeldSignals) -> None:
    weld.temperature_c += np.random.default_rng(0).normal(0.0, 0.1, TICKS)
    weld.temperature_c[40:] = weld.temperature_c[40]


def one_nan(weld: WeldSignals) -> None:
    weld.temperature_c[30] = nan


def off_by_hand(weld: WeldSignals) -> None:
    weld.temperature_c[20:40] += 14.0
    weld.reference_temperature_c[20:40] += 14.0


def beyond(weld: WeldSignals) -> None:
    weld.temperature_c[30:40] = 920.0


def aborted(weld: WeldSignals) -> None:
    weld.events[-1] = WeldEvent(0.1 * TICKS, "weld", "aborted")


def held(weld: WeldSignals) -> None:
    weld.events.insert(1, WeldEvent(2.0, "weld", "held"))
    weld.events.insert(2, WeldEvent(5.0, "weld", "resumed"))


def by_hand(weld: WeldSignals) -> None:
    weld.actual_mode[20:25] = "manual"


#: what happened, and which rule decides; none: the weld is good
CASES: list[tuple[Callable[[WeldSignals], None], str, Verdict]] = [
    (lambda _: None, "all", Verdict.ACCEPT),
    (frozen, "sensor", Verdict.REVIEW),
    (one_nan, "essential", Verdict.REVIEW),
    (off_by_hand, "quality", Verdict.REVIEW),
    (beyond, "essential", Verdict.REJECT),
    (aborted, "complete", Verdict.REJECT),
    (held, "hold", Verdict.REVIEW),
    (by_hand, "mode", Verdict.REVIEW),
]


def weld_of(spoil: Callable[[WeldSignals], None], procedure: bool = True) -> WeldSignals:
    weld = good_weld()
    weld.programme_temperature_c = weld.reference_temperature_c.copy()
    weld.programme_depth_mm = weld.reference_depth_mm.copy()
    weld.custom = {"lost_messages": "0"}
    if procedure:
        changed = PROCEDURE.acceptance.model_copy(update={"tolerated_hold_s": 1.0})
        content = PROCEDURE.changed(acceptance=changed).model_dump(mode="json", exclude_none=True)
        weld.attachments["procedure.yaml"] = yaml.safe_dump(content).encode()
    spoil(weld)
    return weld


def states(weld: WeldSignals) -> list[str]:
    """State of the programme at each tick."""
    by_tick = np.full(weld.n_ticks, "running", object)
    for event in weld.events:
        if event.kind == "weld":
            by_tick[weld.time_s >= event.time_s - 1e-6] = {"resumed": "running"}.get(
                event.subject, event.subject
            )
    return list(by_tick)


def live(weld: WeldSignals, book: RuleBook) -> LiveWeld:
    """The page's judgement, given what the page gets."""
    page, state = LiveWeld(book), states(weld)
    assert weld.drives is not None
    for i in range(weld.n_ticks):
        phase = [name for name, begin_s in weld.phases if begin_s <= weld.time_s[i] + 1e-6][-1]
        progress: dict[str, Any] = {
            **{
                "state": state[i],
                "phase": phase,
                "angle_deg": weld.angle_deg[i],
                "length_mm": weld.travel_mm[i],
            },
            **{
                "depth_mm": weld.programme_depth_mm[i],
                "temperature_c": weld.programme_temperature_c[i],
            },
        }
        page.on_progress(progress)
        supervisor = {
            "actual_controller": "decentral",
            "actual_mode": weld.actual_mode[i],
            "interlocks": [],
        }
        page.on_state("a", supervisor | {"reason": "", "cause": Cause.STARTED, "by": ""})
        columns = {
            "depth_mm": weld.depth_mm,
            "temperature_c": weld.temperature_c,
            "torque_nm": weld.torque_nm,
            "force_kn": weld.drives.force_kn,
            "speed_rpm": weld.drives.speed_rpm,
            "reference_depth_mm": weld.reference_depth_mm,
            "reference_temperature_c": weld.reference_temperature_c,
            "command_force_kn": weld.force_kn,
            "command_speed_rpm": weld.speed_rpm,
            "angle_deg": weld.angle_deg,
        }
        values = [columns[name][i] if name in columns else nan for name in COLUMNS[1:]]
        page.add(Row(int(weld.stamp_ns[i]), tuple(values)), str(weld.command_source[i]))
    return page


def outside(account: Account | Record) -> list[tuple[Any, ...]]:
    return [
        (
            exceedance.limit.kind,
            exceedance.limit.variable,
            exceedance.begin_s,
            exceedance.samples,
            exceedance.missing,
            exceedance.beyond,
        )
        for exceedance in account.exceedances
    ]


@pytest.mark.parametrize(("spoil", "rule", "verdict"), CASES)
def test_record_and_pages_say_the_same_of_a_weld(
    spoil: Callable[[WeldSignals], None], rule: str, verdict: Verdict
) -> None:
    weld = weld_of(spoil)
    book = rule_book(weld.attachments)
    record, _ = assemble(weld, book)  # type: ignore[arg-type]  # it is a procedure
    recorded, page = bag_view.view(weld, "weld").summary["account"], live(weld, book)
    running, frame = page.account(), page.frame()
    assert running is not None and frame is not None
    assert (record.deciding.name, record.verdict) == (rule, verdict)
    assert (recorded["rule"], recorded["verdict"], frame["rule"], frame["verdict"]) == (
        rule,
        verdict,
        rule,
        verdict,
    )
    assert recorded["text"] == frame["text"]
    assert ("not on record" in frame["text"]) == (spoil is one_nan)
    assert (
        (recorded["level"] == "good") == (frame["level"] == "good") == (verdict is Verdict.ACCEPT)
    )
    of_record = outside(record)
    assert outside(running) == of_record and recorded["marks"] == frame["marks"]
    assert len(recorded["marks"]) == len(of_record) + len(record.unusable_at)
    assert ("frozen" in {sample.flaw for sample in record.unusable_at}) == (spoil is frozen)
    own = {(rule.name, rule.subject, str(rule.data)): rule.verdict for rule in record.rules}
    assert {
        (rule.name, rule.subject, str(rule.data)): rule.verdict for rule in running.rules
    }.items() <= own.items()


def test_the_page_judges_an_end_after_which_no_tick_comes() -> None:
    weld = weld_of(lambda _: None)
    weld.events[-1] = WeldEvent(1e3, "weld", "done")  # nothing ends within the ticks
    page = live(weld, rule_book(weld.attachments))
    account = page.account()
    assert account is not None and account.course.end == ""
    progress = {"state": "done", "phase": "joint_line", "angle_deg": 1.0, "length_mm": 10.0}
    page.on_progress(progress)
    account = page.account()
    assert account is not None and account.course.end == "done"
    page.on_progress(progress | {"state": "aborted"})
    account = page.account()
    assert account is not None and account.deciding.name == "complete"


@pytest.mark.parametrize(
    ("spoil", "rule", "verdict"), [case for case in CASES if case[1] != "hold"]
)
def test_without_a_procedure_the_defaults_judge_for_all(
    spoil: Callable[[WeldSignals], None], rule: str, verdict: Verdict
) -> None:
    weld = weld_of(spoil, procedure=False)
    book = default().changed(
        acceptance=default().acceptance.model_copy(update={"tolerated_share": 1.0})
    )
    running = live(weld, book).account()
    assert running is not None and running.verdict is judge(weld, book).verdict
    assert rule_book(weld.attachments) is default()
