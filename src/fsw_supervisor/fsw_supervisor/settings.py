"""Everything that can be set in the supervisor, validated, and how it follows from the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Any

from fsw_control import weld
from fsw_control.contract import Limits


@dataclass(frozen=True, slots=True)
class ArbiterSettings:
    """Settings of the arbiter; every number is checked on construction.

    Attributes
    ----------
    controller : str
        Selected at the start.
    fallbacks : tuple of str
        Who answers when the active controller fails, in this order.
    limits : Limits
        Bounds and largest change per tick of the command.
    tick_period_s, deadline_s : float
        Nominal time between two measurements; time after the measurement at which a command is decided anyway.
    lockstep_deadline_s : float
        Wall time that replaces ``deadline_s`` in lockstep, where the plant waits for the command.
    lockstep_shadow_wait_s : float
        Wall time per tick that lockstep waits for shadow controllers that keep up; 0: only for the active one.
    sensor_grace_s : float
        How long a decision waits for the rest of the tick's sensors once the proposal is there.
    stall_tolerance_s : float
        A deadline noticed later than this is the arbiter's own stall: nobody is blamed.
    takeover_wait_s : float
        After a start: how long to look for what is applied and who is selected before commanding changes.
    takeover_ticks : int
        Ticks in a row that nobody has answered before a standby takes over.
    warm_ticks : int
        Good proposals in a row before a controller may be selected.
    readmit_ticks : int
        Good shadow proposals in a row that readmit an inhibited controller; 0: only the operator does.
    force_transition_kn, speed_transition_rpm : float
        Largest change per tick just after a swap; at most the limits' step.
    transition_ticks : int
        Longest duration of a transition.
    hold_timeout_s : float
        Hold longer than this while auto is wanted: safe stop.
    storm_swaps, storm_window_s : int, float
        More automatic swaps than this within the window: hold.
    switch_interval_s : float
        Shortest time between two swaps asked for by the operator.
    safe_force_kn, safe_rate_kn_per_s : float
        Force that a safe stop ramps to and the rate; a lower force stays, the spindle keeps turning.
    return_to_target : bool
        After a failover, go back to the operator's choice as soon as it is ready.
    duplicate_ticks : int
        Ticks in a row with two different proposals of one name before that name is distrusted.
    """

    controller: str = "decentral"
    fallbacks: tuple[str, ...] = ("decentral", "nmpc")
    limits: Limits = field(default_factory=Limits)
    tick_period_s: float = weld.TICK_S
    deadline_s: float = 0.08
    lockstep_deadline_s: float = 1.5
    lockstep_shadow_wait_s: float = 0.5
    sensor_grace_s: float = 0.01
    stall_tolerance_s: float = 0.05
    takeover_wait_s: float = 0.3
    takeover_ticks: int = 2
    warm_ticks: int = 5
    readmit_ticks: int = 30
    force_transition_kn: float = weld.FORCE_STEP_KN
    speed_transition_rpm: float = weld.SPEED_STEP_RPM
    transition_ticks: int = 20
    hold_timeout_s: float = 10.0
    storm_swaps: int = 4
    storm_window_s: float = 30.0
    switch_interval_s: float = 0.3
    safe_force_kn: float = 65.0
    safe_rate_kn_per_s: float = 2.0
    return_to_target: bool = False
    duplicate_ticks: int = 3

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, int | float) and not isinstance(value, bool) and (not isfinite(value) or value < 0):
                raise ValueError(f"{item.name} is {value}; it must be finite and not negative")
        lim = self.limits
        if not (lim.force_min_kn < lim.force_max_kn and lim.speed_min_rpm < lim.speed_max_rpm):
            raise ValueError("limits: the minimum of force and of speed must be below the maximum")
        if not 0.0 < self.deadline_s < self.tick_period_s:
            raise ValueError(
                f"deadline_s is {self.deadline_s} s; it must lie between 0 and tick_period_s ({self.tick_period_s} s)"
            )
        if not 0.0 < self.force_transition_kn <= lim.force_step_kn:
            raise ValueError(f"force_transition_kn must lie above 0 and at most at the step of {lim.force_step_kn} kN")
        if not 0.0 < self.speed_transition_rpm <= lim.speed_step_rpm:
            raise ValueError(
                f"speed_transition_rpm must lie above 0 and at most at the step of {lim.speed_step_rpm} rpm"
            )
        if not lim.force_min_kn <= self.safe_force_kn <= lim.force_max_kn:
            raise ValueError(f"safe_force_kn must lie in {lim.force_min_kn} to {lim.force_max_kn} kN")
        if min(self.takeover_ticks, self.warm_ticks, self.duplicate_ticks) < 1:
            raise ValueError("takeover_ticks, warm_ticks and duplicate_ticks must be at least 1")
        if not self.controller:
            raise ValueError("controller must name the controller to start with, e.g. 'decentral'")

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> ArbiterSettings:
        """Settings from the parameters of ``supervisor.yaml``.

        Raises
        ------
        ValueError
            When the parameters contradict each other; the message says which.
        """
        limits = Limits(**{item.name: values[f"limits.{item.name}"] for item in fields(Limits)})
        own = {item.name: values[item.name] for item in fields(cls) if item.name in values}
        return cls(**(own | {"limits": limits, "fallbacks": tuple(values["fallbacks"])}))

    def ticks(self, time_s: float) -> int:
        """Ticks that ``time_s`` is long, at least 1."""
        return max(1, round(time_s / self.tick_period_s))

    def takeover_s(self, lockstep: bool) -> float:
        """Time after a measurement at which a standby calls it unanswered: after the one on duty has decided."""
        return 2.0 * self.lockstep_deadline_s if lockstep else (self.deadline_s + 3.0 * self.tick_period_s) / 4.0
