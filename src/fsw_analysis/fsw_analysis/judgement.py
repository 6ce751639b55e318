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
from enum import StrEnum
from typing import Annotated, Any

import numpy as np
from pydantic import Strict

from fsw_analysis.course import SENSOR_SIGNALS, Course, course_of, unusable_samples
from fsw_analysis.exceedances import Exceedance, exceedances, holds, longest_s
from fsw_analysis.procedure import Procedure, Sensor, tuning, tuning_sha256
from fsw_analysis.recorded_parameters import recorded_parameters
from fsw_analysis.rule_book import RuleBook
from fsw_analysis.weld_events import WeldEvent
from fsw_analysis.weld_signals import SIMULATED_NS, WeldSignals
from fsw_control.cause import Cause
from fsw_control.schema.models import Model
from fsw_control.sensors import REQUIRED
from fsw_control.severity import Severity
from fsw_control.units import NANOSECONDS
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


class Verdict(StrEnum):
    """What becomes of the weld, the best first."""

    ACCEPT = "accept"
    REVIEW = "review"
    REJECT = "reject"


_ORDER = list(Verdict)


class Rule(Model):
    """A rule, its figure for this weld, and what follows from it alone."""

    name: str
    subject: str = ""
    """what it is on: a variable, a sensor, a controller; empty where there is one only"""
    words: str
    figure: str
    verdict: Annotated[Verdict, Strict(False)]


class Evidence(Model):
    """What the rules need beside the course."""

    problems: tuple[str, ...]
    """of the bag"""
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
    custom: dict[str, str]
    """what the recorder was given with the bag"""


@dataclass(frozen=True, slots=True)
class Account:
    """A weld and what is to be said of it."""

    course: Course
    evidence: Evidence
    exceedances: list[Exceedance]
    rules: list[Rule]

    @property
    def verdict(self) -> Verdict:
        """What becomes of the weld."""
        return self.deciding.verdict

    @property
    def deciding(self) -> Rule:
        """The first rule that led to the verdict; of an accepted weld, that all rules are kept."""
        return decide(self.rules)


def decide(rules: Sequence[Rule]) -> Rule:
    """The first of the rules with the worst verdict; of an accepted weld, that all rules are kept."""
    deciding = max(rules, key=lambda rule: _ORDER.index(rule.verdict))
    if deciding.verdict is Verdict.ACCEPT:
        return Rule(
            name="all",
            words="every rule is kept",
            figure=f"{len(rules)} rules",
            verdict=Verdict.ACCEPT,
        )
    return deciding


def judge(
    signals: WeldSignals,
    book: RuleBook,
    *,
    running: bool = False,
    recorded: bool = True,
    unusable: Mapping[str, Mapping[str, int]] | None = None,
) -> Account:
    """Judge a weld by a rule book.

    Parameters
    ----------
    signals : WeldSignals
        Recorded, simulated, or of a weld so far.
    book : RuleBook
        A procedure, or the defaults.
    running : bool
        The weld is not over: that it lacks its end is no fault.
    recorded : bool
        It comes from a bag, which must show that nothing was lost; else it was simulated or
        watched in this process.
    unusable : mapping, optional
        Samples that are not used, by sensor and reason; by default they are counted here.
    """
    course = course_of(signals)
    evidence = _evidence(
        signals, book, recorded, unusable_samples(course) if unusable is None else unusable
    )
    found = exceedances(course, book)
    procedure = book if isinstance(book, Procedure) else None
    rules = [
        _complete(course, procedure, running),
        _recording(course, book, evidence),
        *_limits(course, book, found),
        *_welded_by(procedure, signals),
        *_sensors(course, procedure, evidence),
        *_controllers(course, procedure, evidence),
        *_equipment(course, procedure, evidence),
        _held(course, book),
        _swaps(book, signals.events, evidence),
        _modes(course, evidence),
        _interlocks(signals.events, evidence),
    ]
    return Account(course, evidence, found, rules)


def _evidence(
    signals: WeldSignals, book: RuleBook, recorded: bool, unusable: Mapping[str, Mapping[str, int]]
) -> Evidence:
    lost = signals.custom.get("lost_messages", "")
    start_ns = int(signals.stamp_ns[0])
    return Evidence(
        problems=tuple(signals.problems),
        lost=int(lost) if lost.isdecimal() else None if recorded else 0,
        has_states=bool(signals.counts.get("/fsw/supervisor/state")) or not recorded,
        stamp_ns=None if start_ns < SIMULATED_NS else start_ns,
        parameters=_parameters(signals, book),
        unusable={sensor: dict(reasons) for sensor, reasons in unusable.items() if reasons},
        custom=signals.custom,
    )


def _parameters(signals: WeldSignals, book: RuleBook) -> dict[str, str]:
    permitted = [one.name for one in book.controllers] if isinstance(book, Procedure) else []
    found = recorded_tunings(signals, [*signals.proposals, *permitted])
    return {name: tuning_sha256(values) for name, values in found.items()}


def recorded_tunings(
    signals: WeldSignals, controllers: Iterable[str]
) -> dict[str, dict[str, Any]]:
    """Parameters of the controllers that the bag has them of."""
    found = {}
    for name in dict.fromkeys(controllers):
        with suppress(BagError):
            found[name] = tuning(recorded_parameters(signals.attachments, signals.namespace, name))
    return found


def _rule(
    name: str,
    words: str,
    figure: str,
    broken: bool,
    otherwise: Verdict = Verdict.REVIEW,
    subject: str = "",
) -> Rule:
    verdict = otherwise if broken else Verdict.ACCEPT
    return Rule(name=name, subject=subject, words=words, figure=figure, verdict=verdict)


def _limits(course: Course, book: RuleBook, found: Sequence[Exceedance]) -> Iterator[Rule]:
    tolerated = book.acceptance
    for check in book.checks():
        own = [exceedance for exceedance in found if exceedance.limit == check]
        longest = longest_s(course, check)
        too_long = longest > tolerated.tolerated_s + 1e-6
        share = sum(one.samples for one in own) / max(1, int(np.sum(holds(course, check))))
        length_mm = sum(
            abs(one.travel_mm[1] - one.travel_mm[0]) for one in own if one.travel_mm is not None
        )
        too_much = share > tolerated.tolerated_share or length_mm > (
            tolerated.tolerated_mm or np.inf
        )
        verdict = Verdict.ACCEPT
        if check.kind == "essential" and own:
            verdict = Verdict.REJECT if too_long else Verdict.REVIEW
        elif (check.kind == "quality" and (too_long or too_much)) or (
            check.kind == "set_point" and own
        ):
            verdict = Verdict.REVIEW
        name = check.kind.replace("_", "-")
        figure = _extent(own, longest, share, length_mm)
        yield Rule(
            name=name, subject=check.variable, words=check.words, figure=figure, verdict=verdict
        )


def _extent(own: Sequence[Exceedance], longest: float, share: float, length_mm: float) -> str:
    if not own:
        return "always inside"
    missing = sum(one.missing for one in own)
    furthest = max((one.beyond for one in own if one.beyond is not None), default=None)
    how_often = "once" if len(own) == 1 else f"{len(own)} times"
    parts = [
        f"{how_often}, {sum(one.duration_s for one in own):.1f} s, {share:.2%}, longest {longest:.1f} s"
    ]
    parts += [f"over {length_mm:.1f} mm"] if length_mm else []
    parts += [] if furthest is None else [f"by up to {furthest:.4g}"]
    parts += [f"{missing} samples missing"] if missing else []
    return ", ".join(parts)


def _welded_by(procedure: Procedure | None, signals: WeldSignals) -> Iterator[Rule]:
    """Whether the weld ran by the procedure that it is judged by, where that is on record."""
    told = [one for one in signals.events if one.kind == "procedure"]
    if procedure is not None and told:
        wanted = procedure.identity
        words = f"welded by {wanted.id} revision {wanted.revision}, SHA-256 {wanted.sha256[:12]}…"
        broken = any(one.data["sha256"] != wanted.sha256 for one in told)
        figures = [
            f"{one.subject} revision {one.data['revision']}, SHA-256 {one.data['sha256'][:12]}…"
            for one in told
        ]
        yield _rule("procedure", words, "; ".join(figures), broken)


def _complete(course: Course, procedure: Procedure | None, running: bool) -> Rule:
    """Every phase in its order, to its end: of what is not on record nothing can be said."""
    faults = [] if procedure is None or running else [*_phases(course, procedure)]
    if (
        course.end != "done"
        and (course.end or (course.phase != "").any() or procedure)
        and not running
    ):
        faults.append(
            f"the weld was {course.end}" if course.end else "the end of the weld is not on record"
        )
    if running and course.end and course.end != "done":
        faults.append(f"the weld was {course.end}")
    wanted = (
        "the programme"
        if procedure is None
        else f"phases {', '.join(one.name for one in procedure.phases)}"
    )
    return _rule("complete", wanted, "; ".join(faults) or "all", bool(faults), Verdict.REJECT)


def _phases(course: Course, procedure: Procedure) -> Iterator[str]:
    """What the phases lack."""
    names = [name for name, _ in course.spans() if name]
    if names != [phase.name for phase in procedure.phases]:
        on_record = f"phases on record: {', '.join(names) or 'none'}"
        none = {phase.name for phase in procedure.phases}.isdisjoint(names)
        yield f"no phase of the procedure took place; {on_record}" if none else on_record
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
            began = np.nanmin(course.angle_deg[ticks], initial=np.inf)
            if not began <= from_deg + _BEGIN_S * deg_per_s:
                yield f"{phase.name} begins at {began:.1f} in place of {from_deg:g} deg"
            from_deg = phase.to_deg
            reached = np.nanmax(course.angle_deg[ticks], initial=-np.inf)
            if not reached >= phase.to_deg - _REPORTS_S * deg_per_s:
                yield f"{phase.name} reaches {reached:.1f} of {phase.to_deg:g} deg"
        elif phase.duration_s is not None:
            # the phase begins a tick before its first sample and ends with the sample of the next
            # one
            lasts_s = course.time_s[ticks.stop - 1] - course.time_s[ticks.start] + 2.0 * TICK
            if lasts_s < phase.duration_s - 0.5 * TICK:  # the ticks of a real clock jitter
                yield f"{phase.name} lasts {lasts_s:.1f} of {phase.duration_s:g} s"


def _recording(course: Course, book: RuleBook, evidence: Evidence) -> Rule:
    """Over a gap nothing is shown to be inside: one that is longer than an essential limit may be left rejects."""
    faults = [*evidence.problems]
    if evidence.lost is None:
        faults.append("whether messages were lost is not on record")
    elif evidence.lost:
        faults.append(f"{evidence.lost} messages lost")
    longest = max((length for _, length in course.gaps), default=0.0)
    if course.gaps:
        faults.append(f"{len(course.gaps)} gaps, longest {longest:.1f} s")
    worst = Verdict.REJECT if longest > book.acceptance.tolerated_s + 1e-6 else Verdict.REVIEW
    return _rule(
        "recording", "bag intact, without gaps", "; ".join(faults) or "intact", bool(faults), worst
    )


def _sensors(course: Course, procedure: Procedure | None, evidence: Evidence) -> Iterator[Rule]:
    stamp = evidence.stamp_ns
    day = None if stamp is None else datetime.fromtimestamp(stamp / NANOSECONDS, tz=UTC).date()
    required = [Sensor(name=name) for name in REQUIRED] if procedure is None else procedure.sensors
    for sensor in required:
        missing = course.missing.get(_SIGNALS[sensor.name], course.time_s.size)
        faults = [f"{missing} of {course.time_s.size} samples missing"] if missing else []
        reasons = evidence.unusable.get(sensor.name, {})
        faults += [f"{count} {fault}" for fault, count in reasons.items() if fault != "missing"]
        due = ""
        if sensor.calibration_due is not None:
            due = f", calibrated until {sensor.calibration_due}"
            if day is None:
                faults.append("the day of the weld is not known (simulated time)")
            elif day > sensor.calibration_due:
                faults.append(f"welded on {day}")
        yield _rule(
            "sensor",
            f"{sensor.name} on record and usable{due}",
            "; ".join(faults) or "yes",
            bool(faults),
            subject=sensor.name,
        )


def _controllers(
    course: Course, procedure: Procedure | None, evidence: Evidence
) -> Iterator[Rule]:
    if procedure is None:
        return
    permitted = {one.name: one.parameters_sha256 for one in procedure.controllers}
    sources, counts = np.unique(course.source.astype(str), return_counts=True)
    times = {
        name: count * TICK for name, count in zip(sources.tolist(), counts.tolist(), strict=True)
    }
    foreign = {name: time_s for name, time_s in times.items() if name not in permitted}
    figure = ", ".join(
        f"{name or 'not on record'} {time_s:.1f} s" for name, time_s in times.items()
    )
    yield _rule("controller", f"commands of {', '.join(permitted)} only", figure, bool(foreign))
    for name, wanted in permitted.items():
        if wanted is not None and name in times:
            actual = evidence.parameters.get(name, "not on record")
            yield _rule(
                "tuning",
                f"{name}: parameters {wanted[:12]}…",
                actual[:13],
                actual != wanted,
                subject=name,
            )


def _equipment(course: Course, procedure: Procedure | None, evidence: Evidence) -> Iterator[Rule]:
    """Tool and machine, as far as the procedure names them."""
    if procedure is None:
        return
    tool, machine, custom = procedure.tool, procedure.machine, evidence.custom
    if tool.id is not None:
        actual = custom.get("tool", "not on record")
        yield _rule("tool", f"tool {tool.id}", actual, actual != tool.id)
    if "machine" in custom:
        yield _rule("machine", machine.name, custom["machine"], custom["machine"] != machine.name)
    if tool.life_mm is not None:
        known = course.travel_mm[np.isfinite(course.travel_mm)]
        welded_mm = float(known[-1] - known[0]) if known.size else np.inf
        before = custom.get("tool_used_mm", "")
        used_mm = float(before) + welded_mm if _is_number(before) else np.nan
        figure = (
            f"{used_mm:.0f} mm with this weld"
            if np.isfinite(used_mm)
            else "use before this weld is not on record"
        )
        yield _rule(
            "tool_life",
            f"tool used for at most {tool.life_mm:g} mm",
            figure,
            not used_mm <= tool.life_mm,
        )


def _is_number(text: str) -> bool:
    return text.replace(".", "", 1).isdecimal()


def _held(course: Course, book: RuleBook) -> Rule:
    """A programme that is held heats one place."""
    most_s, held_s = book.acceptance.tolerated_hold_s, TICK * float(np.sum(course.held))
    times = int(np.sum(np.diff(course.held.astype(np.int8), prepend=0) > 0))
    figure = f"{times} times, {held_s:.1f} s" if times else "never"
    return _rule(
        "hold", f"programme held for at most {most_s:g} s", figure, held_s > most_s + 1e-6
    )


def _swaps(book: RuleBook, events: Sequence[WeldEvent], evidence: Evidence) -> Rule:
    swaps = [one.cause for one in events if one.kind == "swap" and not one.cause.at_start]
    unknown = swaps.count(Cause.UNKNOWN)
    unwanted = [cause for cause in swaps if not cause.on_request and cause is not Cause.UNKNOWN]
    words = book.acceptance.swap_words
    broken = not all(map(book.acceptance.permits_swap, swaps)) or not evidence.has_states
    figure = f"{len(swaps)} swaps, {len(unwanted)} not on request"
    figure += f", {unknown} of a cause that is not on record" if unknown else ""
    figure = figure if evidence.has_states else "not on record"
    return _rule("swaps", words, figure, broken)


def _modes(course: Course, evidence: Evidence) -> Rule:
    others = {
        mode: float(TICK * np.sum(course.mode == mode))
        for mode in sorted({*course.mode.tolist()} - {"auto", ""})
    }
    unknown = int(np.sum(course.mode == ""))
    faults = [f"{mode} {time_s:.1f} s" for mode, time_s in others.items()]
    faults += [f"not on record at {unknown} ticks"] if unknown else []
    return _rule(
        "mode",
        "auto throughout",
        ", ".join(faults) or "yes",
        bool(faults) or not evidence.has_states,
    )


def _interlocks(events: Sequence[WeldEvent], evidence: Evidence) -> Rule:
    trips = [
        one.text
        for one in events
        if one.kind == "interlock" and one.state != Severity.WARN.word and not one.is_over
    ]
    figure = ("; ".join(trips) or "none") if evidence.has_states else "not on record"
    return _rule("interlocks", "no trip", figure, bool(trips) or not evidence.has_states)
