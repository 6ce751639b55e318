"""Files of the model's parameters and covariance, and of a machine's noise and rates."""

from __future__ import annotations

from functools import cache
from math import nan
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from fsw_control.schema.models import Parameters, problem
from fsw_control.schema.ranges import Range


class ModelParameters(Parameters):
    """Coefficients of equations (15)-(27), in the units of their names; nominal by default.

    Attributes
    ----------
    operating_force_kn, operating_depth_mm, operating_temperature_c, operating_power_kw : float
        Point of linearisation (15).
    thermal_gain_c_per_kw, copper_lag_s, tool_lag_s, dead_time_s : float
        Power to temperature (16): ``gain exp(-dead_time s) / ((1 + copper_lag s) (1 + tool_lag
        s))``.
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
        Makes the peak of the measured torque when the spindle accelerates; it does not act on the
        process.

    Raises
    ------
    ValueError
        If a value is not finite, not physical, or beyond what the model's step of 0.1 s can do.
    """

    what = "model"
    example = "dead_time_s: 2.5"

    operating_force_kn: PositiveFloat = Field(default=78.4, description="paper (15)")
    operating_depth_mm: PositiveFloat = Field(default=2.66, description="paper (15)")
    operating_temperature_c: float = Field(default=816.4, description="paper (15)")
    operating_power_kw: PositiveFloat = Field(default=43.6, description="paper (15)")
    thermal_gain_c_per_kw: PositiveFloat = Field(default=18.1, description="paper (16)")
    copper_lag_s: PositiveFloat = Field(default=30.5, description="paper (16)")
    tool_lag_s: PositiveFloat = Field(default=1.2, description="paper (16)")
    dead_time_s: Annotated[float, Range(0.1, 10.0, "s")] = Field(
        default=2.8, description="paper (16)"
    )
    depth_gain_mm_per_kn_s: PositiveFloat = Field(default=0.0016, description="paper (17)")
    depth_zero_s: PositiveFloat = Field(default=29.6, description="paper (17)")
    depth_pole_slow_s: PositiveFloat = Field(default=14.7, description="paper (17)")
    depth_pole_fast_s: Annotated[float, Range(1e-6, 5e-3, "s")] = Field(
        default=0.00095, description="paper (17)"
    )
    motor_lag_s: Annotated[float, Range(0.01, 10.0, "s")] = Field(
        default=0.27, description="paper (18)"
    )
    sticking_stress_pa: NonNegativeFloat = Field(default=152800.0, description="paper (19)")
    sliding_friction: NonNegativeFloat = Field(default=0.435, description="paper (19)")
    contact_radius_m: PositiveFloat = Field(default=0.015, description="paper (21), (22)")
    contact_slope: PositiveFloat = Field(default=20.0 / 3.0, description="paper (21), (22): 20/3")
    geometry_offset_m3: float = Field(default=2.3e-5, description="paper (22)")
    geometry_factor: PositiveFloat = Field(default=2.408, description="paper (22)")
    friction_constant_nm: float = Field(default=243.11, description="paper (8), (23)")
    friction_linear_nm_per_rpm: float = Field(default=-1.305, description="paper (8), (23)")
    friction_quadratic_nm_per_rpm2: float = Field(default=0.001927, description="paper (8), (23)")
    softening_per_c: NonNegativeFloat = Field(default=0.0021, description="paper (6), (27)")
    spindle_inertia_kgm2: NonNegativeFloat = Field(
        default=2.0, description="chosen: size of the torque peak in Fig. 5"
    )

    @model_validator(mode="after")
    def _check_poles(self) -> ModelParameters:
        if self.depth_pole_slow_s <= self.depth_pole_fast_s:
            raise problem("must be larger than depth_pole_fast_s", "depth_pole_slow_s")
        return self

    def scaled(self, **factors: float) -> ModelParameters:
        """Return a copy with some values multiplied, e.g. ``scaled(thermal_gain_c_per_kw=1.2)``.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a name is unknown or a value is not valid.
        """
        return self.changed(
            **{name: getattr(self, name, nan) * factor for name, factor in factors.items()}
        )


@cache
def nominal() -> ModelParameters:
    """The nominal parameters: those of the paper, and the chosen ones."""
    return ModelParameters()


class ParameterCovariance(Parameters):
    """Covariance of the relative errors of identified parameters."""

    what = "covariance"
    example = "parameters: [dead_time_s], covariance: [[0.0001]]"

    parameters: list[str] = Field(default=[], description="names of the identified parameters")
    covariance: list[list[float]] = Field(
        default=[], description="of their relative errors, row by row"
    )

    @model_validator(mode="after")
    def _check(self) -> ParameterCovariance:
        n = len(self.parameters)
        if unknown := [
            name for name in self.parameters if name not in ModelParameters.model_fields
        ]:
            raise problem(f"the model has no {', '.join(unknown)}", "parameters")
        if len(self.covariance) != n or any(len(row) != n for row in self.covariance):
            raise problem(
                f"must have {n} rows of {n} numbers, as there are parameters", "covariance"
            )
        matrix = self.matrix
        if n and not (np.allclose(matrix, matrix.T) and np.linalg.eigvalsh(matrix).min() > 0.0):
            raise problem("is no covariance: not symmetric and positive", "covariance")
        return self

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The covariance, shape (n, n)."""
        return np.array(self.covariance, dtype=np.float64).reshape(len(self.parameters), -1)

    @property
    def text(self) -> str:
        """YAML that :meth:`from_file` reads."""
        rows = "".join(
            f"  - [{', '.join(f'{float(value):.9e}' for value in row)}]\n"
            for row in self.covariance
        )
        names = ", ".join(self.parameters)
        title = "# Covariance of the relative errors of identified parameters."
        return f"{title}\nparameters: [{names}]\ncovariance:\n{rows}"


_NOISE = "standard deviation, resolution included"


class MachineData(Parameters):
    """Sensors and drives as identified from welds (``fsw.py identify``); None: not identified."""

    what = "machine data"
    example = "temperature_noise_c: 0.3"

    depth_noise_mm: NonNegativeFloat | None = Field(default=None, description=_NOISE)
    torque_noise_nm: NonNegativeFloat | None = Field(default=None, description=_NOISE)
    temperature_noise_c: NonNegativeFloat | None = Field(default=None, description=_NOISE)
    force_rate_kn_per_s: PositiveFloat | None = Field(
        default=None, description="of the drive of the axial force"
    )
    speed_rate_rpm_per_s: PositiveFloat | None = Field(
        default=None, description="of the drive of the spindle"
    )

    @property
    def text(self) -> str:
        """YAML that :meth:`from_file` reads."""
        seen = {name: value for name, value in self if value is not None}
        lines = [f"{name}: {float(f'{value:.4g}')!r}\n" for name, value in seen.items()]
        unseen = ", ".join(sorted(set(type(self).model_fields) - set(seen)))
        remark = f"# Not shown by the data: {unseen}\n" if unseen else ""
        return (
            "# Sensors and drives of a machine, by 'fsw.py identify'.\n" + "".join(lines) + remark
        )
