"""Parameters of the process model: a validated dataclass, read from and written to YAML."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from importlib import resources
from math import inf, isfinite
from pathlib import Path
from typing import Any

import yaml

#: Where each value comes from: the equation of the paper, or chosen for this project.
ORIGIN: dict[str, str] = {
    "operating_force_kn": "paper (15)",
    "operating_depth_mm": "paper (15)",
    "operating_temperature_c": "paper (15)",
    "operating_power_kw": "paper (15)",
    "thermal_gain_c_per_kw": "paper (16)",
    "copper_lag_s": "paper (16)",
    "tool_lag_s": "paper (16)",
    "dead_time_s": "paper (16)",
    "depth_gain_mm_per_kn_s": "paper (17)",
    "depth_zero_s": "paper (17)",
    "depth_pole_slow_s": "paper (17)",
    "depth_pole_fast_s": "paper (17)",
    "motor_lag_s": "paper (18)",
    "sticking_stress_pa": "paper (19)",
    "sliding_friction": "paper (19)",
    "contact_radius_m": "paper (21), (22)",
    "contact_slope": "paper (21), (22): 20/3",
    "geometry_offset_m3": "paper (22)",
    "geometry_factor": "paper (22)",
    "friction_constant_nm": "paper (8), (23)",
    "friction_linear_nm_per_rpm": "paper (8), (23)",
    "friction_quadratic_nm_per_rpm2": "paper (8), (23)",
    "softening_per_c": "paper (6), (27)",
    "spindle_inertia_kgm2": "chosen: size of the torque peak in Fig. 5",
}

_ANY_SIGN = {
    "operating_temperature_c",
    "geometry_offset_m3",
    "friction_constant_nm",
    "friction_linear_nm_per_rpm",
    "friction_quadratic_nm_per_rpm2",
}
_MAY_BE_ZERO = {"softening_per_c", "sticking_stress_pa", "sliding_friction", "spindle_inertia_kgm2"}
#: what the model's step of 0.1 s and the controllers' tables are made for
_RANGES = {"dead_time_s": (0.1, 10.0), "depth_pole_fast_s": (1e-6, 5e-3), "motor_lag_s": (0.01, 10.0)}


class ParameterError(ValueError):
    """A parameter is unknown, missing, not a number or out of range."""


@dataclass(frozen=True, slots=True)
class ModelParameters:
    """Coefficients of equations (15)-(27), in the units of their names.

    Attributes
    ----------
    operating_force_kn, operating_depth_mm, operating_temperature_c, operating_power_kw : float
        Point of linearisation (15).
    thermal_gain_c_per_kw, copper_lag_s, tool_lag_s, dead_time_s : float
        Power to temperature (16): ``gain exp(-dead_time s) / ((1 + copper_lag s) (1 + tool_lag s))``.
    depth_gain_mm_per_kn_s, depth_zero_s, depth_pole_slow_s, depth_pole_fast_s : float
        Force to depth (17): ``gain (1 + zero s) / (s (1 + slow s) (1 + fast s))``.
    motor_lag_s : float
        Lag of the motor torque tau_M (18).
    sticking_stress_pa, sliding_friction : float
        ``delta tau_yield`` and ``(1 - delta) mu`` of the contact shear stress (19).
    contact_radius_m, contact_slope : float
        Radius of the contact at zero depth, and its growth with depth, m per m (21), (22).
    geometry_offset_m3, geometry_factor : float
        Coefficients of G (22).
    friction_constant_nm, friction_linear_nm_per_rpm, friction_quadratic_nm_per_rpm2 : float
        Friction torque of motor and transmission over the speed (23).
    softening_per_c : float
        Slope of the correction factor (6), (27).
    spindle_inertia_kgm2 : float
        Makes the peak of the measured torque when the spindle accelerates; it does not act on the process.

    Raises
    ------
    ParameterError
        If a value is not finite, not physical, or beyond what the model's step can do.
    """

    operating_force_kn: float
    operating_depth_mm: float
    operating_temperature_c: float
    operating_power_kw: float
    thermal_gain_c_per_kw: float
    copper_lag_s: float
    tool_lag_s: float
    dead_time_s: float
    depth_gain_mm_per_kn_s: float
    depth_zero_s: float
    depth_pole_slow_s: float
    depth_pole_fast_s: float
    motor_lag_s: float
    sticking_stress_pa: float
    sliding_friction: float
    contact_radius_m: float
    contact_slope: float
    geometry_offset_m3: float
    geometry_factor: float
    friction_constant_nm: float
    friction_linear_nm_per_rpm: float
    friction_quadratic_nm_per_rpm2: float
    softening_per_c: float
    spindle_inertia_kgm2: float

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
                raise ParameterError(f"model parameter {name!r} is {value!r}: give a finite number")
            low, high = _RANGES.get(name, (-inf, inf))
            if not low <= value <= high:
                raise ParameterError(f"model parameter {name!r} is {value!r}: must be {low:g} to {high:g}")
            if name in _ANY_SIGN or value > 0 or (value == 0 and name in _MAY_BE_ZERO):
                continue
            bound = ">= 0" if name in _MAY_BE_ZERO else "> 0"
            raise ParameterError(f"model parameter {name!r} is {value!r}: must be {bound}")
        if self.depth_pole_slow_s <= self.depth_pole_fast_s:
            raise ParameterError("model parameter 'depth_pole_slow_s' must be larger than 'depth_pole_fast_s'")

    def with_values(self, **values: float) -> ModelParameters:
        """A copy with some values replaced.

        Raises
        ------
        ParameterError
            If a name is unknown or a value is not valid.
        """
        _check_names(values, "with_values()")
        return replace(self, **values)

    def scaled(self, **factors: float) -> ModelParameters:
        """A copy with some values multiplied, e.g. ``scaled(thermal_gain_c_per_kw=1.2)``: a plant unlike its model."""
        _check_names(factors, "scaled()")
        return self.with_values(**{name: getattr(self, name) * factor for name, factor in factors.items()})

    def to_yaml(self) -> str:
        """YAML text that ``from_yaml`` reads back to an equal object."""
        return yaml.safe_dump(asdict(self), sort_keys=False)

    @classmethod
    def from_yaml(cls, text: str, where: str = "model parameters") -> ModelParameters:
        """Read all parameters, or some of them over the nominal ones.

        Parameters
        ----------
        text : str
            YAML mapping of parameter names to numbers; names left out keep their nominal value. ``1e5`` is a number
            here, although YAML 1.1 takes it for text.
        where : str
            Name of the source, for error messages.

        Raises
        ------
        ParameterError
            If the text is not a mapping, or a name or value is not valid.
        """
        try:
            data = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ParameterError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
        if data is None:
            data = {}
        if not isinstance(data, dict):
            raise ParameterError(
                f"{where}: expected a mapping of parameter names to numbers, got {type(data).__name__}"
            )
        _check_names(data, where)
        values = {name: _number(value) for name, value in data.items()}
        try:
            return cls(**values) if set(values) == _NAMES else nominal().with_values(**values)
        except ParameterError as error:
            raise ParameterError(f"{where}: {error}") from None

    @classmethod
    def from_file(cls, path: str | Path) -> ModelParameters:
        """Read a YAML file, see :meth:`from_yaml`."""
        return cls.from_yaml(Path(path).read_text(encoding="utf-8"), str(path))


_NAMES = {field.name for field in fields(ModelParameters)}


def _check_names(names: Any, where: str) -> None:
    unknown = sorted(str(name) for name in names if name not in _NAMES)
    if unknown:
        raise ParameterError(
            f"{where}: unknown model parameter {', '.join(unknown)}; known: {', '.join(sorted(_NAMES))}"
        )


def _number(value: Any) -> Any:
    """The number that a YAML scalar like ``1e5`` stands for; anything else as it is, to be refused by its type."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


@cache
def nominal() -> ModelParameters:
    """The nominal parameters shipped with the package (``nominal.yaml``)."""
    text = resources.files("fsw_model").joinpath("nominal.yaml").read_text(encoding="utf-8")
    return ModelParameters(**yaml.safe_load(text))
