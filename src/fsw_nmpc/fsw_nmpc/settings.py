"""Converts the node's parameters into the controller's settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from fsw_control import Limits
from fsw_control.parameters import defaults, validate
from fsw_control.weld import TICK_S
from fsw_model import MachineData, ModelParameters, nominal
from fsw_nmpc.parameters import NmpcParameters
from fsw_nmpc.tuning import Priority, Tuning

_DEFAULTS = defaults(NmpcParameters)


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings of the node, validated."""

    model: ModelParameters
    tuning: Tuning
    limits: Limits
    priority: Priority = _DEFAULTS["priority"]
    max_iterations: int = _DEFAULTS["max_iterations"]
    plan_reuse: int = _DEFAULTS["plan_reuse"]
    blind_limit_s: float = _DEFAULTS["blind_limit"]
    preview: bool = _DEFAULTS["preview"]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from parameter values; missing ones have their defaults.

        Raises
        ------
        ValueError
            If a value is unknown or out of range, values contradict each other, or a file is not
            usable.
        """
        v = validate(NmpcParameters, values)
        model = ModelParameters.from_file(v["model_file"]) if v["model_file"] else nominal()
        machine = MachineData()
        if v["machine_file"]:
            machine = MachineData.from_file(v["machine_file"])
        tuning = Tuning.preset(v["preset"], model).with_noise(machine)
        if v["tuning_file"]:
            tuning = Tuning.from_file(v["tuning_file"], tuning)
        tuning = tuning.with_knobs(
            v["depth_aggressiveness"], v["temperature_aggressiveness"], v["calmness"]
        )
        return cls(
            model=model,
            tuning=tuning,
            limits=_reached(Limits.of(v), machine),
            priority=v["priority"],
            max_iterations=v["max_iterations"],
            plan_reuse=v["plan_reuse"],
            blind_limit_s=v["blind_limit"],
            preview=v["preview"],
        )


def _reached(limits: Limits, machine: MachineData) -> Limits:
    """Limits whose moves the drives can follow."""
    rates = {
        "force_step_kn": machine.force_rate_kn_per_s,
        "speed_step_rpm": machine.speed_rate_rpm_per_s,
    }
    slower = {
        name: min(getattr(limits, name), TICK_S * rate)
        for name, rate in rates.items()
        if rate is not None
    }
    return replace(limits, **slower)
