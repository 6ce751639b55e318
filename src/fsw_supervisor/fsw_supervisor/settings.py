"""The supervisor's settings, validated; ``supervisor.yaml`` says what each of them means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from fsw_control import weld
from fsw_control.contract import Limits


@dataclass(frozen=True, slots=True)
class ArbiterSettings:
    """Settings of the arbiter: names, units, ranges, meanings and defaults are those of ``supervisor.yaml``.

    Raises
    ------
    ValueError
        When settings contradict each other; the message says which.
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
        lim, period_s = self.limits, self.tick_period_s
        if lim.force_min_kn >= lim.force_max_kn or lim.speed_min_rpm >= lim.speed_max_rpm:
            raise ValueError("limits: the minimum of force and of speed must be below the maximum")
        if self.deadline_s >= period_s:
            raise ValueError(
                f"deadline_s is {self.deadline_s} s; it must lie between 0 and tick_period_s ({period_s} s)"
            )
        if self.force_transition_kn > lim.force_step_kn:
            raise ValueError(f"force_transition_kn must not lie above the step of {lim.force_step_kn} kN")
        if self.speed_transition_rpm > lim.speed_step_rpm:
            raise ValueError(f"speed_transition_rpm must not lie above the step of {lim.speed_step_rpm} rpm")
        if not lim.force_min_kn <= self.safe_force_kn <= lim.force_max_kn:
            raise ValueError(f"safe_force_kn must lie in {lim.force_min_kn} to {lim.force_max_kn} kN")
        if not self.controller:
            raise ValueError("controller must name the controller to start with, e.g. 'decentral'")

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> ArbiterSettings:
        """Settings from the parameters of ``supervisor.yaml``."""
        limits = Limits(**{item.name: values[f"limits.{item.name}"] for item in fields(Limits)})
        own = {item.name: values[item.name] for item in fields(cls) if item.name in values}
        return cls(**(own | {"limits": limits, "fallbacks": tuple(values["fallbacks"])}))

    def ticks(self, time_s: float) -> int:
        """Ticks that ``time_s`` is long, at least 1."""
        return max(1, round(time_s / self.tick_period_s))

    def takeover_s(self, lockstep: bool) -> float:
        """Time after a measurement at which a standby calls it unanswered: the leader has decided by then."""
        return 2.0 * self.lockstep_deadline_s if lockstep else (self.deadline_s + 3.0 * self.tick_period_s) / 4.0
