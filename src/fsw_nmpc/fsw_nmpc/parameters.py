"""Parameters of the NMPC."""

from __future__ import annotations

from typing import Annotated, Literal

from fsw_control.common_parameters import ControllerLimits
from fsw_control.parameters import AT_START
from fsw_control.schema.models import Whole
from fsw_control.schema.ranges import Range


class NmpcParameters(ControllerLimits):
    """Parameters of the NMPC. All but ``model_file`` act at runtime, without a bump."""

    preset: Literal["default", "paper", "paper:letter"] = "default"
    """default: by rule from the model; paper: weights, dead-bands and corridors of the paper,
    (32)-(37), with estimated disturbances; paper:letter: without these, as in the paper."""
    tuning_file: str = ""
    """YAML file of tuning fields that override the preset (docs/concepts/nmpc.md); empty: none."""
    depth_aggressiveness: Annotated[float, Range(0.2, 5.0, "")] = 1.0
    """Divides the time constant with which the depth approaches its set-point."""
    temperature_aggressiveness: Annotated[float, Range(0.2, 5.0, "")] = 1.0
    """Divides the time constant with which the temperature approaches its set-point."""
    calmness: Annotated[float, Range(0.1, 10.0, "")] = 1.0
    """Above 1: sensor noise moves the inputs less, disturbances are rejected more slowly."""
    priority: Literal["depth", "balance", "temperature"] = "depth"
    """Set-point that is kept where the speed's bounds do not permit both; quality limits come
    before it (docs/concepts/nmpc.md)."""
    preview: bool = True
    """Anticipate set-points announced on fsw/reference_plan."""
    model_file: Annotated[str, AT_START] = ""
    """YAML file of model parameters; empty: the paper's."""
    machine_file: str = ""
    """YAML file of the sensors' noise and the drives' rates (fsw.py identify --machine): noise
    above the preset's replaces it, rates below force_step and speed_step replace these; empty:
    none."""
    max_iterations: Annotated[Whole, Range(5, 200, "")] = 50
    """Maximum iterations of the interior-point method; bounds the time of a step."""
    plan_reuse: Annotated[Whole, Range(0, 50, "")] = 5
    """Ticks for which the last plan is followed after a failed solve; after that the proposal is
    unhealthy."""
    blind_limit: Annotated[float, Range(0.0, 60.0, "s")] = 3.0
    """Maximum time without a valid sample of a sensor; after that the proposal is unhealthy."""
