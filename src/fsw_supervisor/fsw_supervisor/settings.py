"""The supervisor's settings, validated; ``parameters.py`` documents each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from fsw_control.contract import Limits
from fsw_control.parameters import validate
from fsw_supervisor.parameters import SupervisorParameters

#: share of the time from the deadline to the next measurement after which a tick counts as
#: unanswered: 95 ms (chosen)
_UNANSWERED_SHARE = 0.75


@dataclass(frozen=True, slots=True)
class ArbiterSettings:
    """Settings of the arbiter; :mod:`fsw_supervisor.parameters` has names, units and ranges."""

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

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> ArbiterSettings:
        """Settings from the node's parameters; missing ones have their default."""
        checked = validate(SupervisorParameters, values)
        limits = Limits.from_parameters(checked)
        own = {item.name: checked[item.name] for item in fields(cls) if item.name in checked}
        return cls(**(own | {"limits": limits, "fallbacks": tuple(checked["fallbacks"])}))

    def takeover_s(self, lockstep: bool) -> float:
        """Time after a measurement at which a standby counts it as unanswered by the leader."""
        if lockstep:
            return 2.0 * self.lockstep_deadline_s
        return self.deadline_s + _UNANSWERED_SHARE * (self.tick_period_s - self.deadline_s)
