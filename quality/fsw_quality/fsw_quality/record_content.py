"""What the record of a weld holds; its JSON has a schema. :mod:`fsw_quality.record` makes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, Strict

from fsw_analysis.course import Exceedance, Pair, Rounded
from fsw_analysis.procedure import Identity, WeldData
from fsw_analysis.rules import Fact, Rule, Verdict
from fsw_analysis.weld_signals import WeldEvent
from fsw_control.cause import Cause
from fsw_control.schema.models import Many, Model, json_content_of
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.findings import Code, Finding, finding


class BagFile(Model):
    """A file of the bag."""

    name: str
    bytes: int
    sha256: str


class Statistics(Model):
    """Of an error, measured value minus the programme's set-point, in the unit of its name."""

    mean: Rounded
    sigma: Rounded
    min: Rounded
    max: Rounded
    iae: Rounded
    """integral of the absolute error, in the unit times s"""
    inside_share: Rounded | None = None
    """share of the samples within the procedure's quality limits; without any limit left out"""


class Envelope(Model):
    """Smallest, mean and largest value of a variable."""

    min: Rounded
    mean: Rounded
    max: Rounded


class PhaseRecord(Model):
    """Figures of a phase, or of the whole weld."""

    phase: str
    begin_s: Rounded
    end_s: Rounded
    travel_mm: Rounded | None = None
    missing: int
    """ticks at which depth, torque or temperature is not on record"""
    depth_mm: Statistics | None = None
    temperature_c: Statistics | None = None
    envelopes: dict[str, Envelope]
    heat_input_kj_per_mm: Rounded | None = None
    """work of the spindle, friction in the drive included, per travel"""


class ChannelRecord(Model):
    """A channel of a fused depth."""

    sensor: str
    used_share: Rounded
    """share of the ticks whose depth rested on it"""
    health_s: dict[str, Rounded]
    """time in each state of health"""


class DepthBasis(Model):
    """What a depth fused from several channels rested on."""

    deviation_mm: Envelope
    """standard deviation of the depth"""
    channels: Many[ChannelRecord]


class TimeOfControl(Model):
    """Somebody had control on the operator's page."""

    who: str
    """name and session"""
    begin_s: Rounded
    end_s: Rounded
    """when it was given away or lost, or the end of the weld"""

    @property
    def words(self) -> str:
        """In words."""
        return f"{self.who} from {self.begin_s:.1f} to {self.end_s:.1f} s"


class Event(Model):
    """Something that happened, as facts: those of a `WeldEvent`; what is empty is left out."""

    time_s: Rounded
    kind: str
    """phase, swap, mode, interlock, alarm, operator, fault, deviation, finding, estimate, …"""
    subject: str | None = None
    """the phase, controller, mode, interlock, request, alarm, fault, procedure or cause"""
    state: str | None = None
    """of an interlock, an alarm or a request"""
    is_over: bool | None = None
    """an interlock, fault or finding ends"""
    cause: str | None = None
    """of a swap or a mode: name in ``SupervisorState.msg`` in small letters; left out: unknown"""
    who: str | None = None
    """the operator"""
    detail: str | None = None
    """words of the node that reported it"""
    data: dict[str, str] | None = None
    """more, by kind"""
    angle_deg: Rounded | None = None

    @classmethod
    def of(cls, event: WeldEvent, angle_deg: float | None) -> Event:
        """Facts of an event, and where the tool was."""
        cause = "" if event.cause is Cause.UNKNOWN else event.cause.word
        facts = {name: getattr(event, name) or None for name in _FACTS} | {"cause": cause or None}
        return cls(time_s=event.time_s, kind=event.kind, angle_deg=angle_deg, **facts)

    @property
    def text(self) -> str:
        """The event in words."""
        facts = {name: getattr(self, name) for name in _FACTS if getattr(self, name) is not None}
        facts |= {"cause": Cause[self.cause.upper()]} if self.cause else {}
        return WeldEvent(self.time_s, self.kind, **facts).text


#: fields of an event that may be empty, but for the cause, which is written as a word
_FACTS = ("subject", "state", "is_over", "who", "detail", "data")


class Gap(Model):
    """Ticks that are missing on all topics, and where the tool was before and after."""

    begin_s: Rounded
    duration_s: Rounded
    angle_deg: Pair | None = None
    travel_mm: Pair | None = None


class Unusable(Gap):
    """Samples of a sensor that are not used, and where."""

    sensor: str
    flaw: str


def data_files(files: Sequence[BagFile]) -> tuple[str, ...]:
    """Hashes of the files with the messages."""
    return tuple(sorted(file.sha256 for file in files if file.name != METADATA_NAME))


def bag_name(path: Path) -> str:
    """Name of a bag; a folder ``bag`` says nothing, so with that of its parent."""
    whole = path.resolve()
    return f"{whole.parent.name}/{whole.name}" if whole.name == "bag" else whole.name


def software_versions(attachments: Mapping[str, bytes]) -> dict[str, str]:
    """What ``versions.json`` says; empty where there is none."""
    try:
        content = json_content_of(attachments["versions.json"].decode(), "versions.json")
        return {str(key): str(value) for key, value in content.items() if value}
    except (KeyError, ValueError, AttributeError):
        return {}


class Figure(Model):
    """A figure of a phase, and the same of the accepted welds."""

    phase: str
    name: str
    value: Rounded
    mean: Rounded
    low: Rounded
    high: Rounded
    deviations: Rounded | None = None
    """distance from the mean of the others in their standard deviations, if it exists"""

    is_far: bool = False
    """whether it is outside of the prediction interval of the next weld"""


class Comparison(Model):
    """With the last accepted welds."""

    welds: Many[str]
    """names of their bags, the latest last"""
    figures: Many[Figure]

    @property
    def far(self) -> list[Figure]:
        """Figures that are far from those of the others."""
        return [row for row in self.figures if row.is_far]


class Record(Model):
    """Content of record.json."""

    format: Literal["fsw_weld_record"] = "fsw_weld_record"
    version: Literal[5] = 5
    verdict: Annotated[Verdict, Strict(False)]
    deciding: Rule
    """the first rule that led to the verdict; of an accepted weld, that all are kept"""
    rules: Many[Rule]
    procedure: Identity
    bag: str
    """name of the bag"""
    files: Many[BagFile]
    proof: Many[Fact] = ()
    """whether the bag is as its manifest has it, and who signed that"""
    identity: dict[str, str]
    """canister, lid, tool and machine, as far as the recorder was told"""
    weld_data: WeldData | None = None
    """of ISO 25239-4 and -5, by procedure and recorder, e.g. operator, material heat"""
    afterwards: WeldData | None = None
    """stated by the record's writer, e.g. NDT, disposition; the bag does not prove it"""
    extra: dict[str, str | float | bool] = Field(default_factory=dict)
    """what else procedure and recorder say of the weld"""
    judged_with: dict[str, str] = Field(default_factory=dict)
    """versions of this product and of the packages that computed the record"""
    start_ns: int
    """stamp of the first tick"""
    simulated_time: bool
    duration_s: Rounded
    controllers: Many[str]
    """whose commands were applied"""
    operators: Many[str]
    """who asked for something"""
    control: Many[TimeOfControl]
    """who had control and when, as far as it was taken while the recorder ran"""
    software: dict[str, str]
    parameters_sha256: dict[str, str]
    """of each controller"""
    attachments_sha256: dict[str, str]
    footprints_sha256: Many[str] = ()
    """files of footprints of earlier welds whose biases were taken off the depth"""
    cannot_say: Many[Fact]
    """what the bag does not show, and why"""
    exceedances: Many[Exceedance]
    missing: dict[str, int]
    """samples that are not on record, by variable"""
    unusable: dict[str, dict[str, int]]
    """samples that controllers and interlocks do not use, by sensor and reason; also missing"""
    unusable_at: Many[Unusable] = ()
    """the same in place, without those that are missing"""
    gaps: Many[Gap]
    held_s: Rounded
    """time without automatic control: hold, manual or safe stop"""
    events: Many[Event]
    phases: Many[PhaseRecord]
    """as they were, and the whole weld"""
    depth: DepthBasis | None = None
    """what the depth rested on; left out if it was that of one sensor"""
    comparison: Comparison | None = None
    """with the last accepted welds of the procedure, where their records were given"""

    @property
    def data_files(self) -> tuple[str, ...]:
        """Hashes of the files with the messages: by them two records of one weld are known."""
        return data_files(self.files)


def other_version(content: Any, file: object) -> Finding | None:
    """Finding that the content of a record.json is of another version of the format.

    None where it is not.
    """
    version = content.get("version") if isinstance(content, dict) else None
    read: int = Record.model_fields["version"].default
    is_other = isinstance(version, int) and version != read
    return (
        finding(Code.RECORD_OTHER_VERSION, file, version=version, read=read) if is_other else None
    )
