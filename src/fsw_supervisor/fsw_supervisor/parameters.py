"""Parameters of the supervisor. Chosen means: not published, chosen for this project."""

from __future__ import annotations

import re
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import create_model, model_validator

from fsw_control import weld
from fsw_control.common_parameters import SUPERVISOR_VALIDITY, DriveLimits, fields_of, numbers
from fsw_control.contract import BUILT_IN_SOURCES, Limits
from fsw_control.fence import UNKNOWN
from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import Many, Model, Whole
from fsw_control.schema.ranges import Range

#: share of the time from the deadline to the next measurement after which a tick counts as
#: unanswered: 95 ms (chosen)
_UNANSWERED_SHARE = 0.75
#: names of controllers, and those that none may have: of other sources, and of the supervisor's
#: topics
NAME, RESERVED = "[A-Za-z][A-Za-z0-9_]*", (*BUILT_IN_SOURCES, "supervisor", UNKNOWN)


def may_be_controller(name: str) -> bool:
    """Whether a controller may have this name."""
    return name not in RESERVED and re.fullmatch(NAME, name) is not None


class InterlockLimits(Model):
    """Limits of one interlock.

    The kind of a name that ends in ``_low`` has the trip below the warning.
    """

    low: ClassVar[bool]
    warn: float
    trip: float

    @model_validator(mode="after")
    def _ordered(self) -> InterlockLimits:
        if not (self.warn > self.trip if self.low else self.warn < self.trip):
            raise ValueError(f"warn {self.warn} must come before trip {self.trip}")
        return self


class _Interlocks(Model):
    """Parameters ``interlocks.*`` that are no interlock."""

    persistence_s: Annotated[float, Range(0.1, 100.0, "s")] = 0.3
    """Minimum time that a worse level must last before it takes effect, and time without it before
    a trip is cleared; at least two samples (chosen)."""


class _Row(NamedTuple):
    """An interlock: the value that it watches, with its unit and default limits."""

    name: str
    quantity: str
    unit: str
    warn: float
    trip: float
    hysteresis: float
    warned: str  #: when it warns
    tripped: str = ""  #: when it trips, if the text is another

    def limits(self) -> InterlockLimits:
        """Its parameters."""
        bounds, distance = Range(-1000.0, 10_000.0, self.unit), Range(0.0, 1000.0, self.unit)
        fields = {
            "warn": (bounds, self.warn, f"Warning {self.warned}"),
            "trip": (bounds, self.trip, f"Safe stop {self.tripped or self.warned}"),
            "hysteresis": (distance, self.hysteresis, _HYSTERESIS),
        }
        group = create_model(f"{self.name}_limits", __base__=InterlockLimits, **numbers(fields))
        group.low = self.name.endswith("_low")
        return group.model_validate({})


_HYSTERESIS = (
    "Distance that the value must return past the limit before the warning or trip is cleared "
    "(chosen)"
)
_COLD, _HOT = (f"{side} this probe temperature" for side in ("below", "above"))
_INSIDE = " (chosen, 10 degC inside the process window)"
_WINDOW = (
    ": the process window of 790 to 910 degC prevents defects and fracture of the tool "
    "(lup.lub.lu.se/record/1961682)"
)
_SHALLOW = (
    "below this shoulder depth: the shoulder leaves the copper, or the sensor has slipped (chosen)"
)
_UNSURE = (
    "above this standard deviation of the depth: its sensors disagree or too few are left, "
    "and the depth is not known (chosen)"
)
_BROKEN = "below this motor torque: the probe broke, or the sensor failed (chosen)"
_TORQUE = "at this deviation from the torque that the model expects of depth and force"
_WEAK = f"{_TORQUE}: the probe broke, or a sensor is wrong (chosen)"
_STRONG = f"{_TORQUE}: the depth sensor slipped, or the torque sensor is wrong (chosen)"
_MOVED = "at this movement of the depth that force and temperature do not explain (chosen)"
_HEATED = "at this movement of the temperature that the power does not explain (chosen)"
_C, _DEPTH, _NM = ("temperature_c", "degC"), ("depth_mm", "mm"), ("torque_nm", "N m")
_RATIO, _MOVEMENT = ("torque_residual_percent", "%"), ("depth_residual_mm", "mm")
_HEAT = "temperature_residual_c", "degC"
_ROWS = (
    _Row("temperature_low", *_C, 800.0, 790.0, 2.0, _COLD + _INSIDE, _COLD + _WINDOW),
    _Row("temperature_high", *_C, 900.0, 910.0, 2.0, _HOT + _INSIDE, _HOT + _WINDOW),
    _Row("depth_low", *_DEPTH, 1.7, 1.4, 0.02, _SHALLOW),
    _Row("depth_high", *_DEPTH, 3.4, 3.7, 0.02, "above this shoulder depth (chosen)"),
    _Row("depth_deviation_high", "depth_deviation_mm", "mm", 0.1, 0.2, 0.01, _UNSURE),
    _Row("force_high", "force_kn", "kN", 95.5, 97.0, 0.5, "above this axial force (chosen)"),
    _Row("torque_low", *_NM, 500.0, 400.0, 20.0, _BROKEN),
    _Row("torque_high", *_NM, 1400.0, 1600.0, 20.0, "above this motor torque (chosen)"),
    _Row("power_high", "power_kw", "kW", 60.0, 66.0, 1.0, "above this motor power (chosen)"),
    _Row("torque_model_low", *_RATIO, -6.0, -8.0, 0.5, _WEAK),
    _Row("torque_model_high", *_RATIO, 6.0, 8.0, 0.5, _STRONG),
    _Row("depth_model_low", *_MOVEMENT, -0.3, -0.4, 0.05, _MOVED),
    _Row("depth_model_high", *_MOVEMENT, 0.3, 0.4, 0.05, _MOVED),
    _Row("temperature_model_low", *_HEAT, -75.0, -90.0, 2.0, _HEATED),
    _Row("temperature_model_high", *_HEAT, 75.0, 90.0, 2.0, _HEATED),
)
#: by interlock, the value that it watches
QUANTITIES = {row.name: row.quantity for row in _ROWS}
_LIMITS = {row.name: row.limits() for row in _ROWS}
INTERLOCKS = create_model("Interlocks", __base__=_Interlocks, **fields_of(_LIMITS))()


class SupervisorParameters(NodeParameters):
    """Parameters of the supervisor, and the settings of its arbiter."""

    controller: Annotated[str, AT_START] = "decentral"
    """Controller to start with."""
    fallbacks: Many[str] = ("decentral", "nmpc")
    """Controllers that replace the active one when it fails, in this order."""
    lockstep: Annotated[Literal["auto", "on", "off"], AT_START] = "auto"
    """Whether the plant waits for the command, so that wall-clock deadlines are only a safeguard;
    auto: as use_sim_time."""
    tick_period_s: Annotated[float, Range(0.001, 1.0, "s"), AT_START] = weld.TICK_S
    """Nominal time between two measurements."""
    deadline_s: Annotated[float, Range(0.0005, 1.0, "s")] = 0.08
    """Time after the measurement at which a command is decided with what has arrived."""
    lockstep_deadline_s: Annotated[float, Range(0.05, 60.0, "s")] = 1.5
    """Wall time that replaces deadline_s in lockstep."""
    lockstep_shadow_wait_s: Annotated[float, Range(0.0, 60.0, "s")] = 0.5
    """In lockstep, maximum wall time per tick to wait for shadow controllers that keep up; 0: wait
    for the active one only."""
    sensor_grace_s: Annotated[float, Range(0.0, 0.08, "s")] = 0.01
    """Maximum time to wait for the rest of a tick's sensors once the proposal has arrived
    (chosen)."""
    stall_tolerance_s: Annotated[float, Range(0.005, 1.0, "s")] = 0.05
    """Delay beyond the deadline from which the supervisor itself counts as stalled, and no
    controller as failed (chosen)."""
    takeover_wait_s: Annotated[float, Range(0.0, 5.0, "s")] = 0.3
    """Time after a start during which the supervisor waits for all controllers to report which of
    them is active, before it sends commands (chosen)."""
    first_report_wait_s: Annotated[float, Range(0.0, 5.0, "s")] = 2.0
    """The same while no controller has reported anything: only they know of a safe stop before the
    start, and on a busy machine nodes take a second to find each other (chosen)."""
    standby: Annotated[bool, AT_START] = False
    """Start as standby: follow the leading supervisor and take over when it sends no more
    commands; needs its own node name."""
    takeover_ticks: Annotated[Whole, Range(1, 100, "")] = 2
    """Number of unanswered ticks in a row after which a standby takes over, in the last of them
    (chosen)."""
    warm_ticks: Annotated[Whole, Range(1, 1000, "")] = 5
    """Minimum number of good proposals in a row before a controller is ready to be selected
    (chosen)."""
    readmit_ticks: Annotated[Whole, Range(0, 100000, "")] = 30
    """Number of good proposals in a row after which an inhibited controller is readmitted; 0: only
    by the operator (chosen)."""
    force_transition_kn: Annotated[float, Range(0.001, 10.0, "kN")] = weld.FORCE_STEP_KN
    """Maximum change of force per tick during the transition after a swap; at most
    limits.force_step_kn."""
    speed_transition_rpm: Annotated[float, Range(0.001, 30.0, "rpm")] = weld.SPEED_STEP_RPM
    """Maximum change of speed per tick during the transition after a swap; at most
    limits.speed_step_rpm."""
    transition_ticks: Annotated[Whole, Range(0, 1000, "")] = 20
    """Maximum number of ticks that a transition after a swap lasts (chosen)."""
    start_timeout_s: Annotated[float, Range(0.1, 3600.0, "s")] = 30.0
    """Time in start, from the first measurement on, after which a safe stop begins, because no
    controller is available while the force acts (chosen: several times the start-up time of a
    controller)."""
    hold_timeout_s: Annotated[float, Range(0.1, 3600.0, "s")] = 10.0
    """Time in hold, with auto as the target, after which a safe stop begins (chosen)."""
    operator_hold_timeout_s: Annotated[float, Range(0.1, 3600.0, "s")] = 300.0
    """Time in a hold requested by the operator, or in manual with an invalid sensor, after which a
    safe stop begins; a new request restarts it (chosen: long enough to attend to something while
    the interlocks are active, too short for a weld without control)."""
    blind_limit_s: Annotated[float, Range(0.1, 3600.0, "s")] = 12.0
    """Time for which a sensor may be invalid under automatic control before a safe stop begins; it
    adds up, and ten times as long with good samples makes it good again (chosen: between
    hold_timeout_s and the time that the decentralized controller does without torque or
    temperature)."""
    storm_swaps: Annotated[Whole, Range(0, 100, "")] = 4
    """Maximum number of automatic swaps within storm_window_s; one more leads to hold; 0: no limit
    (chosen)."""
    storm_window_s: Annotated[float, Range(0.1, 3600.0, "s")] = 30.0
    """Time window in which automatic swaps are counted (chosen)."""
    switch_interval_s: Annotated[float, Range(0.1, 60.0, "s")] = 0.3
    """Minimum time between two swaps requested by the operator (chosen)."""
    safe_force_kn: Annotated[float, Range(0.0, 200.0, "kN")] = 65.0
    """Force to which a safe stop ramps while the spindle keeps turning; a lower force is kept
    (chosen, as for the plant's watchdog)."""
    safe_rate_kn_per_s: Annotated[float, Range(0.01, 100.0, "kN/s")] = 2.0
    """Rate of the ramp to the safe force (chosen, as for the plant's watchdog)."""
    return_to_target: bool = False
    """Whether to return to the operator's choice after a failover, as soon as it is ready."""
    duplicate_ticks: Annotated[Whole, Range(1, 1000, "")] = 3
    """Number of ticks in a row with two different proposals of one name after which that
    controller is no longer used (chosen)."""
    limits: DriveLimits = DriveLimits()
    latency_warn_s: Annotated[float, Range(0.0, 10.0, "s")] = 0.05
    """99th percentile of a controller's latency from which diagnostics warn (chosen)."""
    latency_error_s: Annotated[float, Range(0.0, 10.0, "s")] = 0.075
    """99th percentile of a controller's latency from which diagnostics report an error
    (chosen)."""
    interlocks: type(INTERLOCKS) = INTERLOCKS  # type: ignore[valid-type]
    validity: type(SUPERVISOR_VALIDITY) = SUPERVISOR_VALIDITY  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _consistent(self) -> SupervisorParameters:
        limits, period_s = self.limits, self.tick_period_s
        if self.deadline_s >= period_s:
            text = f"it must be between 0 and tick_period_s ({period_s} s)"
            raise ValueError(f"deadline_s is {self.deadline_s} s; {text}")
        step_kn, step_rpm = limits.force_step_kn, limits.speed_step_rpm
        if self.force_transition_kn > step_kn:
            raise ValueError(f"force_transition_kn must not exceed the step of {step_kn} kN")
        if self.speed_transition_rpm > step_rpm:
            raise ValueError(f"speed_transition_rpm must not exceed the step of {step_rpm} rpm")
        low_kn, high_kn = limits.force_min_kn, limits.force_max_kn
        if not low_kn <= self.safe_force_kn <= high_kn:
            raise ValueError(f"safe_force_kn must be within {low_kn} to {high_kn} kN")
        if not self.controller:
            raise ValueError("controller must name the controller to start with, e.g. 'decentral'")
        for name in (self.controller, *self.fallbacks):
            if not may_be_controller(name):
                text = f"{name!r} cannot be the name of a controller"
                raise ValueError(f"controller, fallbacks: {text}")
        return self

    @cached_property
    def drive_limits(self) -> Limits:
        """The limits of every command; made once, as every tick needs them several times."""
        return Limits(**dict(self.limits))

    def takeover_s(self, lockstep: bool) -> float:
        """Time after a measurement at which a standby counts it as unanswered by the leader."""
        if lockstep:
            return 2.0 * self.lockstep_deadline_s
        return self.deadline_s + _UNANSWERED_SHARE * (self.tick_period_s - self.deadline_s)
