"""What a plant is made of: settings read from parameters or YAML, checked against ``plant.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from fsw_control import parameters
from fsw_control.parameters import ParameterError, ParameterSpec
from fsw_model import ModelParameters
from fsw_model import ParameterError as ModelParameterError
from fsw_plant.commands import LimitsConfig
from fsw_plant.watchdog import WatchdogConfig


@dataclass(frozen=True, slots=True)
class SensorsConfig:
    """Noise and resolution of the sensors, see ``plant.yaml``."""

    depth_noise_mm: float
    torque_noise_nm: float
    temperature_noise_c: float
    depth_resolution_mm: float
    torque_resolution_nm: float
    temperature_resolution_c: float
    torque_drop_nm_per_rpm: float


@lru_cache(maxsize=1)
def specs() -> dict[str, ParameterSpec]:
    """Descriptions of all parameters of the plant: ``plant.yaml``, and a factor on each parameter of the model."""
    factors = {
        f"model.{field.name}": ParameterSpec(
            f"model.{field.name}", "double", 1.0, f"Factor on the model parameter {field.name}", range=(0.1, 10.0)
        )
        for field in fields(ModelParameters)
    }
    return parameters.load("fsw_plant", "plant.yaml") | factors


@dataclass(frozen=True, slots=True)
class PlantConfig:
    """Settings of a plant; names, units, ranges and meaning as in ``plant.yaml``.

    Attributes
    ----------
    seed : int
    noise : bool
    start_depth_mm, start_temperature_c : float
    limits : LimitsConfig
    lag_s : float
    sensors : SensorsConfig
    watchdog : WatchdogConfig
    max_age_s : float
    sources : tuple of str
    model : ModelParameters
        Those of the emulated process, mismatch included.
    """

    seed: int
    noise: bool
    start_depth_mm: float
    start_temperature_c: float
    limits: LimitsConfig
    lag_s: float
    sensors: SensorsConfig
    watchdog: WatchdogConfig
    max_age_s: float
    sources: tuple[str, ...]
    model: ModelParameters

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> PlantConfig:
        """Read settings by parameter name.

        Parameters
        ----------
        values : mapping of str to Any
            Nested (``{"start": {"depth_mm": 2.7}}``), dotted (``{"start.depth_mm": 2.7}``) or mixed; what is left out
            has its default. Parameters that only the node uses (``speed``, ...) are checked and not used.

        Raises
        ------
        fsw_control.parameters.ParameterError
            If a name is unknown, or a value has the wrong type or is out of range, or values contradict.
        """
        checked = parameters.validate(specs(), flatten(values))

        def section(name: str) -> dict[str, Any]:
            return {key.removeprefix(name + "."): v for key, v in checked.items() if key.startswith(name + ".")}

        limits = LimitsConfig(**section("limits"))
        for what, low, high in (
            ("force", limits.force_min_kn, limits.force_max_kn),
            ("speed", limits.speed_min_rpm, limits.speed_max_rpm),
        ):
            if low >= high:
                raise ParameterError(f"limits.{what}_min ({low:g}) must be below limits.{what}_max ({high:g})")
        return cls(
            seed=checked["seed"],
            noise=checked["noise"],
            start_depth_mm=checked["start.depth_mm"],
            start_temperature_c=checked["start.temperature_c"],
            limits=limits,
            lag_s=checked["actuators.lag_s"],
            sensors=SensorsConfig(**section("sensors")),
            watchdog=WatchdogConfig(**section("watchdog")),
            max_age_s=checked["commands.max_age_s"],
            sources=tuple(checked["commands.sources"]),
            model=_model(checked["model_file"], section("model")),
        )

    @classmethod
    def from_yaml(cls, text: str, where: str = "plant configuration") -> PlantConfig:
        """Read settings from YAML text, see :meth:`from_values`.

        Raises
        ------
        fsw_control.parameters.ParameterError
            As :meth:`from_values`, and if the text is not a YAML mapping.
        """
        try:
            data = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ParameterError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
        if data is not None and not isinstance(data, dict):
            raise ParameterError(f"{where}: must map parameter names to values")
        try:
            return cls.from_values(data or {})
        except ParameterError as error:
            raise ParameterError(f"{where}: {error}") from None


def flatten(values: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted names from nested mappings."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update({f"{name}.{inner}": v for inner, v in flatten(value).items()})
        else:
            flat[str(name)] = value
    return flat


def _model(file: str, factors: Mapping[str, float]) -> ModelParameters:
    try:
        nominal = ModelParameters.from_file(Path(file)) if file else ModelParameters.from_yaml("")
        return nominal.scaled(**{name: factor for name, factor in factors.items() if factor != 1.0})
    except OSError as error:
        raise ParameterError(f"model_file: cannot read {file}: {error.strerror}") from None
    except ModelParameterError as error:
        raise ParameterError(str(error)) from None
