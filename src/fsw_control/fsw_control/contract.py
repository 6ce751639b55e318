"""The interface of a controller: pure data in, pure data out.

Units are the paper's and part of the names: mm, degC, N m, kN, rpm, s. Times are on the clock of
the measurements.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Protocol, get_args, runtime_checkable

from fsw_control import weld
from fsw_control.heat_plan import HeatPlan
from fsw_control.reason import Reason
from fsw_control.sensors import REQUIRED

#: sources of commands other than controllers: modes of the supervisor
BuiltInSource = Literal["manual", "hold", "safe_stop"]
BUILT_IN_SOURCES: tuple[str, ...] = get_args(BuiltInSource)
#: modes that an operator can request
OperatorMode = Literal["auto", BuiltInSource]
OPERATOR_MODES: tuple[str, ...] = get_args(OperatorMode)
SAFE_STOP: OperatorMode = "safe_stop"


class Measurement(NamedTuple):
    """The sensor samples of one tick."""

    time_s: float  #: stamp of the tick
    #: sensor values; NaN where the sensor is invalid
    depth_mm: float
    torque_nm: float
    temperature_c: float
    #: whether the value may be used
    depth_valid: bool = True
    torque_valid: bool = True
    temperature_valid: bool = True
    #: sensors (of ``SENSORS``) whose last good value stands in for a bad sample. They count as
    #: valid, but a filter must not treat the value as a measurement of this tick
    held: tuple[str, ...] = ()
    #: acting inputs, as the drives report them; NaN if unknown
    force_kn: float = float("nan")
    speed_rpm: float = float("nan")
    #: values of the optional sensors, by name; NaN if invalid or not there
    optional: Mapping[str, float] = MappingProxyType({})

    def invalid_sensors(self) -> tuple[str, ...]:
        """Names (of ``REQUIRED``) of the sensors that must not be used."""
        flags = (self.depth_valid, self.torque_valid, self.temperature_valid)
        return tuple(name for name, valid in zip(REQUIRED, flags, strict=True) if not valid)


class Coming(NamedTuple):
    """Set-points known in advance and their start, on the clock of ``Measurement.time_s``."""

    at_s: float
    depth_mm: float
    temperature_c: float


@dataclass(frozen=True, slots=True)
class Reference:
    """Set-points: shoulder depth and stir-zone temperature.

    ``coming`` are the next ones that are known, in order of time, and ``heat`` is the known heat
    along the path; for controllers that can look ahead.
    """

    depth_mm: float
    temperature_c: float
    coming: tuple[Coming, ...] = field(default=(), compare=False)
    heat: HeatPlan | None = field(default=None, compare=False)


class Command(NamedTuple):
    """The two manipulated variables: axial force and spindle speed."""

    force_kn: float
    speed_rpm: float


def towards(start: float, goal: float, step: float) -> float:
    """A value as near to ``goal`` as one step from ``start`` reaches."""
    return min(max(goal, start - step), start + step)


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of the manipulated variables and their largest change per tick.

    Raises
    ------
    ValueError
        If a minimum is not below its maximum.
    """

    force_min_kn: float = weld.FORCE_MIN_KN
    force_max_kn: float = weld.FORCE_MAX_KN
    speed_min_rpm: float = weld.SPEED_MIN_RPM
    speed_max_rpm: float = weld.SPEED_MAX_RPM
    force_step_kn: float = weld.FORCE_STEP_KN
    speed_step_rpm: float = weld.SPEED_STEP_RPM

    def __post_init__(self) -> None:
        bounds = (
            ("force", self.force_min_kn, self.force_max_kn),
            ("speed", self.speed_min_rpm, self.speed_max_rpm),
        )
        for name, low, high in bounds:
            if not low < high:
                raise ValueError(f"{name}_min ({low:g}) must be below {name}_max ({high:g})")

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Limits:
        """Limits from the parameters of a controller."""
        names = ("force_min", "force_max", "speed_min", "speed_max", "force_step", "speed_step")
        return cls(*(values[name] for name in names))

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Limits:
        """Limits from the parameters ``limits.*`` of a node."""
        return cls(**{item.name: values[f"limits.{item.name}"] for item in fields(cls)})

    def clip(self, requested: Command, previous: Command | None) -> Command:
        """Nearest command in bounds and within one step of ``previous``; rates take precedence."""
        force = min(max(requested.force_kn, self.force_min_kn), self.force_max_kn)
        speed = min(max(requested.speed_rpm, self.speed_min_rpm), self.speed_max_rpm)
        if previous is not None:
            force = towards(previous.force_kn, force, self.force_step_kn)
            speed = towards(previous.speed_rpm, speed, self.speed_step_rpm)
        return Command(force, speed)

    def active(self, command: Command, previous: Command) -> tuple[str, ...]:
        """Names of the limits that ``command`` touches, e.g. ``force_max`` or ``speed_rate``."""
        tolerance = 1e-9
        touched = {
            "force_min": command.force_kn <= self.force_min_kn + tolerance,
            "force_max": command.force_kn >= self.force_max_kn - tolerance,
            "speed_min": command.speed_rpm <= self.speed_min_rpm + tolerance,
            "speed_max": command.speed_rpm >= self.speed_max_rpm - tolerance,
            "force_rate": abs(command.force_kn - previous.force_kn)
            >= self.force_step_kn - tolerance,
            "speed_rate": abs(command.speed_rpm - previous.speed_rpm)
            >= self.speed_step_rpm - tolerance,
        }
        return tuple(name for name, touches in touched.items() if touches)


@dataclass(frozen=True, slots=True)
class Plan:
    """A predictive controller's horizon; every tuple has one value per entry of ``time_s``."""

    time_s: tuple[float, ...]
    depth_mm: tuple[float, ...]
    temperature_c: tuple[float, ...]
    force_kn: tuple[float, ...]
    speed_rpm: tuple[float, ...]


@dataclass(slots=True)  # created at every tick; frozen, it would take four times as long
class Diagnosis:
    """What a controller reports in addition to its command (all optional)."""

    depth_estimate_mm: float = float("nan")
    temperature_estimate_c: float = float("nan")
    torque_estimate_nm: float = float("nan")
    disturbances: dict[str, float] = field(default_factory=dict)
    solver_status: str = ""
    iterations: int = 0
    solve_time_s: float = 0.0
    active_limits: tuple[str, ...] = ()
    bad_cycles: int = 0
    plan: Plan | None = None


@dataclass(frozen=True, slots=True)
class Proposal:
    """What a controller would apply at this tick.

    ``healthy`` false means: do not apply; ``reason`` says why. A controller may give a text of
    its own, which the graph reports as ``ReasonCode.OTHER``.
    """

    command: Command
    healthy: bool = True
    reason: Reason | str = Reason()  # noqa: RUF009  # immutable
    diagnosis: Diagnosis = field(default_factory=Diagnosis)


@runtime_checkable
class Controller(Protocol):
    """Anything that turns measurements into proposals.

    It is stepped at every tick, selected or not. ``applied`` is the command that the plant really
    executed during the tick that just ended; a controller that tracks it takes over without a
    bump.
    """

    @property
    def name(self) -> str:
        """By which it is selected."""
        ...

    @property
    def tolerated_sensors(self) -> tuple[str, ...]:
        """Sensors that may be invalid for a while without invalidating the proposal."""
        ...

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        """Compute the proposal that answers ``measurement``; never raises on bad measurements."""
        ...

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied`` without a bump."""
        ...
