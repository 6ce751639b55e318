"""The record of a weld: what it was, what was kept, where it was not, and the verdict.

Its JSON has a schema.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import Any

import numpy as np

from fsw_analysis.course import SENSOR_SIGNALS, Course, beyond
from fsw_analysis.judgement import Evidence, judge
from fsw_analysis.phase_kpi import ErrorStatistics
from fsw_analysis.procedure import Procedure, attached, weld_data_of
from fsw_analysis.rules import Fact, FactCode
from fsw_analysis.signals import load_weld
from fsw_analysis.weld_signals import FloatArray, FusedSignals, WeldEvent, WeldSignals
from fsw_control.depth_channels import ChannelHealth
from fsw_control.diagnostic_names import qualified
from fsw_control.schema.extensions import MissingExtraError
from fsw_control.schema.models import InputError
from fsw_control.sensors import REQUIRED
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_S
from fsw_quality.diagnosis import Estimate, NotJudged, WatchCause
from fsw_quality.record_content import (
    BagFile,
    ChannelRecord,
    DepthBasis,
    Envelope,
    Event,
    Gap,
    PhaseRecord,
    Record,
    Statistics,
    TimeOfControl,
    Unusable,
    bag_name,
    software_versions,
)
from fsw_recorder.bag_metadata import IDENTITY, METADATA_NAME
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.definitions import Definitions, definition_of
from fsw_recorder.errors import BagError
from fsw_recorder.findings import EvidenceError
from fsw_recorder.manifest import MANIFEST_NAME, check_files, mapped, read_manifest, sha256
from fsw_recorder.signature import Purpose, signer_of

#: node that watches the procedure, and where it tells what it finds
WATCH_NODE, _DIAGNOSTICS = "fsw_procedure", "/diagnostics"
_HEALTH = "/fsw/monitor/health"
#: values of its entry that say which procedure it is
_IDENTIFIES = ("procedure", "revision", "SHA-256")
#: topics without which something cannot be said, and what
_SAYS = {
    "/fsw/supervisor/state": FactCode.NO_STATES,
    "/fsw/weld_progress": FactCode.NO_PROGRESS,
    "/fsw/drives": FactCode.NO_DRIVES,
    _HEALTH: FactCode.NO_MONITOR,
    "/fsw/alarms": FactCode.NO_ALARMS,
}


#: custom data of a bag that the record has in fields of its own
_KNOWN = (*IDENTITY, "lost_messages")
#: share of a phase's ticks that must be on record for its heat input (chosen)
_KNOWN_SHARE = 0.95


def make(
    bag: Path, procedure: Procedure, progress: Callable[[float], None] | None = None
) -> tuple[Record, Course]:
    """Judge the weld in a bag by a procedure; returns also its course, for figures.

    Raises
    ------
    fsw_recorder.errors.BagError
        There is no bag, it cannot be read, or it has no sample of any sensor.
    """
    return judged(bag, procedure, *read(bag, progress))


def read(
    bag: Path, progress: Callable[[float], None] | None = None
) -> tuple[WeldSignals, list[Fact]]:
    """What :func:`judged` needs of a bag: signals, and what proves it; errors as :func:`make`."""
    signals = load_weld(bag, progress)
    proof, wrong = proof_of(bag)
    signals.problems.extend(wrong)
    with BagReader(bag) as reader:
        added = attached_procedures(signals)
        watch = qualified(signals.namespace, WATCH_NODE)
        if f"parameters/{watch.replace('/', '.')}.yaml" in signals.attachments:
            known = [row.data for row in added]
            added += [row for row in told_by_watch(reader, signals) if row.data not in known]
        added += estimated(reader, signals)
    if added:
        signals = replace(
            signals, events=sorted([*signals.events, *added], key=lambda row: row.time_s)
        )
    return signals, proof


def proof_of(bag: Path) -> tuple[list[Fact], list[str]]:
    """Whether a bag is what was recorded, and who signed for it.

    And what of that is wrong, in words.

    Any key will do: whose it is, the reader of its fingerprint has to say.
    """
    facts: list[Fact] = []

    def add(code: FactCode, **data: Any) -> list[Fact]:
        facts.append(Fact.of(code, file=MANIFEST_NAME, **data))
        return facts

    try:
        manifest = read_manifest(bag) if bag.is_dir() else None
        if manifest is None:
            return add(FactCode.UNPROVEN), []
        if findings := check_files(bag, manifest):
            raise EvidenceError(*findings)
        is_late = any(entry.hashed == "afterwards" for entry in manifest.files)
        code = FactCode.LISTED_LATER if is_late else FactCode.AS_LISTED
        add(code, count=len(manifest.files))
    except (BagError, InputError) as error:
        return add(FactCode.NOT_AS_LISTED, problem=str(error)), [facts[-1].words]
    try:
        signer = signer_of(bag / MANIFEST_NAME, Purpose.MANIFEST, None)
    except MissingExtraError as error:
        return add(FactCode.SIGNATURE_UNCHECKED, problem=str(error)), []
    except (BagError, InputError) as error:
        return add(FactCode.SIGNATURE_INVALID, problem=str(error)), [facts[-1].words]
    signed = add(FactCode.SIGNED, signer=signer.words) if signer else add(FactCode.UNSIGNED)
    return signed, []


def judged(
    bag: Path, procedure: Procedure, signals: WeldSignals, proof: Sequence[Fact]
) -> tuple[Record, Course]:
    """Judge what was read of a bag; errors as :func:`make`."""
    sensors = np.stack([signals.depth_mm, signals.torque_nm, signals.temperature_c])
    if not np.isfinite(sensors).any():
        raise BagError(
            f"{bag}: has no sample of any sensor, e.g. on /fsw/depth; a record needs them"
        )
    return assemble(signals, procedure, files_of(bag), proof)


def assemble(
    signals: WeldSignals,
    procedure: Procedure,
    files: tuple[BagFile, ...] = (),
    proof: Sequence[Fact] = (),
) -> tuple[Record, Course]:
    """The record of a weld from its signals."""
    account = judge(signals, procedure)
    course, evidence = account.course, account.evidence
    custom = signals.custom
    phases = [
        *((name, ticks) for name, ticks in course.spans() if name),
        ("whole weld", slice(None)),
    ]
    weld_data, rest = weld_data_of(
        procedure.weld_data, {key: custom[key] for key in custom if key not in _KNOWN}
    )
    record = Record(
        verdict=account.verdict,
        deciding=account.deciding,
        rules=tuple(account.rules),
        procedure=procedure.identity,
        bag=bag_name(signals.path),
        files=files,
        proof=tuple(proof),
        identity={key: custom[key] for key in IDENTITY if key in custom},
        weld_data=weld_data,
        extra={**procedure.extra, **rest},
        judged_with=judged_with(),
        start_ns=int(signals.stamp_ns[0]),
        simulated_time=evidence.stamp_ns is None,
        duration_s=course.time_s[-1] - course.time_s[0],
        controllers=course.controllers,
        operators=signals.operators,
        control=tuple(times_of_control(signals.events, float(course.time_s[-1]))),
        software=software_versions(signals.attachments),
        parameters_sha256=evidence.parameters,
        attachments_sha256={name: sha256(data) for name, data in signals.attachments.items()},
        footprints_sha256=signals.footprints_sha256,
        cannot_say=tuple(_cannot_say(signals, procedure, evidence)),
        exceedances=tuple(account.exceedances),
        missing=course.missing,
        unusable=evidence.unusable,
        unusable_at=tuple(
            Unusable(
                sensor=flaw.sensor,
                flaw=flaw.flaw,
                **_placed(course, flaw.begin_s, flaw.end_s - flaw.begin_s + TICK_S),
            )
            for flaw in account.unusable
        ),
        gaps=tuple(Gap(**_placed(course, *gap)) for gap in course.gaps),
        held_s=TICK_S * float(np.sum((course.mode != "auto") & (course.mode != ""))),
        events=tuple(_events(signals, course)),
        phases=tuple(_phase(course, procedure, name, ticks) for name, ticks in phases),
        depth=None if signals.fused is None else depth_basis(signals.fused),
    )
    return record, course


def _placed(course: Course, begin_s: float, lasts_s: float) -> dict[str, Any]:
    """Fields of what lasts for some time: when and where."""
    return {
        "begin_s": begin_s,
        "duration_s": lasts_s,
        "angle_deg": course.place(begin_s, lasts_s),
        "travel_mm": course.place(begin_s, lasts_s, course.travel_mm),
    }


def depth_basis(fused: FusedSignals) -> DepthBasis | None:
    """What a fused depth rested on; None if no standard deviation is on record."""
    deviation = _envelope(fused.deviation_mm)
    if deviation is None:
        return None
    channels = []
    for name, codes in fused.health.items():
        known = codes[np.isfinite(codes)]
        states = [(health.word, TICK_S * int(np.sum(known == health))) for health in ChannelHealth]
        channels.append(
            ChannelRecord(
                sensor=name,
                used_share=float(np.nan_to_num(fused.used[name]).mean()),
                health_s={word: time_s for word, time_s in states if time_s},
            )
        )
    return DepthBasis(deviation_mm=deviation, channels=tuple(channels))


def told_by_watch(reader: BagReader, signals: WeldSignals) -> list[WeldEvent]:
    """What the node that watches the procedure reported during the weld, each change once.

    Procedure, deviations.
    """
    topic = reader.topics().get(_DIAGNOSTICS)
    if topic is None:
        return []
    definition = definition_of(topic)
    definitions, events, welded_by = Definitions(), list[WeldEvent](), ""
    before: tuple[object, ...] = ()
    # other welds of the domain have theirs
    name = f"{qualified(signals.namespace, WATCH_NODE)}: deviations"
    for record in reader.records([_DIAGNOSTICS]):
        if name.encode() not in record.data:
            continue
        message = definitions.decode(record.type_name, definition, record.data)
        line = next((row for row in message.status if row.name == name), None)
        if line is None:
            continue
        time_s = _time_s(signals, message)
        values = {pair.key: pair.value for pair in line.values}
        if welded_by != (now := values.get("SHA-256", welded_by)):
            events.append(
                welded(time_s, values.get("procedure", ""), values.get("revision", ""), now)
            )
            welded_by = now
        facts = {key: text for key, text in values.items() if key not in _IDENTIFIES}
        last = line.level, facts
        if last != before and (before or line.level):
            events.append(WeldEvent(time_s, "deviation", detail=line.message, data=facts))
        before = last
    return events


def estimated(reader: BagReader, signals: WeldSignals) -> list[WeldEvent]:
    """Last estimated sizes of the process's faults, in the monitor's units for people."""
    topic = reader.topics().get(signals.namespace + _HEALTH)
    latest = deque(reader.records([topic.name]) if topic else (), maxlen=1)
    if topic is None or not latest:
        return []
    record = latest.pop()
    try:
        message = Definitions().decode(record.type_name, definition_of(topic), record.data)
    except BagError:  # load_weld has reported it
        return []
    events = []
    for sent in getattr(message, "estimates", ()):
        numbers = {name: getattr(sent, name) for name in ("size", "error", "alarm_size")}
        estimate = Estimate.of_si(WatchCause(sent.cause), NotJudged(sent.reason), **numbers)
        facts = {
            name: f"{value:.6g}" if isinstance(value, float) else str(value)
            for name, value in estimate.numbers.items()
            if value is not None
        }
        words = f"{estimate.name}: {estimate.text}" + " (± 2 standard errors)" * (
            not estimate.reason
        )
        time_s = _time_s(signals, message)
        events.append(WeldEvent(time_s, "estimate", estimate.cause.word, detail=words, data=facts))
    return events


def _time_s(signals: WeldSignals, message: Any) -> float:
    """Stamp of a message on the weld's clock."""
    stamp_ns = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
    return float(signals.time_s[0]) + (stamp_ns - int(signals.stamp_ns[0])) / NANOSECONDS


def attached_procedures(signals: WeldSignals) -> list[WeldEvent]:
    """By which procedure the weld began: the file that was attached to the bag."""
    identities = (file.identity for file in attached(signals.attachments))
    return [
        welded(float(signals.time_s[0]), row.id, row.revision, row.sha256) for row in identities
    ]


def welded(time_s: float, procedure: str, revision: str, sha256: str) -> WeldEvent:
    """By which procedure the weld ran from then on."""
    return WeldEvent(time_s, "procedure", procedure, data={"revision": revision, "sha256": sha256})


def judged_with() -> dict[str, str]:
    """Versions of this product and of the packages that compute a record."""
    names = ("fsw-control", "fsw-quality", "numpy", "scipy")
    return {name: _version(name) for name in names} | {"python": python_version()}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # imported from the source tree
        return "source"


def files_of(bag: Path) -> tuple[BagFile, ...]:
    """The files of a bag that a record names, with their hashes."""
    with BagReader(bag) as reader:
        paths = sorted(path for path in (*reader.files(), bag / METADATA_NAME) if path.is_file())
    contents = ((path.name, mapped(path)) for path in paths)
    return tuple(
        BagFile(name=name, bytes=len(data), sha256=sha256(data)) for name, data in contents
    )


def times_of_control(events: Sequence[WeldEvent], end_s: float) -> list[TimeOfControl]:
    """Who had control when, from the operators' actions on record.

    ``end_s`` is the end of the weld.
    """
    times: list[TimeOfControl] = []
    holder, since_s = "", 0.0
    for event in events:
        if event.kind != "operator" or event.data["holder"] == holder:
            continue
        if holder:
            times.append(TimeOfControl(who=holder, begin_s=since_s, end_s=event.time_s))
        holder, since_s = event.data["holder"], event.time_s
    if holder:
        times.append(TimeOfControl(who=holder, begin_s=since_s, end_s=max(end_s, since_s)))
    return times


def _cannot_say(signals: WeldSignals, procedure: Procedure, evidence: Evidence) -> Iterator[Fact]:
    custom = signals.custom
    for topic, code in _SAYS.items():
        if not signals.counts.get(topic):
            yield Fact.of(code, topic=topic)
    yield from (Fact.of(FactCode.DAMAGE, problem=problem) for problem in signals.problems)
    if unknown := [key for key in IDENTITY if key not in custom]:
        yield Fact.of(FactCode.NOT_GIVEN, keys=unknown)
    if "machine" not in custom:
        yield Fact.of(FactCode.MACHINE_NOT_COMPARED, id=procedure.machine.name)
    if "versions.json" not in signals.attachments:
        yield Fact.of(FactCode.NO_VERSIONS)
    if evidence.lost is None:
        yield Fact.of(FactCode.LOST_UNKNOWN)
    if not any(event.kind == "procedure" for event in signals.events):
        yield Fact.of(FactCode.NO_PROCEDURE, node=WATCH_NODE)
    if evidence.stamp_ns is None:
        yield Fact.of(FactCode.DAY_UNKNOWN)


def _events(signals: WeldSignals, course: Course) -> list[Event]:
    events = list(signals.events)
    if signals.truth is not None:
        faults = signals.truth.active_faults
        before = ""
        for row in [0, *(np.flatnonzero(faults[1:] != faults[:-1]) + 1).tolist()]:
            if faults[row] != before:
                events.append(
                    WeldEvent(
                        float(signals.time_s[row]), "fault", faults[row], is_over=not faults[row]
                    )
                )
            before = faults[row]
    angles = []
    for event in events:
        at = min(int(np.searchsorted(course.time_s, event.time_s - 1e-6)), course.time_s.size - 1)
        angle = float(course.angle_deg[at])
        angles.append(angle if np.isfinite(angle) else None)
    rows = sorted(
        zip(events, angles, strict=True), key=lambda row: (row[0].time_s, row[0].kind, row[0].text)
    )
    return [Event.of(event, angle) for event, angle in rows]


def _phase(course: Course, procedure: Procedure, name: str, ticks: slice) -> PhaseRecord:
    values = {key: row[ticks] for key, row in course.values.items()}
    time_s, power = course.time_s[ticks], values["power_kw"]
    travel = course.travel_mm[ticks]
    known = travel[np.isfinite(travel)]
    travelled = round(float(known[-1] - known[0]), 6) if known.size else None
    sensors = np.stack([values[SENSOR_SIGNALS[name]] for name in REQUIRED])
    return PhaseRecord(
        phase=name,
        begin_s=time_s[0],
        end_s=time_s[-1],
        travel_mm=travelled,
        missing=int(np.sum(~np.isfinite(sensors).all(axis=0))),
        depth_mm=_statistics(values["depth_error_mm"], procedure, "depth_error_mm", name),
        temperature_c=_statistics(
            values["temperature_error_c"], procedure, "temperature_error_c", name
        ),
        envelopes={
            key: envelope
            for key in ("torque_nm", "force_kn", "speed_rpm", "power_kw", "traverse_mm_per_min")
            if (envelope := _envelope(values[key])) is not None
        },
        heat_input_kj_per_mm=_heat_input(time_s, power, travel),
    )


def _heat_input(time_s: FloatArray, power_kw: FloatArray, travel_mm: FloatArray) -> float | None:
    """Mean power over mean speed: of some missing samples it does not depend."""
    places = np.flatnonzero(np.isfinite(travel_mm))
    known = np.isfinite(power_kw)
    if places.size < 2 or known.mean() < _KNOWN_SHARE:
        return None
    first, last = places[[0, -1]]
    travelled_mm = float(travel_mm[last] - travel_mm[first])
    if travelled_mm <= 0.0:
        return None
    return float(power_kw[known].mean()) * float(time_s[last] - time_s[first]) / travelled_mm


def _statistics(
    error: FloatArray, procedure: Procedure, variable: str, phase: str
) -> Statistics | None:
    of = ErrorStatistics.of(error)
    if of is None:
        return None
    known = error[np.isfinite(error)]
    limits = [
        rule
        for rule in procedure.quality
        if rule.variable == variable and (not rule.phases or phase in rule.phases)
    ]
    inside = [beyond(known, limit.min, limit.max) == 0.0 for limit in limits]
    return Statistics(
        mean=of.mean,
        sigma=of.sigma,
        min=of.low,
        max=of.high,
        iae=TICK_S * float(np.abs(known).sum()),
        inside_share=np.logical_and.reduce(inside).mean() if inside else None,
    )


def _envelope(values: FloatArray) -> Envelope | None:
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    return Envelope(min=known.min(), mean=known.mean(), max=known.max())
