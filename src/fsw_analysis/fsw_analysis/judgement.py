"""The one judgement of a weld: its rules, the figure of each, and the verdict.

The operator's page, the page of a recorded weld, campaigns and the record of a weld all judge
here, by a rule book: a procedure, or the defaults. What only a procedure says is judged where
there is one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from fsw_analysis.course import (
    SENSOR_SIGNALS,
    Course,
    Exceedance,
    UnusableRun,
    UnusableSamples,
    course_of,
    exceedances,
    holds,
    length_mm,
    longest_s,
    unusable_samples,
)
from fsw_analysis.procedure import (
    Procedure,
    Sensor,
    recorded_parameters,
    tuning,
    tuning_sha256,
)
from fsw_analysis.rule_book import RuleBook
from fsw_analysis.rules import Fact, FactCode, Rule, Verdict, decide
from fsw_analysis.weld_signals import SIMULATED_NS, WeldEvent, WeldSignals
from fsw_control.cause import Cause, Severity
from fsw_control.schema.models import Model
from fsw_control.sensors import REQUIRED
from fsw_control.units import NANOSECONDS
from fsw_control.validity import Flaw
from fsw_control.weld import TICK_S as TICK
from fsw_recorder.errors import BagError

#: sensor of the signals that stand for it
_SIGNALS = {**SENSOR_SIGNALS, "drives": "force_kn"}
#: travel that the last report of a phase may lack: twice the time between two reports
_REPORTS_S = 2.0
#: travel by which the first report of a phase, which comes when it begins, may be late: some
#: ticks. Later, it was lost, and samples of this phase were judged by the limits of the one
#: before.
_BEGIN_S = 0.3
#: time in which control has to begin (chosen: 0.1 to 0.6 s were measured on a busy machine)
_START_S = 1.0
_NOT_ON_RECORD = Fact.of(FactCode.NOT_ON_RECORD)


class Evidence(Model):
    """Inputs of the rules beside the course."""

    lost: int | None = None
    """messages that the recorder reported as lost; none where it reported nothing"""
    has_states: bool
    """whether the supervisor's reports are on record"""
    stamp_ns: int | None = None
    """of the first tick; none in simulated time"""
    parameters: dict[str, str]
    """hash of the parameters by controller"""
    unusable: dict[str, dict[str, int]]
    """samples that are not used, by sensor and reason"""


@dataclass(frozen=True, slots=True)
class Account:
    """A weld and its judgement."""

    course: Course
    evidence: Evidence
    exceedances: list[Exceedance]
    rules: list[Rule]
    unusable: list[UnusableRun]  #: of the sensors that are judged, without missing samples

    @property
    def verdict(self) -> Verdict:
        """Disposition of the weld."""
        return self.deciding.verdict

    @property
    def deciding(self) -> Rule:
        """The first rule that led to the verdict; of an accepted weld, that all rules are kept."""
        return decide(self.rules)


def judge(
    signals: WeldSignals,
    book: RuleBook,
    *,
    running: bool = False,
    recorded: bool = True,
    unusable: UnusableSamples | None = None,
) -> Account:
    """Judge a weld by a rule book.

    Parameters
    ----------
    signals : WeldSignals
        Recorded, simulated, or of a weld so far.
    book : RuleBook
        A procedure, or the defaults.
    running : bool
        The weld is still running: a missing end is not a fault.
    recorded : bool
        It comes from a bag, which must show that nothing was lost; else it was simulated or
        watched in this process, whose own pauses are no gaps of the record.
    unusable : UnusableSamples, optional
        Samples that are not used; by default they are found here.
    """
    course = course_of(signals)
    bad = unusable_samples(course) if unusable is None else unusable
    evidence = _evidence(signals, book, recorded, bad.counts)
    exceeded = exceedances(course, book)
    procedure = book if isinstance(book, Procedure) else None
    rules = [
        _complete(course, procedure, running),
        _recording(course.gaps if recorded else [], book, evidence, signals.problems),
        *_limits(course, book, exceeded),
        *_welded_by(procedure, signals),
        *_sensors(course, book, evidence, recorded),
        *_controllers(course, procedure, evidence),
        *_equipment(course, procedure, signals.custom),
        _held(course, book),
        _swaps(book, signals.events, evidence),
        _modes(course, evidence),
        _interlocks(signals.events, evidence),
    ]
    required = {rule.subject for rule in rules if rule.name == "sensor"}
    runs = [run for run in bad.runs if run.sensor in required and run.flaw != Flaw.MISSING]
    return Account(course, evidence, exceeded, rules, runs)


def _evidence(
    signals: WeldSignals, book: RuleBook, recorded: bool, unusable: Mapping[str, Mapping[str, int]]
) -> Evidence:
    lost = signals.custom.get("lost_messages", "")
    start_ns = int(signals.stamp_ns[0])
    return Evidence(
        lost=int(lost) if lost.isdecimal() else None if recorded else 0,
        has_states=bool(signals.counts.get("/fsw/supervisor/state")) or not recorded,
        stamp_ns=None if start_ns < SIMULATED_NS else start_ns,
        parameters=_parameters(signals, book),
        unusable={sensor: dict(reasons) for sensor, reasons in unusable.items() if reasons},
    )


def _parameters(signals: WeldSignals, book: RuleBook) -> dict[str, str]:
    permitted = [item.name for item in book.controllers] if isinstance(book, Procedure) else []
    recorded = recorded_tunings(signals, [*signals.proposals, *permitted])
    return {name: tuning_sha256(values) for name, values in recorded.items()}


def recorded_tunings(
    signals: WeldSignals, controllers: Iterable[str]
) -> dict[str, dict[str, Any]]:
    """Parameters of the controllers that the bag has them of."""
    tuned = {}
    for name in dict.fromkeys(controllers):
        with suppress(BagError):
            tuned[name] = tuning(recorded_parameters(signals.attachments, signals.namespace, name))
    return tuned


def _rule(
    name: str,
    facts: Sequence[Fact],
    broken: bool | None = None,
    verdict: Verdict = Verdict.REVIEW,
    subject: str = "",
    data: dict[str, Any] | None = None,
) -> Rule:
    """A rule, broken by its findings or as ``broken`` states."""
    is_broken = bool(facts) if broken is None else broken
    verdict = verdict if is_broken else Verdict.ACCEPT
    return Rule(name=name, subject=subject, data=data or {}, facts=tuple(facts), verdict=verdict)


def _limits(course: Course, book: RuleBook, exceeded: Sequence[Exceedance]) -> Iterator[Rule]:
    tolerated = book.acceptance
    for check in book.checks():
        own = [exceedance for exceedance in exceeded if exceedance.limit == check]
        longest = longest_s(course, check)
        too_long = longest > tolerated.tolerated_s + 1e-6
        share = sum(part.samples for part in own) / max(1, int(np.sum(holds(course, check))))
        total_s, outside_mm = TICK * sum(part.samples for part in own), length_mm(course, check)
        too_much = (
            share > tolerated.tolerated_share
            or _exceeds(total_s, tolerated.tolerated_total_s)
            or _exceeds(outside_mm, tolerated.tolerated_mm)
        )
        verdict = Verdict.ACCEPT
        if check.kind == "essential" and own:
            verdict = Verdict.REJECT if too_long else Verdict.REVIEW
        elif (check.kind == "quality" and (too_long or too_much)) or (
            check.kind == "set_point" and own
        ):
            verdict = Verdict.REVIEW
        name, facts = check.kind.replace("_", "-"), [*_extent(own, longest, share, outside_mm)]
        data = check.model_dump(mode="json", exclude={"kind"}, exclude_none=True)
        yield _rule(name, facts, True, verdict, check.variable, data)


def _exceeds(value: float, most: float | None) -> bool:
    return most is not None and value > most + 1e-6


def _extent(
    own: Sequence[Exceedance], longest: float, share: float, outside_mm: float
) -> Iterator[Fact]:
    if not own:
        return
    missing = sum(part.missing for part in own)
    furthest = max((part.beyond for part in own if part.beyond is not None), default=None)
    yield Fact.of(
        FactCode.OUTSIDE,
        times=len(own),
        time_s=round(sum(part.duration_s for part in own), 3),
        share=share,
        longest_s=round(longest, 3),
    )
    if outside_mm:
        yield Fact.of(FactCode.LENGTH, length_mm=round(outside_mm, 6))
    if furthest is not None:
        yield Fact.of(FactCode.BEYOND, beyond=furthest)
    if missing:
        yield Fact.of(FactCode.MISSING, count=missing)


def _welded_by(procedure: Procedure | None, signals: WeldSignals) -> Iterator[Rule]:
    """Whether the weld ran by the procedure that it is judged by, where that is on record."""
    reports = [event for event in signals.events if event.kind == "procedure"]
    if procedure is not None and reports:
        identity = procedure.identity
        broken = any(report.data["sha256"] != identity.sha256 for report in reports)
        facts = [Fact.of(FactCode.WELDED_BY, procedure=it.subject, **it.data) for it in reports]
        due = {"procedure": identity.id, "revision": identity.revision, "sha256": identity.sha256}
        yield _rule("procedure", facts, broken, data=due)


def _complete(course: Course, procedure: Procedure | None, running: bool) -> Rule:
    """Every phase in its order and to its end; phases not on record are not judged."""
    faults = []
    lacks_end = (course.phase != "").any() or procedure is not None
    if course.end and course.end != "done":  # the cause before what follows from it
        faults.append(Fact.of(FactCode.ENDED, state=course.end))
    elif not course.end and lacks_end and not running:
        faults.append(Fact.of(FactCode.NO_END))
    if procedure is not None and not running:
        faults += _phases(course, procedure)
    phases = [] if procedure is None else [phase.name for phase in procedure.phases]
    return _rule("complete", faults, verdict=Verdict.REJECT, data={"phases": phases})


def _phases(course: Course, procedure: Procedure) -> Iterator[Fact]:
    """Phases that are missing or incomplete."""
    names = [name for name, _ in course.spans() if name]
    if names != [phase.name for phase in procedure.phases]:
        none = {phase.name for phase in procedure.phases}.isdisjoint(names)
        yield Fact.of(FactCode.NO_PHASE if none else FactCode.PHASES, phases=names)
    spans = dict(course.spans())
    deg_per_s = np.degrees(
        procedure.machine.traverse_mm_per_min / 60.0 / (0.5 * procedure.geometry.diameter_mm)
    )
    from_deg = 0.0
    for phase in procedure.phases:
        if phase.name not in spans:
            continue
        ticks = spans[phase.name]
        if phase.to_deg is not None:
            angle_deg = course.angle_deg[ticks]
            known = angle_deg[np.isfinite(angle_deg)]
            if not known.size:
                yield Fact.of(FactCode.ANGLE_UNKNOWN, phase=phase.name)
            elif known.min() > from_deg + _BEGIN_S * deg_per_s:
                begins = {"angle_deg": float(known.min()), "from_deg": from_deg}
                yield Fact.of(FactCode.BEGINS, phase=phase.name, **begins)
            from_deg = phase.to_deg
            if known.size and known.max() < phase.to_deg - _REPORTS_S * deg_per_s:
                reaches = {"angle_deg": float(known.max()), "to_deg": phase.to_deg}
                yield Fact.of(FactCode.REACHES, phase=phase.name, **reaches)
        elif phase.duration_s is not None:
            # the phase begins a tick before its first sample and ends with the sample of the next
            # one
            lasts_s = course.time_s[ticks.stop - 1] - course.time_s[ticks.start] + 2.0 * TICK
            if lasts_s < phase.duration_s - 0.5 * TICK:  # the ticks of a real clock jitter
                lasts = {"time_s": float(lasts_s), "duration_s": phase.duration_s}
                yield Fact.of(FactCode.LASTS, phase=phase.name, **lasts)


def _recording(
    gaps: Sequence[tuple[float, float]],
    book: RuleBook,
    evidence: Evidence,
    problems: Sequence[str],
) -> Rule:
    """Reject a gap longer than an essential limit may be left: nothing shows it to be inside."""
    faults = [Fact.of(FactCode.PROBLEM, problem=problem) for problem in problems]
    if evidence.lost is None:
        faults.append(Fact.of(FactCode.LOST_UNKNOWN))
    elif evidence.lost:
        faults.append(Fact.of(FactCode.LOST, count=evidence.lost))
    longest = float(max((length for _, length in gaps), default=0.0))
    if gaps:
        faults.append(Fact.of(FactCode.GAPS, count=len(gaps), longest_s=longest))
    return _rule("recording", faults, verdict=gap_verdict(longest, book))


def gap_verdict(lasts_s: float, book: RuleBook) -> Verdict:
    """What a gap of the record leads to: nobody knows what was in it."""
    is_long = lasts_s > book.acceptance.tolerated_s + 1e-6
    return Verdict.REJECT if is_long else Verdict.REVIEW


def _sensors(course: Course, book: RuleBook, evidence: Evidence, recorded: bool) -> Iterator[Rule]:
    stamp, most_s = evidence.stamp_ns, book.acceptance.tolerated_unusable_s
    day = None if stamp is None else datetime.fromtimestamp(stamp / NANOSECONDS, tz=UTC).date()
    default = [Sensor(name=name) for name in REQUIRED]
    for sensor in book.sensors if isinstance(book, Procedure) else default:
        missing = course.missing.get(_SIGNALS[sensor.name], course.time_s.size)
        missing -= 0 if recorded else int(np.sum(course.put_in))
        faults = [Fact.of(FactCode.MISSING, count=missing)] if missing else []
        reasons = evidence.unusable.get(sensor.name, {})
        faults += [
            Fact.of(FactCode.UNUSABLE, count=count, flaw=flaw)
            for flaw, count in reasons.items()
            if flaw != Flaw.MISSING
        ]
        too_much = TICK * max(missing, sum(reasons.values())) > most_s + 1e-6
        worst = Verdict.REJECT if too_much else Verdict.REVIEW
        due = sensor.calibration_due
        if due is not None and day is None:
            faults.append(Fact.of(FactCode.DAY_UNKNOWN))
        elif due is not None and day is not None and day > due:
            faults.append(Fact.of(FactCode.WELDED_ON, day=str(day)))
        data = {} if due is None else {"calibration_due": str(due)}
        yield _rule("sensor", faults, verdict=worst, subject=sensor.name, data=data)


def _controllers(
    course: Course, procedure: Procedure | None, evidence: Evidence
) -> Iterator[Rule]:
    if procedure is None:
        return
    permitted = {item.name: item.parameters_sha256 for item in procedure.controllers}
    sources, counts = np.unique(course.source.astype(str), return_counts=True)
    times = {
        name: count * TICK for name, count in zip(sources.tolist(), counts.tolist(), strict=True)
    }
    foreign = {name: time_s for name, time_s in times.items() if name not in permitted}
    facts = [
        Fact.of(FactCode.COMMANDED, controller=name, time_s=time_s)
        if name
        else Fact.of(FactCode.NO_COMMAND, time_s=time_s)
        for name, time_s in times.items()
    ]
    yield _rule("controller", facts, bool(foreign), data={"controllers": list(permitted)})
    for name, value in permitted.items():
        if value is not None and name in times:
            actual = evidence.parameters.get(name)
            facts = [Fact.of(FactCode.TUNING, sha256=actual) if actual else _NOT_ON_RECORD]
            yield _rule("tuning", facts, actual != value, subject=name, data={"sha256": value})


def _equipment(
    course: Course, procedure: Procedure | None, custom: Mapping[str, str]
) -> Iterator[Rule]:
    """Tool and machine, as far as the procedure names them."""
    if procedure is None:
        return
    tool, machine = procedure.tool, procedure.machine
    if tool.id is not None:
        actual = custom.get("tool")
        facts = [Fact.of(FactCode.NAME, name=actual) if actual else _NOT_ON_RECORD]
        yield _rule("tool", facts, actual != tool.id, data={"id": tool.id})
    if "machine" in custom:
        facts = [Fact.of(FactCode.NAME, name=custom["machine"])]
        yield _rule("machine", facts, custom["machine"] != machine.name, data={"id": machine.name})
    if tool.life_mm is not None:
        known = course.travel_mm[np.isfinite(course.travel_mm)]
        welded_mm = float(known[-1] - known[0]) if known.size else np.inf
        before = custom.get("tool_used_mm", "")
        used_mm = float(before) + welded_mm if _is_number(before) else np.nan
        known_use = np.isfinite(used_mm)
        used = (
            Fact.of(FactCode.USED, used_mm=used_mm) if known_use else Fact.of(FactCode.USE_UNKNOWN)
        )
        broken = not used_mm <= tool.life_mm
        yield _rule("tool_life", [used], broken, data={"life_mm": tool.life_mm})


def _is_number(text: str) -> bool:
    return text.replace(".", "", 1).isdecimal()


def _held(course: Course, book: RuleBook) -> Rule:
    """A programme that is held heats one place."""
    most_s, held_s = book.acceptance.tolerated_hold_s, TICK * float(np.sum(course.held))
    times = int(np.sum(np.diff(course.held.astype(np.int8), prepend=0) > 0))
    facts = [Fact.of(FactCode.HELD, times=times, time_s=round(held_s, 3))] if times else []
    return _rule("hold", facts, held_s > most_s + 1e-6, data={"limit_s": most_s})


def _swaps(book: RuleBook, events: Sequence[WeldEvent], evidence: Evidence) -> Rule:
    swaps = [event.cause for event in events if event.kind == "swap" and not event.cause.at_start]
    unknown = swaps.count(Cause.UNKNOWN)
    unwanted = [cause for cause in swaps if not cause.on_request and cause is not Cause.UNKNOWN]
    broken = not all(map(book.acceptance.permits_swap, swaps)) or not evidence.has_states
    facts = [Fact.of(FactCode.SWAPS, count=len(swaps), unwanted=len(unwanted))]
    facts += [Fact.of(FactCode.CAUSE_UNKNOWN, count=unknown)] if unknown else []
    facts = facts if evidence.has_states else [_NOT_ON_RECORD]
    return _rule("swaps", facts, broken, data={"on_request": book.acceptance.swaps_allowed})


def _modes(course: Course, evidence: Evidence) -> Rule:
    # A supervisor that starts holds the command until it has found a controller that is ready.
    is_start = np.cumsum(course.mode == "auto") == 0
    if TICK * is_start.sum() > _START_S or not {"", "hold"}.issuperset(course.mode[is_start]):
        is_start[:] = False
    modes = course.mode[~(is_start | course.put_in)]  # gaps have a rule of their own
    others = {
        mode: float(TICK * np.sum(modes == mode))
        for mode in sorted({*modes.tolist()} - {"auto", ""})
    }
    unknown = int(np.sum(modes == ""))
    faults = [
        Fact.of(FactCode.IN_MODE, mode=mode, time_s=time_s) for mode, time_s in others.items()
    ]
    faults += [Fact.of(FactCode.MODE_UNKNOWN, ticks=unknown)] if unknown else []
    return _rule("mode", faults, bool(faults) or not evidence.has_states)


def _interlocks(events: Sequence[WeldEvent], evidence: Evidence) -> Rule:
    trips = [
        Fact.of(FactCode.TRIPPED, interlock=event.subject, state=event.state)
        for event in events
        if event.kind == "interlock" and event.state != Severity.WARN.word and not event.is_over
    ]
    return _rule("interlocks", trips if evidence.has_states else [_NOT_ON_RECORD])
