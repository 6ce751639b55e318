"""Settings of a plant, read from parameters and validated against :mod:`fsw_plant.parameters`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fsw_control import Limits
from fsw_control.depth_footprint import Footprint
from fsw_control.schema import models
from fsw_control.schema.models import InputError
from fsw_model import STEP_S, ModelParameters
from fsw_plant.canister import CanisterParameters
from fsw_plant.parameters import Machine, PlantParameters


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
        own = PlantParameters.from_values(flatten(values))
        drives = dict(own.limits)
        rates = drives.pop("force_rate_kn_per_s"), drives.pop("speed_rate_rpm_per_s")
        steps = {"force_step_kn": rates[0] * STEP_S, "speed_step_rpm": rates[1] * STEP_S}
        file, canister = own.machine.footprint_file, own.canister
        try:
            if before is not None and before.machine.footprint_file == file:
                footprint = before.footprint, before.footprint_sha256
            else:
                footprint = Footprint.from_named(file)
            return cls(
                own.flat(),
                Limits(**drives, **steps),
                _model(own),
                own.machine,
                *footprint,
                canister if own.process == "canister" else None,
            )
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


def _model(own: PlantParameters) -> ModelParameters:
    """Parameters of the emulated process: from a file or nominal, times the factors."""
    model = ModelParameters.from_file(own.model_file) if own.model_file else ModelParameters()
    return model.scaled(**{name: factor for name, factor in own.factors if factor != 1.0})
