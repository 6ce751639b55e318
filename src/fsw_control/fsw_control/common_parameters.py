"""Parameters that several nodes share: drive limits, sensor validity, every controller's own."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any

from pydantic import Field, create_model, model_validator

from fsw_control import weld
from fsw_control.contract import Limits
from fsw_control.parameters import AT_START, NodeParameters, ParameterModel
from fsw_control.schema.models import Many, Model, Whole
from fsw_control.schema.ranges import Range
from fsw_control.sensors import SENSORS


class DriveBounds(Model):
    """Bounds of force and speed."""

    force_min_kn: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_MIN_KN
    """Minimum axial force (chosen)."""
    force_max_kn: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_MAX_KN
    """Maximum axial force (chosen)."""
    speed_min_rpm: Annotated[float, Range(0.0, 2000.0, "rpm")] = weld.SPEED_MIN_RPM
    """Minimum spindle speed (chosen)."""
    speed_max_rpm: Annotated[float, Range(0.0, 2000.0, "rpm")] = weld.SPEED_MAX_RPM
    """Maximum spindle speed (chosen)."""

    @model_validator(mode="after")
    def _ordered(self) -> DriveBounds:
        Limits(self.force_min_kn, self.force_max_kn, self.speed_min_rpm, self.speed_max_rpm)
        return self


class DriveLimits(DriveBounds):
    """Bounds of force and speed, and of their changes."""

    force_step_kn: Annotated[float, Range(0.001, 100.0, "kN")] = weld.FORCE_STEP_KN
    """Maximum change of force per tick; at the gateway relative to the set-point in force."""
    speed_step_rpm: Annotated[float, Range(0.001, 1000.0, "rpm")] = weld.SPEED_STEP_RPM
    """Maximum change of speed per tick; at the gateway relative to the set-point in force."""


class ControllerLimits(NodeParameters):
    """Bounds of a controller's proposals."""

    force_min: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_MIN_KN
    """Minimum axial force."""
    force_max: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_MAX_KN
    """Maximum axial force."""
    speed_min: Annotated[float, Range(1.0, 1000.0, "rpm")] = weld.SPEED_MIN_RPM
    """Minimum spindle speed."""
    speed_max: Annotated[float, Range(1.0, 1000.0, "rpm")] = weld.SPEED_MAX_RPM
    """Maximum spindle speed."""
    force_step: Annotated[float, Range(0.001, 10.0, "kN")] = weld.FORCE_STEP_KN
    """Maximum change of the axial force per tick."""
    speed_step: Annotated[float, Range(0.001, 100.0, "rpm")] = weld.SPEED_STEP_RPM
    """Maximum change of the spindle speed per tick."""


class Commands(Model):
    """Which commands plant and gateway accept."""

    max_age_s: Annotated[float, Range(0.0, 60.0, "s")] = 0.5
    """Maximum age of the measurement that an accepted command answers (chosen)."""
    sources: Many[str] = ()
    """Sources whose commands are accepted; empty: all, or, with several publishers of commands,
    those that the supervisor announces."""


class SensorSamples(Model):
    """Base of the limits of one sensor's samples."""

    minimum: float
    maximum: float

    @model_validator(mode="after")
    def _ordered(self) -> SensorSamples:
        if not self.minimum < self.maximum:
            raise ValueError(f"minimum {self.minimum} must be below maximum {self.maximum}")
        return self


class Validity(Model):
    """Which samples of the sensors may be used; every sensor is a group inside."""

    hold: Annotated[float, Range(0.0, 5.0, "s")] = 0.3
    """Time for which the last good sample of a sensor (the supervisor: or of the drives) replaces
    bad or missing ones."""
    frozen_samples: Annotated[Whole, Range(0, 1000, "")] = 10
    """Minimum number of equal samples in a row of a noisy signal before the sensor counts as
    frozen; 0: never."""
    confirm_samples: Annotated[Whole, Range(1, 100, "")] = 3
    """Number of samples in a row that must agree after a jump or a failure before the sensor is
    valid again."""


def fields_of(groups: Mapping[str, Model]) -> Any:
    """Fields for ``create_model`` from groups with their defaults."""
    return {name: (type(group), group) for name, group in groups.items()}


def numbers(fields: dict[str, tuple[Range, float, str]]) -> Any:
    """Fields for ``create_model`` from range, default and description of each number."""
    return {
        name: (Annotated[float, bounds], Field(default, description=text))
        for name, (bounds, default, text) in fields.items()
    }


_NOISE = (
    "Expected standard deviation of the {}'s noise; where its changes were below a fifth of it, "
    "the sensor never counts as frozen (chosen, as the emulator's)"
)
_JUMP = (
    "Maximum change of the {} within a second, or per second after a longer loss; after a larger "
    "one it stays invalid until the operator acknowledges (chosen: several times what the drives "
    "can cause)"
)


def _validity(jumps: bool) -> type[Model]:
    """The groups ``validity.<sensor>``, of a supervisor with the largest jump that is believed.

    Controllers believe every jump, because they cannot be acknowledged.
    """
    sensors: dict[str, Model] = {}
    for name, row in SENSORS.items():
        quantity, title = row.quantity, row.title
        rate = Range(0.001, 100_000.0, f"{quantity.unit}/s")
        ends = quantity.plausible
        fields = {
            "minimum": (ends, row.minimum, f"Minimum plausible sample of the {title}"),
            "maximum": (ends, row.maximum, f"Maximum plausible sample of the {title}"),
            "max_rate": (rate, row.max_rate, f"Maximum plausible rate of change of the {title}"),
            "noise": (quantity.noise, row.noise, _NOISE.format(title)),
        }
        if jumps and row.max_jump is not None:
            reach = Range(0.001, 100_000.0, quantity.unit)
            fields["max_jump"] = reach, row.max_jump, _JUMP.format(title)
        group = create_model(f"{name}_validity", __base__=SensorSamples, **numbers(fields))
        sensors[name] = group.model_validate({})
    return create_model("ValidityOfSensors", __base__=Validity, **fields_of(sensors))


CONTROLLER_VALIDITY, SUPERVISOR_VALIDITY = _validity(jumps=False)(), _validity(jumps=True)()


class ControllerParameters(NodeParameters):
    """Parameters that every controller node has, whatever controller it hosts."""

    deadline: Annotated[float, Range(0.001, 0.08, "s")] = 0.03
    """In real time, maximum time to wait for the other samples of a tick after its first one."""
    lockstep_deadline: Annotated[float, Range(0.01, 10.0, "s")] = 1.0
    """In simulated time, the same in wall-clock time; only reached if a message is lost."""
    period: Annotated[float, Range(0.001, 1.0, "s"), AT_START] = 0.1
    """Sampling period of the first tick; later ticks use the time since the previous one."""
    initial_force: Annotated[float, Range(0.0, 200.0, "kN"), AT_START] = weld.FORCE_KN
    """Axial force assumed as applied until the first command arrives."""
    initial_speed: Annotated[float, Range(0.0, 1000.0, "rpm"), AT_START] = weld.SPEED_RPM
    """Spindle speed assumed as applied until the first command arrives."""
    validity: type(CONTROLLER_VALIDITY) = CONTROLLER_VALIDITY  # type: ignore[valid-type]


@cache
def hosted(own: ParameterModel) -> type[NodeParameters]:
    """Parameters of a controller's node: its own and those of every controller node."""
    if own is None:
        return ControllerParameters
    model = create_model("HostedParameters", __base__=(own, ControllerParameters))
    return model
