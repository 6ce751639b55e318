"""The welding procedure specification: a rule book for a part, its phases and controllers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from datetime import date
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import AfterValidator, BeforeValidator, Field, PositiveFloat, Strict, model_validator

from fsw_analysis.rule_book import RuleBook, Sourced, Text, default
from fsw_control.parameters import CONTENT_SHA256
from fsw_control.schema.models import InputError, Many, Model, Name, content_of, problem, validate
from fsw_control.schema.ranges import Range
from fsw_control.schema.yaml_text import load_yaml
from fsw_control.sensors import SENSORS
from fsw_recorder.errors import BagError

#: parameters without influence on control
NOT_TUNING = ("use_sim_time", "start_type_description_service")
#: sensors that may be required: those of a tick, and the drives' feedback
SENSOR_NAMES = (*SENSORS, "drives")
_FORMAT = "fsw_weld_procedure"
ANGLE_DEG = Range(0.0, 720.0, "deg")


def _sensor(name: str) -> str:
    if name not in SENSOR_NAMES:
        raise ValueError(f"is {name!r}, not a sensor; known: {', '.join(SENSOR_NAMES)}")
    return name


def _hash(text: str) -> str:
    if len(text) != 64 or set(text) - set("0123456789abcdef"):
        raise ValueError("is not a SHA-256 of 64 hexadecimal digits in lower case")
    return text


#: also as YAML has it without quotes
Date = Annotated[date, Strict(False)]
Hash = Annotated[str, AfterValidator(_hash)]


def _number(value: Any) -> Any:
    """Number of a text, which a recorder's data are."""
    return float(value) if isinstance(value, str) else value


_OF_TEXT = BeforeValidator(_number)
_TILT, _PLUNGE = Range(-10.0, 10.0, "deg"), Range(0.1, 1000.0, "mm/min")
_DWELL, _PREHEAT = Range(0.0, 3600.0, "s"), Range(0.0, 1000.0, "degC")
_USED = Range(0.0, 1e9, "mm")


class Material(Sourced):
    """The workpiece."""

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


class Identity(Model):
    """Which procedure a weld was judged by."""

    id: str
    revision: str
    date: str
    sha256: str


class WeldData(Model):
    """Further data that ISO 25239-4 and -5 require; optional, printed in the record."""

    wpqr: Text | None = Field(default=None, title="WPQR")
    """number of the welding procedure qualification record"""
    operator_qualification: Text | None = Field(default=None, title="operator's qualification")
    """certificate of the welding operator (ISO 25239-3)"""
    material_heat: Text | None = Field(default=None, title="material heat")
    """heat or batch of the copper, with its certificate"""
    joint_preparation: Text | None = Field(default=None, title="joint preparation")
    clamping: Text | None = Field(default=None, title="clamping")
    tilt_deg: Annotated[float, _TILT, _OF_TEXT] | None = Field(
        default=None, title="tilt of the tool [deg]"
    )
    plunge_mm_per_min: Annotated[float, _PLUNGE, _OF_TEXT] | None = Field(
        default=None, title="plunge speed [mm/min]"
    )
    dwell_s: Annotated[float, _DWELL, _OF_TEXT] | None = Field(default=None, title="dwell [s]")
    rotation: Literal["clockwise", "counterclockwise"] | None = Field(
        default=None, title="sense of rotation"
    )
    """of the tool, seen from the spindle"""
    preheat_c: Annotated[float, _PREHEAT, _OF_TEXT] | None = Field(
        default=None, title="preheat [°C]"
    )
    calibration_certificates: Text | None = Field(default=None, title="calibration certificates")
    tool_used_mm: Annotated[float, _USED, _OF_TEXT] | None = Field(
        default=None, title="tool's use before this weld [mm]"
    )
    """length welded with it; compared with the life of the tool"""
    ndt: Text | None = Field(default=None, title="non-destructive testing")
    """methods, reports and results"""
    nonconformance: Text | None = Field(default=None, title="nonconformance")
    """number of its report"""
    disposition: Literal["use as is", "rework", "repair", "reject", "scrap"] | None = Field(
        default=None, title="disposition"
    )
    """what was decided of a nonconforming weld"""

    @property
    def labelled(self) -> list[tuple[str, str]]:
        """Labels and values of the given entries."""
        fields = type(self).model_fields.items()
        values = ((field.title, getattr(self, name)) for name, field in fields)
        return [(str(label), str(value)) for label, value in values if value is not None]


def weld_data_of(
    given: WeldData | None, custom: Mapping[str, str]
) -> tuple[WeldData | None, dict[str, str]]:
    """Merge the data of procedure and recorder; also the recorder's unknown or invalid entries.

    Where both differ the procedure holds, which may be signed; what the recorder has is kept, too.
    """
    data, rest = given or WeldData(), dict[str, str]()
    for key, value in custom.items():
        try:
            both = validate(WeldData, dict(data) | {key: value}, key)
        except InputError:
            rest[key] = value
            continue
        if getattr(data, key) in (None, getattr(both, key)):
            data = both
        else:
            rest[key] = value
    return data if data.labelled else None, rest


class Procedure(RuleBook):
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
    controllers: Annotated[Many[Controller], Field(min_length=1)]
    sensors: Annotated[Many[Sensor], Field(min_length=1)]
    weld_data: WeldData | None = None
    """of ISO 25239-4 and -5, as far as it holds for each weld, e.g. WPQR, tilt"""
    extra: dict[Text, str | float | bool] = Field(default_factory=dict)
    """what else a quality engineer asks for; printed in the record"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key in ("phases", "controllers", "sensors"):
            names = [entry.name for entry in getattr(self, key)]
            if doubled := next((name for name in names if names.count(name) > 1), None):
                raise problem(f"names {doubled} twice", key)
        names = [phase.name for phase in self.phases]
        for key in ("essential", "quality"):
            for row, limit in enumerate(getattr(self, key)):
                if unknown := [phase for phase in limit.phases if phase not in names]:
                    raise problem(
                        f"names phase {unknown[0]}, which is not one of {', '.join(names)}",
                        key,
                        row,
                    )
        angles = [phase.to_deg for phase in self.phases if phase.to_deg is not None]
        if angles != sorted(set(angles)):
            raise problem("do not ascend in to_deg", "phases")
        return self

    @property
    def sha256(self) -> str:
        """Hash of everything that it says; comments and the order of keys do not count."""
        absent = {"weld_data"} if self.weld_data is None else None  # as before it was a key
        return digest(self.model_dump(mode="json", exclude=absent))

    @property
    def identity(self) -> Identity:
        """Name, revision and hash."""
        return Identity(
            id=self.id, revision=self.revision, date=self.date.isoformat(), sha256=self.sha256
        )


def digest(content: Any) -> str:
    """SHA-256 of plain values, independent of the order of their keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def tuning_sha256(parameters: Mapping[str, Any]) -> str:
    """Hash of a controller's parameters, as procedures and records have it."""
    return digest(tuning(parameters))


def tuning(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters that influence control; a file counts by its content, not its path."""
    paths = {key for key in parameters if f"{key}{CONTENT_SHA256}" in parameters}
    return {key: value for key, value in parameters.items() if key not in {*NOT_TUNING, *paths}}


def recorded_parameters(
    attachments: Mapping[str, bytes], namespace: str, controller: str
) -> dict[str, Any]:
    """Parameters that a controller's node was recorded with, among the attachments of a bag.

    Raises
    ------
    BagError
        The bag does not have them, or they cannot be read.
    """
    node = f"{namespace}/fsw_{controller}"
    data = attachments.get(f"parameters/{node.strip('/').replace('/', '.')}.yaml")
    if data is None:
        raise BagError(f"the bag has no parameters of {controller}")
    try:
        values = load_yaml(data.decode())[node]["ros__parameters"]
        return {str(key): value for key, value in values.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
        raise BagError(f"the parameters of {controller} in the bag cannot be read") from None


def attached(attachments: Mapping[str, bytes]) -> list[Procedure]:
    """The procedures that are attached to a bag."""
    differences = []
    for name, data in attachments.items():
        if name.endswith(".yaml") and _FORMAT.encode() in data:
            with suppress(InputError):  # a scenario that names the format is not a procedure
                differences.append(
                    validate(Procedure, content_of(data.decode("utf-8", "replace"), name), name)
                )
    return differences


def rule_book(attachments: Mapping[str, bytes]) -> RuleBook:
    """The rule book for the weld in a bag: the attached procedure, else the defaults."""
    return next(iter(attached(attachments)), None) or default()
