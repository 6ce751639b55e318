"""The supervisor's settings, validated; ``supervisor.yaml`` documents each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from fsw_control.contract import Limits
from fsw_control.parameters import load, validate

#: share of the time from the deadline to the next measurement after which a tick counts as
#: unanswered: 95 ms (chosen)
_UNANSWERED_SHARE = 0.75


@dataclass(frozen=True, slots=True)
class ArbiterSettings:
    """Settings of the arbiter; names, units, ranges and defaults are in ``supervisor.yaml``.

    Raises
    ------
    ValueError
        If settings contradict each other; the message names them.
    """

    controller: str
    fallbacks: tuple[str, ...]
    limits: Limits
    tick_period_s: float
    deadline_s: float
    lockstep_deadline_s: float
    lockstep_shadow_wait_s: float
    sensor_grace_s: float
    stall_tolerance_s: float
    takeover_wait_s: float
    first_report_wait_s: float
    takeover_ticks: int
    warm_ticks: int
    readmit_ticks: int
    force_transition_kn: float
    speed_transition_rpm: float
    transition_ticks: int
    start_timeout_s: float
    hold_timeout_s: float
    operator_hold_timeout_s: float
    storm_swaps: int
    storm_window_s: float
    switch_interval_s: float
    safe_force_kn: float
    safe_rate_kn_per_s: float
    return_to_target: bool
    duplicate_ticks: int

    def __post_init__(self) -> None:
        lim, period_s = self.limits, self.tick_period_s
        if self.deadline_s >= period_s:
            raise ValueError(
                f"deadline_s is {self.deadline_s} s; "
                f"it must be between 0 and tick_period_s ({period_s} s)"
            )
        if self.force_transition_kn > lim.force_step_kn:
            raise ValueError(
                f"force_transition_kn must not exceed the step of {lim.force_step_kn} kN"
            )
        if self.speed_transition_rpm > lim.speed_step_rpm:
            raise ValueError(
                f"speed_transition_rpm must not exceed the step of {lim.speed_step_rpm} rpm"
            )
        if not lim.force_min_kn <= self.safe_force_kn <= lim.force_max_kn:
            raise ValueError(
                f"safe_force_kn must be within {lim.force_min_kn} to {lim.force_max_kn} kN"
            )
        if not self.controller:
            raise ValueError("controller must name the controller to start with, e.g. 'decentral'")

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> ArbiterSettings:
        """Settings from the parameters of ``supervisor.yaml``; missing ones have their default."""
        checked = validate(load("fsw_supervisor", "supervisor.yaml"), values)
        limits = Limits.from_parameters(checked)
        own = {item.name: checked[item.name] for item in fields(cls) if item.name in checked}
        return cls(**(own | {"limits": limits, "fallbacks": tuple(checked["fallbacks"])}))

    def takeover_s(self, lockstep: bool) -> float:
        """Time after a measurement at which a standby counts it as unanswered by the leader."""
        if lockstep:
            return 2.0 * self.lockstep_deadline_s
        return self.deadline_s + _UNANSWERED_SHARE * (self.tick_period_s - self.deadline_s)
