"""Parameters of the process model: value, origin and allowed range of each, and files of others."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, fields, replace
from functools import cache
from math import inf, nextafter
from pathlib import Path
from typing import Any

import yaml

_LARGEST = sys.float_info.max  # also compares with an int that no float can hold
_POSITIVE, _NOT_NEGATIVE, _ANY = (nextafter(0.0, 1.0), inf), (0.0, inf), (-inf, inf)


class ModelParameterError(ValueError):
    """A parameter is unknown, not a number or out of range."""


def _given(value: float, origin: str, allowed: tuple[float, float] = _POSITIVE) -> Any:
    """A parameter: its nominal value, the equation of the paper it is from (or "chosen"), and its allowed range."""
    return field(default=value, metadata={"origin": origin, "allowed": allowed})


@dataclass(frozen=True, slots=True)
class ModelParameters:
    """Coefficients of equations (15)-(27), in the units of their names; the nominal ones by default.

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
    ModelParameterError
        If a value is not finite, not physical, or beyond what the model's step of 0.1 s can do.
    """

    operating_force_kn: float = _given(78.4, "paper (15)")
    operating_depth_mm: float = _given(2.66, "paper (15)")
    operating_temperature_c: float = _given(816.4, "paper (15)", _ANY)
    operating_power_kw: float = _given(43.6, "paper (15)")
    thermal_gain_c_per_kw: float = _given(18.1, "paper (16)")
    copper_lag_s: float = _given(30.5, "paper (16)")
    tool_lag_s: float = _given(1.2, "paper (16)")
    dead_time_s: float = _given(2.8, "paper (16)", (0.1, 10.0))
    depth_gain_mm_per_kn_s: float = _given(0.0016, "paper (17)")
    depth_zero_s: float = _given(29.6, "paper (17)")
    depth_pole_slow_s: float = _given(14.7, "paper (17)")
    depth_pole_fast_s: float = _given(0.00095, "paper (17)", (1e-6, 5e-3))
    motor_lag_s: float = _given(0.27, "paper (18)", (0.01, 10.0))
    sticking_stress_pa: float = _given(152800.0, "paper (19)", _NOT_NEGATIVE)
    sliding_friction: float = _given(0.435, "paper (19)", _NOT_NEGATIVE)
    contact_radius_m: float = _given(0.015, "paper (21), (22)")
    contact_slope: float = _given(20.0 / 3.0, "paper (21), (22): 20/3")
    geometry_offset_m3: float = _given(2.3e-5, "paper (22)", _ANY)
    geometry_factor: float = _given(2.408, "paper (22)")
    friction_constant_nm: float = _given(243.11, "paper (8), (23)", _ANY)
    friction_linear_nm_per_rpm: float = _given(-1.305, "paper (8), (23)", _ANY)
    friction_quadratic_nm_per_rpm2: float = _given(0.001927, "paper (8), (23)", _ANY)
    softening_per_c: float = _given(0.0021, "paper (6), (27)", _NOT_NEGATIVE)
    spindle_inertia_kgm2: float = _given(2.0, "chosen: size of the torque peak in Fig. 5", _NOT_NEGATIVE)

    def __post_init__(self) -> None:
        for one in fields(self):
            value, (low, high) = getattr(self, one.name), one.metadata["allowed"]
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
                raise ModelParameterError(f"model parameter {one.name!r} is {value!r}: give a finite number")
            if not low <= value <= high:
                bounds = f"{low:g} to {high:g}" if high < inf else "> 0" if low > 0.0 else ">= 0"
                raise ModelParameterError(f"model parameter {one.name!r} is {value!r}: must be {bounds}")
        if self.depth_pole_slow_s <= self.depth_pole_fast_s:
            raise ModelParameterError("model parameter 'depth_pole_slow_s' must be larger than 'depth_pole_fast_s'")

    def scaled(self, **factors: float) -> ModelParameters:
        """A copy with some values multiplied, e.g. ``scaled(thermal_gain_c_per_kw=1.2)``: a plant unlike its model.

        Raises
        ------
        ModelParameterError
            If a name is unknown or a value is not valid.
        """
        _check_names(factors, "scaled()")
        return replace(self, **{name: getattr(self, name) * factor for name, factor in factors.items()})

    @classmethod
    def from_yaml(cls, text: str, where: str = "model parameters") -> ModelParameters:
        """Read the parameters that differ from the nominal ones.

        Parameters
        ----------
        text : str
            YAML mapping of parameter names to numbers. ``1e5`` is a number here, although YAML 1.1 takes it for text.
        where : str
            Name of the source, for error messages.

        Raises
        ------
        ModelParameterError
            If the text is not a mapping or empty, or a name or value is not valid.
        """
        try:
            data = yaml.safe_load(text)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ModelParameterError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
        if data is None:
            raise ModelParameterError(f"{where}: holds no parameters; give some, e.g. dead_time_s: 2.5")
        if not isinstance(data, dict):
            raise ModelParameterError(
                f"{where}: expected a mapping of parameter names to numbers, got {type(data).__name__}"
            )
        _check_names(data, where)
        try:
            return cls(**{name: _number(value) for name, value in data.items()})
        except ModelParameterError as error:
            raise ModelParameterError(f"{where}: {error}") from None

    @classmethod
    def from_file(cls, path: str | Path) -> ModelParameters:
        """Read a YAML file, see :meth:`from_yaml`; also one that cannot be read is a ModelParameterError."""
        try:
            text = Path(path).read_text(encoding="utf-8")
        except OSError as error:
            raise ModelParameterError(f"cannot read model {path}: {error.strerror}") from None
        except ValueError:
            raise ModelParameterError(f"cannot read model {path}: not a text file in UTF-8") from None
        return cls.from_yaml(text, str(path))


#: Where each value comes from: the equation of the paper, or chosen for this project.
ORIGIN: dict[str, str] = {one.name: one.metadata["origin"] for one in fields(ModelParameters)}


def _check_names(names: Any, where: str) -> None:
    unknown = sorted(str(name) for name in names if name not in ORIGIN)
    if unknown:
        raise ModelParameterError(
            f"{where}: unknown model parameter {', '.join(unknown)}; known: {', '.join(sorted(ORIGIN))}"
        )


def _number(value: Any) -> Any:
    """The number that a YAML scalar like ``1e5`` stands for; anything else as it is, to be refused by its type."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


@cache
def nominal() -> ModelParameters:
    """The nominal parameters: those of the paper, and the chosen ones."""
    return ModelParameters()
