"""The welding procedure specification: what a weld must keep, as a YAML file, with the source of each figure."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, PositiveFloat, Strict, model_validator

from fsw_control.contract import SENSORS
from fsw_control.ranges import REFERENCE_DEPTH_MM, REFERENCE_TEMPERATURE_C
from fsw_quality.signature import verify_file
from fsw_schema.models import Many, Model, Name, content_of, problem, read_text, shipped_names, validate
from fsw_schema.ranges import Range

_SHIPPED = Path(__file__).parent / "procedures"
#: what a limit may be on; an error is the measured value minus the programme's set-point, power is torque times speed
#: at the spindle
Variable = Literal[
    "depth_mm",
    "temperature_c",
    "torque_nm",
    "force_kn",
    "speed_rpm",
    "power_kw",
    "traverse_mm_per_min",
    "depth_error_mm",
    "temperature_error_c",
]
#: sensors that may be required: those of a tick, and what the drives report
SENSOR_NAMES = (*SENSORS, "drives")
ANGLE_DEG = Range(0.0, 720.0, "deg")


def _sensor(name: str) -> str:
    if name not in SENSOR_NAMES:
        raise ValueError(f"is {name!r}, not a sensor; known: {', '.join(SENSOR_NAMES)}")
    return name


def _hash(text: str) -> str:
    if len(text) != 64 or set(text) - set("0123456789abcdef"):
        raise ValueError("is not a SHA-256 of 64 hexadecimal digits in lower case")
    return text


Text = Annotated[str, Field(min_length=1), AfterValidator(lambda text: " ".join(text.split()))]
#: also as YAML has it without quotes
Date = Annotated[date, Strict(False)]
Hash = Annotated[str, AfterValidator(_hash)]


class Sourced(Model):
    """What says where its figures come from."""

    source: Text
    """where the figures come from"""


class Material(Sourced):
    """What is welded."""

    name: Text
    thickness_mm: PositiveFloat


class Geometry(Sourced):
    """The joint."""

    joint: Text
    diameter_mm: PositiveFloat
    """of the joint line"""


class Tool(Sourced):
    """The tool."""

    id: Text | None = None
    probe_length_mm: PositiveFloat
    shoulder_diameter_mm: PositiveFloat
    shoulder: Text
    """its shape"""
    life_mm: PositiveFloat | None = None
    """length of weld for which it may be used"""


class Machine(Sourced):
    """The welding machine."""

    name: Text
    traverse_mm_per_min: PositiveFloat
    """set traverse speed"""


class Phase(Sourced):
    """A phase of the weld: it ends at an angle, or lasts for a time."""

    name: Name
    to_deg: Annotated[float, ANGLE_DEG] | None = None
    """angle that must be reached"""
    duration_s: PositiveFloat | None = None
    """least time of a phase without travel"""

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        if (self.to_deg is None) == (self.duration_s is None):
            raise ValueError("needs either to_deg or duration_s")
        return self


class SetPoint(Sourced):
    """A set-point at the start of the weld, and the range that every set-point must be in."""

    value: float
    min: float
    max: float

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.min <= self.value <= self.max:
            raise ValueError(f"is impossible: min {self.min:g}, value {self.value:g}, max {self.max:g} must ascend")
        return self


class SetPoints(Model):
    """Set-points and their permitted ranges."""

    depth_mm: SetPoint
    temperature_c: SetPoint

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        for name, allowed in (("depth_mm", REFERENCE_DEPTH_MM), ("temperature_c", REFERENCE_TEMPERATURE_C)):
            for key in ("min", "max"):
                if complaint := allowed.complaint(getattr(getattr(self, name), key)):
                    raise problem(f"= {complaint}, which the controllers accept", name, key)
        return self


class Limit(Sourced):
    """Limits on a variable, in all phases or in some."""

    variable: Variable
    min: float | None = None
    max: float | None = None
    phases: Many[Name] = ()
    """in which it holds; left out: in all"""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.min is None and self.max is None:
            raise ValueError("needs min or max")
        if self.min is not None and self.max is not None and self.min >= self.max:
            raise ValueError(f"is impossible: min {self.min:g} is not below max {self.max:g}")
        return self

    def holds(self, value: float) -> bool:
        """Whether a value is inside."""
        return (self.min is None or self.min <= value) and (self.max is None or value <= self.max)

    @property
    def words(self) -> str:
        """E.g. ``temperature_c 790 to 910 in joint_line``."""
        low = "" if self.min is None else f" {self.min:g}" if self.max is not None else f" at least {self.min:g}"
        high = "" if self.max is None else f" to {self.max:g}" if self.min is not None else f" at most {self.max:g}"
        return f"{self.variable}{low}{high}" + (f" in {', '.join(self.phases)}" if self.phases else "")


Kind = Literal["essential", "quality", "set_point"]


class Check(NamedTuple):
    """What every sample of a phase must be within."""

    kind: Kind
    variable: str
    min: float | None
    max: float | None
    words: str
    phases: tuple[str, ...] = ()  #: all, where empty


class Controller(Model):
    """A controller that may command the weld."""

    name: Name
    parameters_sha256: Hash | None = None
    """of its parameters, as the record of a weld shows it; left out: any tuning"""


class Sensor(Model):
    """A sensor that the weld must have."""

    name: Annotated[str, AfterValidator(_sensor)]
    calibration_due: Date | None = None
    """last day on which its calibration is valid"""


class Acceptance(Sourced):
    """What decides between accept, review and reject."""

    tolerated_s: Annotated[float, Range(0.0, 10.0, "s")]
    """outside an essential limit for longer: reject, for less: review; outside a quality limit for longer: review"""
    tolerated_share: Annotated[float, Range(0.0, 1.0, "")] = 0.01
    """outside a quality limit for a larger share of the time that it holds: review, however short each time (chosen)"""
    tolerated_mm: Annotated[float, Range(0.0, 1e5, "mm")] | None = None
    """outside a quality limit over more of the weld, all places together: review; left out: not judged"""
    swaps_allowed: bool = False
    """whether a swap to another permitted controller on request leaves the weld acceptable"""


class Identity(Model):
    """Which procedure a weld was judged by."""

    id: str
    revision: str
    date: str
    sha256: str


class Procedure(Model):
    """Content of a procedure file."""

    format: Literal["fsw_weld_procedure"]
    version: Literal[1]
    id: Name
    revision: Text
    date: Date
    title: Text
    material: Material
    geometry: Geometry
    tool: Tool
    machine: Machine
    phases: Annotated[Many[Phase], Field(min_length=1)]
    """in their order"""
    set_points: SetPoints
    essential: Annotated[Many[Limit], Field(min_length=1)]
    """essential variables: a weld with a sample outside is never accepted"""
    quality: Many[Limit] = ()
    """narrower limits: outside them the weld is for review"""
    controllers: Annotated[Many[Controller], Field(min_length=1)]
    sensors: Annotated[Many[Sensor], Field(min_length=1)]
    acceptance: Acceptance

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key in ("phases", "controllers", "sensors"):
            names = [one.name for one in getattr(self, key)]
            if doubled := next((one for one in names if names.count(one) > 1), None):
                raise problem(f"names {doubled} twice", key)
        names = [phase.name for phase in self.phases]
        for key in ("essential", "quality"):
            for row, limit in enumerate(getattr(self, key)):
                if unknown := [one for one in limit.phases if one not in names]:
                    raise problem(f"names phase {unknown[0]}, which is not one of {', '.join(names)}", key, row)
        angles = [phase.to_deg for phase in self.phases if phase.to_deg is not None]
        if angles != sorted(set(angles)):
            raise problem("do not ascend in to_deg", "phases")
        self._check_set_points_inside_limits()
        return self

    def _check_set_points_inside_limits(self) -> None:
        """At its set-points a weld has no error, and is inside all essential limits."""
        points = dict(self.set_points)
        for key in ("essential", "quality"):
            for row, limit in enumerate(getattr(self, key)):
                if "_error_" in limit.variable and not limit.holds(0.0):
                    raise problem("is impossible: a weld at its set-points, error 0, is outside", key, row)
        for row, limit in enumerate(self.essential):
            one = points.get(limit.variable)
            if one is not None and not (limit.holds(one.min) and limit.holds(one.max)):
                text = f"is impossible: set-points from {one.min:g} to {one.max:g} are permitted outside it"
                raise problem(text, "essential", row)

    @property
    def sha256(self) -> str:
        """Hash of everything that it says; comments and order of keys do not count."""
        return digest(self.model_dump(mode="json"))

    @property
    def identity(self) -> Identity:
        """Name, revision and hash."""
        return Identity(id=self.id, revision=self.revision, date=self.date.isoformat(), sha256=self.sha256)

    def checks(self) -> Iterator[Check]:
        """All limits and the permitted set-points, in that order."""
        for kind, one in self.limits():
            yield Check(kind, one.variable, one.min, one.max, one.words, one.phases)
        for name, point in self.set_points:
            words = f"set-point {name} {point.min:g} to {point.max:g}"
            yield Check("set_point", f"set_point_{name}", point.min, point.max, words)

    def limits(self) -> Iterator[tuple[Literal["essential", "quality"], Limit]]:
        """All limits with their kind, the essential ones first."""
        for limit in self.essential:
            yield "essential", limit
        for limit in self.quality:
            yield "quality", limit


def digest(content: Any) -> str:
    """SHA-256 of plain values, whatever the order of their keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def shipped() -> list[str]:
    """Names of the procedures that come with the package."""
    return shipped_names(_SHIPPED)


def path_of(source: str | Path) -> Path:
    """The file that `load` reads."""
    path = Path(source).expanduser()
    return _SHIPPED / f"{source}.yaml" if str(source) in shipped() and not path.is_file() else path.absolute()


def load(source: str | Path) -> Procedure:
    """Read a procedure: a YAML file, or a shipped one by its name.

    Raises
    ------
    fsw_schema.models.InputError
        It cannot be read, something in it is wrong, or it was changed after it was signed.
    """
    if Path(source).is_file():
        verify_file(Path(source), None)
    return validate(Procedure, content_of(read_text(source, "procedure", _SHIPPED), str(source)), str(source))


def differences(old: Procedure, new: Procedure) -> list[tuple[str, str, str]]:
    """Path, former and present value of all that differs; ``-`` for what is only in one of them."""
    before, after = (dict(_leaves("", one.model_dump(mode="json", exclude_none=True))) for one in (old, new))
    keys = dict.fromkeys([*before, *after])
    return [(key, before.get(key, "-"), after.get(key, "-")) for key in keys if before.get(key) != after.get(key)]


def _leaves(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Values with their paths; entries of a list by name where they have one, so that a new one shifts nothing."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(f"{path}.{key}" if path else key, inner)
    elif isinstance(value, list):
        seen: dict[str, int] = {}
        for row, inner in enumerate(value):
            name = str(inner.get("name") or inner.get("variable")) if isinstance(inner, dict) else str(row)
            seen[name] = seen.get(name, 0) + 1
            yield from _leaves(f"{path}[{name}{f' {seen[name]}' * (seen[name] > 1)}]", inner)
    else:
        yield path, f"{value:g}" if isinstance(value, float) else str(value)
