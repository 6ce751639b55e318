"""Settings of a plant, read from parameters and validated against ``plant.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from fsw_canister import CanisterParameters
from fsw_control import Limits, parameters
from fsw_control.parameters import ParameterSpec
from fsw_model import STEP_S, ModelParameters
from fsw_schema.models import InputError, descriptions, validate
from fsw_schema.ranges import Range


@lru_cache(maxsize=1)
def specs() -> dict[str, ParameterSpec]:
    """Descriptions of all parameters of the plant.

    They are those of ``plant.yaml``, a factor for each parameter of the model, and the canister's.
    """
    factors = {
        f"model.{name}": ParameterSpec(
            f"model.{name}",
            "double",
            1.0,
            f"Factor on the model parameter {name}",
            range=(0.1, 10.0),
        )
        for name in ModelParameters.model_fields
    }
    return parameters.load("fsw_plant", "plant.yaml") | factors | _canister_specs()


def _canister_specs() -> dict[str, ParameterSpec]:
    """Parameters of the canister, as described by its model; they are read at the start only."""
    found, texts = {}, descriptions(CanisterParameters)
    for name, field in CanisterParameters.model_fields.items():
        bounds = next((one for one in field.metadata if isinstance(one, Range)), None)
        options = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
        kind = {bool: "bool", int: "int", str: "string"}.get(type(field.default), "double")
        found[f"canister.{name}"] = ParameterSpec(
            f"canister.{name}",
            kind,
            field.default,
            texts[name],
            unit=bounds.unit if bounds else "",
            range=(bounds.low, bounds.high) if bounds else None,
            options=options,
            read_only=True,
        )
    return found


@dataclass(frozen=True, slots=True)
class PlantConfig:
    """Settings of a plant, by the names of ``plant.yaml``: ``config["watchdog.hold_s"]``."""

    values: Mapping[str, Any]  #: all settings; ``plant.yaml`` has units, ranges and meaning
    limits: Limits  #: of the drives
    model: ModelParameters  #: of the emulated process, mismatch included
    canister: CanisterParameters | None = None  #: None for the paper's process

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    @property
    def drives(self) -> tuple[float, int]:
        """Lag of the drives [s], and their dead time in ticks."""
        return self["actuators.lag_s"], self["actuators.dead_time_ticks"]

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> PlantConfig:
        """Read settings by parameter name.

        Parameters
        ----------
        values : mapping of str to Any
            Nested (``{"start": {"depth_mm": 2.7}}``), dotted (``{"start.depth_mm": 2.7}``) or
            mixed; omitted ones have their default. Parameters that only the node uses (``speed``,
            ...) are checked as well.

        Raises
        ------
        fsw_schema.models.InputError
            If a name is unknown, a value has the wrong type or is out of range, or values
            contradict each other.
        """
        checked = parameters.validate(specs(), flatten(values))
        try:
            limits = Limits(
                force_min_kn=checked["limits.force_min_kn"],
                force_max_kn=checked["limits.force_max_kn"],
                speed_min_rpm=checked["limits.speed_min_rpm"],
                speed_max_rpm=checked["limits.speed_max_rpm"],
                force_step_kn=checked["limits.force_rate_kn_per_s"] * STEP_S,
                speed_step_rpm=checked["limits.speed_rate_rpm_per_s"] * STEP_S,
            )
            return cls(checked, limits, _model(checked), _canister(checked))
        except ValueError as error:
            raise InputError(str(error)) from None


def json_schema() -> dict[str, Any]:
    """JSON Schema of the settings as nested mappings."""
    root: dict[str, Any] = {"type": "object", "patternProperties": {r"\.": {}}}
    for spec in specs().values():
        *groups, name = spec.name.split(".")
        inside = root
        for group in groups:
            inside = inside.setdefault("properties", {}).setdefault(group, {"type": "object"})
        kind = {"double": "number", "int": "integer", "bool": "boolean", "string": "string"}.get(
            spec.type, "array"
        )
        entry = {"type": kind, "description": spec.description, "default": spec.default}
        if spec.unit:
            entry["unit"] = spec.unit
        if spec.range is not None and kind != "array":
            entry["minimum"], entry["maximum"] = spec.range
        if spec.options:
            entry["enum"] = list(spec.options)
        inside.setdefault("properties", {})[name] = entry
        inside["additionalProperties"] = False
    return root


def flatten(values: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted names from nested mappings."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update({f"{name}.{inner}": v for inner, v in flatten(value).items()})
        else:
            flat[str(name)] = value
    return flat


def _model(values: Mapping[str, Any]) -> ModelParameters:
    """The parameters of the model file, each with its factor."""
    file = values["model_file"]
    factors = {name: values[f"model.{name}"] for name in ModelParameters.model_fields}
    parameters = ModelParameters.from_file(Path(file)) if file else ModelParameters()
    return parameters.scaled(**{name: factor for name, factor in factors.items() if factor != 1.0})


def _canister(values: Mapping[str, Any]) -> CanisterParameters | None:
    """The parameters of the canister."""
    if values["process"] != "canister":
        return None
    own = {name: values[f"canister.{name}"] for name in CanisterParameters.model_fields}
    return validate(CanisterParameters, own, "canister")
