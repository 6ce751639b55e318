"""Settings of a plant, read from parameters and validated against :mod:`fsw_plant.parameters`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fsw_control import Limits, parameters
from fsw_control.depth_footprint import Footprint
from fsw_control.schema import models
from fsw_control.schema.models import InputError, validate
from fsw_model import STEP_S, ModelParameters
from fsw_plant.canister import CanisterParameters
from fsw_plant.machine import Machine
from fsw_plant.parameters import PlantParameters


@dataclass(frozen=True, slots=True)
class PlantConfig:
    """Settings of a plant, by the names of ``parameters.py``: ``config["watchdog.hold_s"]``."""

    values: Mapping[str, Any]  #: all settings; ``parameters.py`` has units, ranges and meaning
    limits: Limits  #: of the drives
    model: ModelParameters  #: of the emulated process, mismatch included
    machine: Machine
    footprint: Footprint | None  #: of an earlier weld on the machine
    footprint_sha256: str = ""  #: of its file
    canister: CanisterParameters | None = None  #: None for the paper's process

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    @classmethod
    def from_values(
        cls, values: Mapping[str, Any], before: PlantConfig | None = None
    ) -> PlantConfig:
        """Read settings by parameter name.

        Parameters
        ----------
        values : mapping of str to Any
            Nested (``{"start": {"depth_mm": 2.7}}``), dotted (``{"start.depth_mm": 2.7}``) or
            mixed; omitted ones have their default. Parameters that only the node uses (``speed``,
            ...) are checked as well.
        before : PlantConfig, optional
            Settings that these replace: a footprint that stays is not read again.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a name is unknown, a value has the wrong type or is out of range, or values
            contradict each other.
        """
        checked = parameters.validate(PlantParameters, flatten(values))
        try:
            limits = Limits(
                force_min_kn=checked["limits.force_min_kn"],
                force_max_kn=checked["limits.force_max_kn"],
                speed_min_rpm=checked["limits.speed_min_rpm"],
                speed_max_rpm=checked["limits.speed_max_rpm"],
                force_step_kn=checked["limits.force_rate_kn_per_s"] * STEP_S,
                speed_step_rpm=checked["limits.speed_rate_rpm_per_s"] * STEP_S,
            )
            machine = validate(
                Machine,
                {name: checked[f"machine.{name}"] for name in Machine.model_fields},
                "machine",
            )
            file = machine.footprint_file
            if before is not None and before.machine.footprint_file == file:
                footprint = before.footprint, before.footprint_sha256
            else:
                footprint = Footprint.from_named(file)
            return cls(checked, limits, _model(checked), machine, *footprint, _canister(checked))
        except ValueError as error:
            raise InputError(str(error)) from None


def json_schema() -> dict[str, Any]:
    """JSON Schema of the settings as nested mappings; dotted names may be given, too."""
    schema = models.json_schema(PlantParameters)

    def inlined(part: dict[str, Any]) -> dict[str, Any]:
        part = schema["$defs"][part["$ref"].rpartition("/")[2]] if "$ref" in part else part
        return {key: inlined(v) if isinstance(v, dict) else v for key, v in part.items()}

    shape = inlined({key: part for key, part in schema.items() if key not in ("$defs", "$schema")})
    return shape | {"patternProperties": {r"\.": {}}}


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
    factors = {name: values[f"factors.{name}"] for name in ModelParameters.model_fields}
    parameters = ModelParameters.from_file(Path(file)) if file else ModelParameters()
    return parameters.scaled(**{name: factor for name, factor in factors.items() if factor != 1.0})


def _canister(values: Mapping[str, Any]) -> CanisterParameters | None:
    """The parameters of the canister."""
    if values["process"] != "canister":
        return None
    own = {name: values[f"canister.{name}"] for name in CanisterParameters.model_fields}
    return validate(CanisterParameters, own, "canister")
