"""The verdict: no weld outside an essential limit is accepted, and missing data never make a verdict better."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fsw_analysis.course import course_of
from fsw_analysis.procedure import Procedure, WeldData, digest
from fsw_analysis.rules import Fact, FactCode, Verdict
from fsw_analysis.weld_signals import DriveSignals, FusedSignals, WeldEvent, WeldSignals
from fsw_control.cause import Cause
from fsw_quality.record import assemble, attached_procedures, welded
from fsw_quality.record_content import Record
from fsw_test_support.judged_weld import DWELL, TICKS, good_weld, short_procedure

ORDER = list(Verdict)
PROCEDURE = short_procedure()
COMPLETE = {"lost_messages": "0"}
JOINT_LINE = {"name": "joint_line", "to_deg": 1.0, "source": "test"}
TICK = st.integers(0, TICKS - 1)
#: arrays of a weld that the sensors and drives fill
ARRAYS = ("depth_mm", "torque_nm", "temperature_c", "force_kn", "speed_rpm")


def judged(
    weld: WeldSignals, procedure: Procedure = PROCEDURE, custom: dict[str, str] = COMPLETE
) -> Record:
    return assemble(replace(weld, custom=custom), procedure)[0]


def unknown(record: Record) -> set[FactCode]:
    return {fact.code for fact in record.cannot_say}


def array(weld: WeldSignals, name: str) -> Any:
    return getattr(weld.drives if name in ("force_kn", "speed_rpm") else weld, name)


def without(weld: WeldSignals, ticks: list[int]) -> WeldSignals:
    """A weld without some ticks on any topic."""
    kept = np.setdiff1d(np.arange(weld.n_ticks), ticks)

    def cut(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value[kept]
        if isinstance(value, DriveSignals):
            return DriveSignals(value.force_kn[kept], value.speed_rpm[kept])
        return value

    return replace(weld, **{field.name: cut(getattr(weld, field.name)) for field in fields(weld)})


def test_a_good_weld_is_accepted() -> None:
    record = judged(good_weld())
    assert record.verdict is Verdict.ACCEPT and record.deciding.name == "all"
    assert (
        not record.exceedances
        and not record.gaps
        and not any(record.missing[name] for name in ARRAYS)
    )
    assert [phase.phase for phase in record.phases] == ["dwell", "joint_line", "whole weld"]


LIMITS = [
    *(("temperature_c", below) for below in (789.9, 910.1)),
    ("depth_mm", 3.71),
    ("torque_nm", 1601.0),
    ("force_kn", 59.9),
    ("force_kn", 97.1),
    ("speed_rpm", 299.0),
    ("speed_rpm", 501.0),
]


@given(st.sampled_from(LIMITS), TICK, st.integers(1, 10))
def test_one_sample_outside_an_essential_limit_is_never_accepted(
    limit: tuple[str, float], tick: int, ticks: int
) -> None:
    weld, (name, value) = good_weld(), limit
    array(weld, name)[tick : tick + ticks] = value
    record = judged(weld)
    own = [
        exceedance
        for exceedance in record.exceedances
        if exceedance.limit.kind == "essential" and exceedance.limit.variable == name
    ]
    assert [run.samples for run in own] == [min(ticks, TICKS - tick)]
    assert own[0].begin_s == pytest.approx(0.1 * (tick + 1)) and own[0].extreme == value
    assert record.verdict is (Verdict.REJECT if own[0].samples > 3 else Verdict.REVIEW)
    assert record.deciding.name == "essential"


@st.composite
def spoilt(draw: st.DrawFn) -> WeldSignals:
    """A weld with some samples anywhere, far outside or a little."""
    weld = good_weld()
    for _ in range(draw(st.integers(0, 4))):
        values, begin = array(weld, draw(st.sampled_from(ARRAYS))), draw(TICK)
        values[begin : begin + draw(st.integers(1, 12))] *= draw(
            st.sampled_from((0.5, 0.985, 1.015, 1.5))
        )
    if draw(st.booleans()):
        begin = draw(TICK)
        weld.actual_mode[begin : begin + 5] = draw(
            st.sampled_from(("hold", "manual", "safe_stop"))
        )
    if draw(st.booleans()):
        weld.command_source[draw(TICK) :] = draw(st.sampled_from(("nmpc", "manual", "stranger")))
    return weld


@given(spoilt(), st.data())
def test_missing_data_never_make_a_verdict_better(weld: WeldSignals, data: st.DataObject) -> None:
    whole, custom = judged(weld).verdict, dict(COMPLETE)
    poorer = deepcopy(weld)
    for name in (*ARRAYS, "angle_deg", "reference_depth_mm", "reference_temperature_c"):
        array(poorer, name)[data.draw(st.lists(TICK, max_size=6))] = np.nan
    for texts in (poorer.command_source, poorer.actual_mode):
        texts[data.draw(st.lists(TICK, max_size=3))] = ""
    poorer = without(poorer, data.draw(st.lists(TICK, max_size=8)))
    if data.draw(st.booleans()):
        keep = data.draw(st.integers(DWELL, TICKS - 1))
        poorer = without(poorer, list(range(keep, poorer.n_ticks)))
        poorer.events = [event for event in poorer.events if event.time_s <= poorer.time_s[-1]]
        poorer.phases = [phase for phase in poorer.phases if phase[1] <= poorer.time_s[-1]]
    if data.draw(st.booleans()):
        poorer.drives = None
    if data.draw(st.booleans()):
        poorer.counts = {}
    if data.draw(st.booleans()):
        custom = {}
    record = judged(poorer, custom=custom)
    assert ORDER.index(record.verdict) >= ORDER.index(whole)


def test_a_swap_of_an_older_bag_has_a_cause_that_is_not_known() -> None:
    """Not one that was not asked for: the rule is broken all the same."""
    weld = good_weld()
    weld.events.insert(1, WeldEvent(3.0, "swap", "nmpc", cause=Cause.UNKNOWN))
    [rule] = [rule for rule in judged(weld).rules if rule.name == "swaps"]
    assert rule.verdict is Verdict.REVIEW
    assert rule.facts == (
        Fact.of(FactCode.SWAPS, count=1, unwanted=0),
        Fact.of(FactCode.CAUSE_UNKNOWN, count=1),
    )


@pytest.mark.parametrize("lost", [20, 22, 23])
def test_a_sample_lost_beside_an_exceedance_does_not_shorten_it(lost: int) -> None:
    weld = good_weld()
    weld.temperature_c[20:24] = 920.0
    record = judged(without(weld, [lost]))
    assert (
        record.verdict is Verdict.REJECT
        and next(exceedance.samples for exceedance in record.exceedances) < 4
    )
    assert [rule.name for rule in record.rules if rule.verdict is Verdict.REJECT] == ["essential"]


@given(st.lists(TICK, min_size=1, max_size=8))
def test_a_weld_with_a_gap_is_never_accepted(ticks: list[int]) -> None:
    record = judged(without(good_weld(), ticks))
    assert record.verdict is not Verdict.ACCEPT
    assert sum(gap.duration_s for gap in record.gaps) == pytest.approx(0.1 * len(set(ticks)))


def test_a_gap_spans_its_ticks_wherever_they_are() -> None:
    """Between its neighbours, also at both ends.

    When the programme began and was done is on record.
    """
    record = judged(without(good_weld(), [0, 20, 21, 22, TICKS - 1]))
    assert [(gap.begin_s, gap.duration_s) for gap in record.gaps] == [
        (0.1, 0.1),
        (2.1, 0.3),
        (6.0, 0.1),
    ]


def test_what_was_before_the_programme_is_no_part_of_the_weld() -> None:
    weld = good_weld()
    weld.phases[0] = ("dwell", 0.3)
    weld.temperature_c[:2] = 20.0
    record = judged(
        weld,
        short_procedure(
            phases=[{"name": "dwell", "duration_s": 0.8, "source": "test"}, JOINT_LINE]
        ),
    )
    assert record.verdict is Verdict.ACCEPT and record.phases[0].begin_s == 0.3


def incomplete(weld: WeldSignals) -> dict[FactCode, dict[str, Any]]:
    """What a weld that is not complete lacks, by code."""
    deciding = judged(weld).deciding
    assert deciding.name == "complete"
    return {fact.code: fact.data for fact in deciding.facts}


def test_a_phase_that_begins_late_or_ends_early_is_not_complete() -> None:
    weld = good_weld()
    weld.phases[1] = ("joint_line", 0.1 * DWELL + 0.5)  # the report at its beginning is lost
    assert incomplete(weld)[FactCode.BEGINS]["angle_deg"] == pytest.approx(0.1)
    weld = good_weld()
    weld.angle_deg[DWELL - 1 :] += 0.5
    assert incomplete(weld)[FactCode.BEGINS]["angle_deg"] == pytest.approx(0.5)
    weld.angle_deg[:] = 0.0
    assert incomplete(weld)[FactCode.REACHES] == {
        "phase": "joint_line",
        "angle_deg": 0.0,
        "to_deg": 1.0,
    }
    weld.phases[0] = ("dwell", 0.2)
    lasts = incomplete(weld)[FactCode.LASTS]
    assert (lasts["time_s"], lasts["duration_s"]) == (pytest.approx(0.9), 1.0)


def test_a_phase_without_an_angle_on_record_is_not_complete() -> None:
    """The figure is made of the facts; and written and read again, the record is the same."""
    weld = good_weld()
    weld.angle_deg[:] = np.nan
    assert incomplete(weld) == {FactCode.ANGLE_UNKNOWN: {"phase": "joint_line"}}
    record = judged(weld)
    assert record.deciding.figure
    text = record.model_dump_json(exclude_none=True)
    assert Record.model_validate_json(text).rules == record.rules


def broken(name: str) -> tuple[WeldSignals, dict[str, Any], dict[str, str]]:
    """A weld, fields of the procedure, and custom data of the bag."""
    weld, changes, custom = good_weld(), {}, dict(COMPLETE)
    if name == "set-point":
        weld.reference_depth_mm[30:32] = 3.5
    elif name == "quality":
        weld.depth_mm[30:34] += 0.11
    elif name == "recording":
        weld.problems.append("bag_0.mcap: chunk 3 is damaged")
    elif name == "sensor":
        changes = {"sensors": [{"name": "depth", "calibration_due": "2020-01-01"}]}
    elif name == "controller":
        weld.command_source[30:] = "manual"
    elif name == "tuning":
        changes = {
            "controllers": [{"name": "decentral", "parameters_sha256": digest({"gain": 1.0})}]
        }
        parameters = {"/fsw_decentral": {"ros__parameters": {"gain": 1.1}}}
        weld.attachments["parameters/fsw_decentral.yaml"] = yaml.safe_dump(parameters).encode()
    elif name == "swaps":
        weld.events.insert(
            0,
            WeldEvent(
                0.5, "swap", "nmpc", cause=Cause.SWAP_FAILED, detail="(start infeasible) (operator"
            ),
        )
    elif name == "mode":
        weld.actual_mode[10:12] = "hold"
    elif name == "procedure":
        weld.events.insert(0, welded(0.1, "p", "B", "ab" * 32))
    elif name == "interlocks":
        weld.events.insert(0, WeldEvent(0.5, "interlock", "torque_high", "trip"))
    elif name == "complete":
        weld.events[-1] = WeldEvent(6.0, "weld", "aborted")
    elif name == "lost":
        custom["lost_messages"] = "2"
    return weld, changes, custom


@pytest.mark.parametrize(
    "rule",
    [
        "set-point",
        "quality",
        "recording",
        "sensor",
        "controller",
        "tuning",
        "swaps",
        "mode",
        "interlocks",
        "complete",
        "procedure",
    ],
)
def test_each_rule_alone_decides(rule: str) -> None:
    weld, changes, custom = broken(rule)
    record = judged(weld, short_procedure(**changes), custom)
    assert {rule.name for rule in record.rules if rule.verdict is not Verdict.ACCEPT} == {rule}
    assert record.deciding.name == rule
    assert record.verdict is (Verdict.REJECT if rule == "complete" else Verdict.REVIEW)


def test_a_weld_by_the_procedure_that_judges_it_is_accepted_and_one_by_an_unknown_procedure_is_told() -> (
    None
):
    weld, wanted = good_weld(), PROCEDURE.identity
    assert FactCode.NO_PROCEDURE in unknown(judged(weld))
    weld.events.insert(0, welded(0.1, wanted.id, wanted.revision, wanted.sha256))
    record = judged(weld)
    rule = next(rule for rule in record.rules if rule.name == "procedure")
    assert record.verdict is Verdict.ACCEPT and FactCode.NO_PROCEDURE not in unknown(record)
    identity = {"procedure": wanted.id, "revision": wanted.revision, "sha256": wanted.sha256}
    assert rule.facts == (Fact.of(FactCode.WELDED_BY, **identity),) and rule.data == identity


def test_the_procedure_that_is_attached_to_the_bag_is_the_one_of_the_weld() -> None:
    weld = good_weld()
    text = yaml.safe_dump(PROCEDURE.model_dump(mode="json", exclude_none=True))
    weld.attachments |= {
        "mine.yaml": text.encode(),
        "x.yaml": b"a: fsw_weld_procedure",
        "broken.yaml": b"[fsw_weld_procedure",
    }
    (event,) = attached_procedures(weld)
    assert (
        event.kind == "procedure"
        and event.text.endswith(PROCEDURE.sha256)
        and event.time_s == weld.time_s[0]
    )


def test_lost_messages_and_a_bag_without_states_are_for_review() -> None:
    weld, _, custom = broken("lost")
    assert judged(weld, custom=custom).deciding.facts == (Fact.of(FactCode.LOST, count=2),)
    record = judged(weld, custom={})
    assert record.deciding.facts == (Fact.of(FactCode.LOST_UNKNOWN),)
    assert FactCode.LOST_UNKNOWN in unknown(record)
    weld.counts = {}
    record = judged(weld)
    assert {rule.name for rule in record.rules if rule.verdict is Verdict.REVIEW} == {
        "swaps",
        "mode",
        "interlocks",
    }
    assert FactCode.NO_STATES in unknown(record)


def test_the_same_tuning_is_recognised() -> None:
    weld, changes, _ = broken("tuning")
    weld.attachments["parameters/fsw_decentral.yaml"] = (
        b"/fsw_decentral: {ros__parameters: {gain: 1.0, use_sim_time: true}}"
    )
    record = judged(weld, short_procedure(**changes))
    assert record.verdict is Verdict.ACCEPT and record.parameters_sha256["decentral"] == digest(
        {"gain": 1.0}
    )


def test_a_tuning_is_known_by_the_content_of_its_file() -> None:
    def hash_of(**parameters: str) -> str:
        weld, *_ = broken("tuning")
        content = {"/fsw_decentral": {"ros__parameters": parameters}}
        weld.attachments["parameters/fsw_decentral.yaml"] = yaml.safe_dump(content).encode()
        return judged(weld).parameters_sha256["decentral"]

    own = hash_of(tuning_file="a.yaml", tuning_file_sha256="1" * 64)
    assert hash_of(tuning_file="b.yaml", tuning_file_sha256="1" * 64) == own
    assert hash_of(tuning_file="a.yaml", tuning_file_sha256="2" * 64) != own
    # older bags have the path alone
    assert hash_of(tuning_file="a.yaml") != hash_of(tuning_file="b.yaml")


@pytest.mark.parametrize(
    ("tolerated_s", "verdict"), [(None, Verdict.REVIEW), (0.5, Verdict.REJECT)]
)
def test_a_frozen_sensor_is_for_review_and_for_long_rejects(
    tolerated_s: float | None, verdict: Verdict
) -> None:
    """Ten minutes without a valid temperature were for review only, because each sample was on record."""
    weld = good_weld()
    changes = {} if tolerated_s is None else {"tolerated_unusable_s": tolerated_s}
    procedure = short_procedure(acceptance=PROCEDURE.acceptance.model_dump() | changes)
    weld.temperature_c += np.random.default_rng(0).normal(0.0, 0.1, TICKS)
    weld.temperature_c[40:] = weld.temperature_c[40]
    record = judged(weld, procedure)
    assert record.verdict is verdict and record.unusable["thermocouple"]["frozen"] > 5
    assert record.deciding.subject == "thermocouple"
    assert [fact.data["flaw"] for fact in record.deciding.facts] == ["frozen"]


def test_a_swap_on_request_is_as_the_procedure_says() -> None:
    weld = good_weld()
    weld.events.insert(0, WeldEvent(3.0, "swap", "nmpc", cause=Cause.SWAP_REQUESTED))
    weld.command_source[30:] = "nmpc"
    assert judged(weld).verdict is Verdict.ACCEPT
    strict = PROCEDURE.acceptance.model_dump() | {"swaps_allowed": False}
    assert judged(weld, short_procedure(acceptance=strict)).deciding.name == "swaps"


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, Verdict.REVIEW),
        ({"tolerated_share": 1.0}, Verdict.ACCEPT),
        ({"tolerated_share": 1.0, "tolerated_mm": 7.0}, Verdict.REVIEW),
        ({"tolerated_share": 1.0, "tolerated_mm": 9.0}, Verdict.ACCEPT),
        ({"tolerated_share": 1.0, "tolerated_total_s": 3.0}, Verdict.REVIEW),
    ],
)
def test_short_exceedances_of_quality_add_up(changes: dict[str, float], verdict: Verdict) -> None:
    """Each no longer than tolerated.

    They were accepted, though the depth was off for most of the weld.
    """
    weld = good_weld()
    weld.depth_mm[DWELL + np.flatnonzero(np.arange(TICKS - DWELL) % 4 != 3)] += 0.108
    procedure = short_procedure(acceptance=PROCEDURE.acceptance.model_dump() | changes)
    record = judged(weld, procedure)
    rule = next(
        rule
        for rule in record.rules
        if rule.name == "quality" and rule.subject == "depth_error_mm"
    )
    assert record.verdict is rule.verdict is verdict
    outside, length = rule.facts[:2]
    assert outside.data["longest_s"] == pytest.approx(0.3) and length.code is FactCode.LENGTH


@pytest.mark.parametrize(("lasts_s", "complete"), [(0.957, True), (0.93, False)])
def test_a_dwell_on_a_real_clock_may_lack_half_a_tick(lasts_s: float, complete: bool) -> None:
    weld = good_weld()
    weld.time_s *= lasts_s
    weld.events[:] = [replace(event, time_s=event.time_s * lasts_s) for event in weld.events]
    weld.phases[:] = [(name, begin_s * lasts_s) for name, begin_s in weld.phases]
    rule = next(rule for rule in judged(weld).rules if rule.name == "complete")
    assert (FactCode.LASTS not in [fact.code for fact in rule.facts]) == complete


def test_events_of_a_record_are_facts_of_which_the_same_words_follow() -> None:
    weld = good_weld()
    weld.events.insert(1, WeldEvent(2.0, "swap", "nmpc", cause=Cause.SWAP_FAILED))
    weld.events.insert(2, WeldEvent(3.0, "mode", "hold", cause=Cause.UNKNOWN))
    weld.events.insert(3, WeldEvent(4.0, "interlock", "torque_high", "warn", is_over=True))
    record = judged(weld)
    read = Record.model_validate_json(record.model_dump_json(exclude_none=True))
    assert read.events == record.events
    swap = next(event for event in read.events if event.kind == "swap")
    assert (swap.subject, swap.cause) == ("nmpc", "swap_failed")
    assert [event.text for event in read.events] == [event.text for event in weld.events]


@pytest.mark.parametrize(("ticks", "verdict"), [(3, Verdict.REVIEW), (4, Verdict.REJECT)])
def test_an_exceedance_on_a_real_clock_is_as_long_as_its_ticks(
    ticks: int, verdict: Verdict
) -> None:
    weld = good_weld()
    weld.temperature_c[DWELL + 5 : DWELL + 5 + ticks] = 911.0  # tolerated: 0.3 s
    weld.time_s[DWELL + 4 + ticks] += 0.02
    record = judged(weld)
    assert record.deciding.name == "essential" and record.verdict is verdict
    assert record.exceedances[0].duration_s == pytest.approx(0.1 * ticks)


def cut(weld: WeldSignals, begin: int, end: int) -> WeldSignals:
    """The weld without some ticks, on all topics."""
    kept = np.r_[0:begin, end:TICKS]
    changed = {
        name: value[kept]
        for name in weld.__slots__
        if isinstance(value := getattr(weld, name), np.ndarray) and value.shape == (TICKS,)
    }
    drives = weld.drives
    assert drives is not None
    return replace(
        weld, **changed, drives=DriveSignals(drives.force_kn[kept], drives.speed_rpm[kept])
    )


@pytest.mark.parametrize(("ticks", "verdict"), [(3, Verdict.REVIEW), (8, Verdict.REJECT)])
def test_a_gap_is_told_once_with_its_place(ticks: int, verdict: Verdict) -> None:
    record = judged(cut(good_weld(), 30, 30 + ticks))
    assert (record.verdict, record.deciding.name) == (verdict, "recording")
    assert record.exceedances == () and record.missing["depth_mm"] == ticks
    [gap] = record.gaps
    assert (gap.begin_s, gap.duration_s) == pytest.approx((3.1, 0.1 * ticks))
    assert gap.angle_deg == pytest.approx((0.40, 0.42 + 0.02 * ticks))
    assert gap.travel_mm == pytest.approx((4.0, 4.2 + 0.2 * ticks), abs=0.05)


def test_what_ends_a_weld_decides_before_what_its_gaps_hide() -> None:
    weld = cut(good_weld(), 30, 40)
    weld.events[-1] = WeldEvent(6.0, "weld", "aborted")
    record = judged(weld)
    assert record.deciding.name == "complete"
    assert record.deciding.facts[0] == Fact.of(FactCode.ENDED, state="aborted")


def test_where_an_exceedance_was() -> None:
    weld = good_weld()
    weld.temperature_c[30:35] = [911.0, 915.0, np.nan, 912.0, 911.0]
    [finding] = [
        exceedance
        for exceedance in judged(weld).exceedances
        if exceedance.limit.kind == "essential" and exceedance.limit.variable == "temperature_c"
    ]
    assert (finding.begin_s, finding.duration_s, finding.samples, finding.missing) == (
        3.1,
        0.5,
        5,
        1,
    )
    assert (finding.extreme, finding.beyond) == (915.0, 5.0)
    assert finding.phases == ("joint_line",) and finding.commanded_by == "decentral"
    assert finding.angle_deg == pytest.approx((0.42, 0.50)) and finding.travel_mm == pytest.approx(
        (4.2, 5.0), abs=0.05
    )


def test_the_traverse_speed_does_not_jump_where_a_phase_begins_in_motion() -> None:
    """The report of the new phase comes into force a tick after it.

    The one before it is up to a second old.
    """
    weld = good_weld()
    reports = sorted([*range(DWELL, TICKS, 10), DWELL + 28, TICKS - 1])
    at = np.searchsorted(np.array(reports) + 1, np.arange(1, TICKS + 1), side="right") - 1
    weld.travel_mm = np.array(
        [0.2 * (reports[report] - DWELL) if report >= 0 else 0.0 for report in at]
    )
    weld.angle_deg = 0.1 * weld.travel_mm
    begin_s = 0.1 * (DWELL + 28)
    weld.phases.append(("overlap", begin_s))
    weld.events.insert(1, WeldEvent(begin_s, "phase", "overlap"))
    speed = course_of(weld).values["traverse_mm_per_min"][DWELL:]
    assert speed == pytest.approx(np.full(speed.size, 120.0), rel=0.1)


def test_a_limit_of_a_phase_holds_there_only() -> None:
    weld = good_weld()
    weld.temperature_c[:] += np.where(np.arange(TICKS) < DWELL - 1, 11.0, 0.0)
    assert judged(weld).verdict is Verdict.ACCEPT
    weld.temperature_c[DWELL - 1 : DWELL + 3] += 11.0
    deciding = judged(weld).deciding
    assert (deciding.subject, deciding.data["phases"]) == ("temperature_error_c", ["joint_line"])


def test_figures_of_a_phase() -> None:
    weld = good_weld()
    weld.depth_mm += np.where(np.arange(TICKS) % 2, 0.02, -0.01)
    dwell, joint_line, whole = judged(weld).phases
    assert dwell.heat_input_kj_per_mm is None and joint_line.travel_mm == pytest.approx(
        10.0, abs=0.2
    )
    # 1050 N m at 407.576 rpm are 44.815 kW, at 2 mm/s
    assert joint_line.heat_input_kj_per_mm == pytest.approx(44.815 / 2.0, rel=1e-4)
    assert whole.depth_mm is not None and whole.depth_mm.inside_share == 1.0
    assert (whole.depth_mm.mean, whole.depth_mm.sigma) == pytest.approx((0.005, 0.015))
    assert whole.depth_mm.iae == pytest.approx(0.1 * (30 * 0.02 + 30 * 0.01))
    assert joint_line.envelopes["traverse_mm_per_min"].mean == pytest.approx(120.0, rel=0.01)


def test_heat_input_survives_a_missing_sample_but_not_many() -> None:
    weld = good_weld()
    weld.torque_nm[30] = np.nan
    assert judged(weld).phases[1].heat_input_kj_per_mm == pytest.approx(44.815 / 2.0, rel=1e-4)
    weld.torque_nm[30:40] = np.nan
    assert judged(weld).phases[1].heat_input_kj_per_mm is None


@pytest.mark.parametrize(
    ("tool", "custom", "broken"),
    [
        ({"id": "T7"}, {"tool": "T7"}, set()),
        ({"id": "T7"}, {"tool": "T8"}, {"tool"}),
        ({"id": "T7"}, {}, {"tool"}),
        ({}, {"machine": "purpose-built welding machine, 2003"}, set()),
        ({}, {"machine": "another"}, {"machine"}),
        ({"life_mm": 100.0}, {"tool_used_mm": "80"}, set()),
        ({"life_mm": 100.0}, {"tool_used_mm": "95"}, {"tool_life"}),
        ({"life_mm": 100.0}, {}, {"tool_life"}),
    ],
)
def test_tool_and_machine_are_compared_with_the_weld(
    tool: dict[str, Any], custom: dict[str, str], broken: set[str]
) -> None:
    procedure = short_procedure(tool=PROCEDURE.tool.model_dump(exclude_none=True) | tool)
    record = judged(good_weld(), procedure, COMPLETE | custom)
    assert {rule.name for rule in record.rules if rule.verdict is not Verdict.ACCEPT} == broken
    is_compared = any(rule.name == "machine" for rule in record.rules)
    assert is_compared == ("machine" in custom)
    assert is_compared != (FactCode.MACHINE_NOT_COMPARED in unknown(record))


def test_what_else_is_known_of_a_weld_is_in_its_record() -> None:
    procedure = short_procedure(extra={"shift": 2.0}, weld_data={"wpqr": "17-3", "tilt_deg": 0.0})
    custom = {"material_heat": "H42", "tool_used_mm": "80", "dwell_s": "long", "canister": "C001"}
    custom |= {"wpqr": "18-1", "tilt_deg": "0.0"}  # the procedure has another, and the same
    record = judged(good_weld(), procedure, COMPLETE | custom)
    assert record.extra == {"shift": 2.0, "dwell_s": "long", "wpqr": "18-1"}
    assert record.weld_data == WeldData(
        wpqr="17-3", tilt_deg=0.0, material_heat="H42", tool_used_mm=80.0
    )
    assert record.weld_data is not None and ("WPQR", "17-3") in record.weld_data.labelled
    with pytest.raises(ValueError, match="tilt"):
        short_procedure(weld_data={"tilt": 0.0})
    assert record.identity == {"canister": "C001"} and record.judged_with.keys() >= {
        "fsw-control",
        "numpy",
    }


def test_a_programme_that_is_held_for_long_is_for_review() -> None:
    weld = good_weld()
    weld.events[:0] = [WeldEvent(1.0, "weld", "held"), WeldEvent(3.0, "weld", "resumed")]
    strict = PROCEDURE.acceptance.model_dump() | {"tolerated_hold_s": 1.9}
    rule = judged(weld, short_procedure(acceptance=strict)).deciding
    assert rule.name == "hold"
    assert rule.facts == (Fact.of(FactCode.HELD, times=1, time_s=pytest.approx(2.0)),)
    assert judged(weld).verdict is Verdict.ACCEPT


def test_record_says_what_a_fused_depth_rested_on() -> None:
    """Time in each state of health, and how often it was used; of one sensor nothing."""
    assert judged(good_weld()).depth is None
    health = np.where(np.arange(TICKS) < 20, 0.0, 5.0)
    fused = FusedSignals(
        np.full(TICKS, 0.02), {"depth_laser": (health == 0.0) * 1.0}, {"depth_laser": health}
    )
    basis = judged(replace(good_weld(), fused=fused)).depth
    assert basis is not None
    assert basis.deviation_mm.max == 0.02
    (channel,) = basis.channels
    assert channel.health_s == {"good": 2.0, "slip": 4.0}
    assert channel.used_share == pytest.approx(1.0 / 3.0, abs=1e-3)
