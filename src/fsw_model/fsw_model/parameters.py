"""Parameters of the process model: a validated dataclass, read from and written to YAML."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from importlib import resources
from math import isfinite, pi, sqrt
from pathlib import Path
from typing import Any

import yaml

#: Where each value comes from. The paper's full text was not at hand when the model was written, only the numbers that
#: it publishes. ``published``: one of these numbers. ``identified``: solved from published numbers, given the form that
#: this project gives the equation (see ``equations``); not a number of the paper. ``chosen``: neither.
ORIGIN: dict[str, str] = {
    "operating_depth_mm": "published",
    "operating_temperature_c": "chosen: middle of the 790-910 degC window",
    "operating_force_kn": "published",
    "ambient_temperature_c": "chosen",
    "depth_gain_mm_per_kn_s": "published: +1 kN creeps 1.6 um/s",
    "depth_zero_s": "identified: transient of 0.0238 mm/kN",
    "depth_pole_slow_s": "published",
    "depth_pole_fast_s": "published",
    "softening_gain_mm_per_c": "identified: static gain 0.521 of the thermal-depth loop",
    "softening_time_s": "chosen",
    "thermal_gain_c_per_kw": "chosen: the line through ambient and the operating point (43.6 kW)",
    "thermal_time_s": "chosen: initial slope near 0.29 degC/(kW s)",
    "dead_time_s": "published: 28 samples of 0.1 s",
    "shoulder_radius_m": "identified: dM/dz = 120.8 N m/mm",
    "contact_inner_radius_m": "identified: A = 3.366e-3 m2",
    "probe_volume_m3": "identified: G = 9.933e-5 m3",
    "sticking_stress_pa": "identified: M_sp = 1021.53 N m",
    "friction_coefficient": "identified: dM/dF = 12.84 N m/kN",
    "bearing_torque_nm": "chosen split of M_f = 31.333 N m at 407.576 rpm",
    "bearing_viscosity_nm_per_rpm": "chosen split of M_f = 31.333 N m at 407.576 rpm",
    "spindle_inertia_kgm2": "chosen: size of the torque spike at spindle acceleration",
}

_ANY_SIGN = {"ambient_temperature_c", "softening_gain_mm_per_c", "probe_volume_m3"}
_MAY_BE_ZERO = {"sticking_stress_pa", "bearing_torque_nm", "bearing_viscosity_nm_per_rpm", "spindle_inertia_kgm2"}


class ParameterError(ValueError):
    """A parameter is unknown, missing, not a number or out of range."""


@dataclass(frozen=True, slots=True)
class ModelParameters:
    """Parameters of equations (5)-(27), in the units of their names.

    Attributes
    ----------
    operating_depth_mm, operating_temperature_c, operating_force_kn : float
        Point about which depth is linear (17), (27).
    ambient_temperature_c : float
        Stir-zone temperature without power.
    depth_gain_mm_per_kn_s, depth_zero_s, depth_pole_slow_s, depth_pole_fast_s : float
        Force to depth (17): ``K (1 + s Tz) / (s (1 + s T1) (1 + s T2))``.
    softening_gain_mm_per_c, softening_time_s : float
        Temperature to depth (27): hot copper is soft.
    thermal_gain_c_per_kw, thermal_time_s, dead_time_s : float
        Process power to temperature.
    shoulder_radius_m : float
        Radius of curvature of the convex shoulder (19).
    contact_inner_radius_m : float
        Inner radius of the contact ring, where the probe begins (19), (21).
    probe_volume_m3 : float
        Share of the probe in the torque geometry factor (21).
    sticking_stress_pa, friction_coefficient : float
        Contact shear stress ``tau_0 + mu sigma`` (22).
    bearing_torque_nm, bearing_viscosity_nm_per_rpm : float
        Friction torque of the spindle (8).
    spindle_inertia_kgm2 : float
        Inertia that the motor torque shows when the spindle accelerates.

    Raises
    ------
    ParameterError
        If a value is not finite or not physical.
    """

    operating_depth_mm: float
    operating_temperature_c: float
    operating_force_kn: float
    ambient_temperature_c: float
    depth_gain_mm_per_kn_s: float
    depth_zero_s: float
    depth_pole_slow_s: float
    depth_pole_fast_s: float
    softening_gain_mm_per_c: float
    softening_time_s: float
    thermal_gain_c_per_kw: float
    thermal_time_s: float
    dead_time_s: float
    shoulder_radius_m: float
    contact_inner_radius_m: float
    probe_volume_m3: float
    sticking_stress_pa: float
    friction_coefficient: float
    bearing_torque_nm: float
    bearing_viscosity_nm_per_rpm: float
    spindle_inertia_kgm2: float

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
                raise ParameterError(f"model parameter {name!r} is {value!r}: give a finite number")
            if name in _ANY_SIGN or value > 0 or (value == 0 and name in _MAY_BE_ZERO):
                continue
            bound = ">= 0" if name in _MAY_BE_ZERO else "> 0"
            raise ParameterError(f"model parameter {name!r} is {value!r}: must be {bound}")
        if self.depth_pole_slow_s <= self.depth_pole_fast_s:
            raise ParameterError("model parameter 'depth_pole_slow_s' must be larger than 'depth_pole_fast_s'")
        if self.shallowest_depth_mm >= self.operating_depth_mm:
            raise ParameterError(
                f"model parameter 'contact_inner_radius_m' = {self.contact_inner_radius_m}: the shoulder would not "
                f"touch at the operating depth (it touches below {self.shallowest_depth_mm:.3f} mm)"
            )

    @property
    def shallowest_depth_mm(self) -> float:
        """Depth at which the shoulder begins to touch: the contact area (19) is zero there."""
        return 1e3 * self.contact_inner_radius_m**2 / (2.0 * self.shoulder_radius_m)

    def contact_radius_m(self, depth_mm: float) -> float:
        """Outer radius of the contact ring at a depth (19)."""
        return sqrt(2.0 * self.shoulder_radius_m * depth_mm * 1e-3)

    def contact_area_m2(self, depth_mm: float) -> float:
        """Contact area A (19)."""
        return pi * (self.contact_radius_m(depth_mm) ** 2 - self.contact_inner_radius_m**2)

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
        """A copy with some values multiplied, e.g. ``scaled(thermal_gain_c_per_kw=1.2)``: plant-model mismatch."""
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
