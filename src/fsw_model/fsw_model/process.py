"""The numeric process: step, outputs, equilibrium, linearisation and open-loop simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model import equations
from fsw_model.codegen import python_function
from fsw_model.parameters import ModelParameters, ParameterError, nominal

STEP_S = 0.1


class OperatingPointError(ValueError):
    """No equilibrium at the wanted depth and temperature, or the tool has left the model's range."""


@dataclass(slots=True)
class ProcessState:
    """State of the process: the linear blocks and the power on its way through the dead time.

    Attributes
    ----------
    x : tuple of 5 float
        In the order of ``equations.STATE_NAMES``.
    power_kw : deque of (float, float, float)
        Power at start, middle and end of each step of the last dead time, oldest first.
    """

    x: tuple[float, ...]
    power_kw: deque[tuple[float, float, float]]

    def copy(self) -> ProcessState:
        """Independent copy."""
        return ProcessState(self.x, deque(self.power_kw))


@dataclass(frozen=True, slots=True)
class Outputs:
    """What the process shows under given inputs (no noise, spindle not accelerating)."""

    depth_mm: float
    temperature_c: float
    process_torque_nm: float
    friction_torque_nm: float
    power_kw: float

    @property
    def motor_torque_nm(self) -> float:
        """Torque of the spindle motor at constant speed: process torque plus bearing friction (8)."""
        return self.process_torque_nm + self.friction_torque_nm


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Inputs, outputs and state at which nothing changes."""

    force_kn: float
    speed_rpm: float
    outputs: Outputs
    state: ProcessState


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Process linearised about an equilibrium, as deviations.

    ``dx/dt = a x + b_input u + b_power p(t - dead_time_s)``, ``p = c_power x + d_power u``,
    ``y = c x + d u`` with u = (force kN, speed rpm), p = power kW, y = (depth mm, temperature degC, motor torque N m).

    Attributes
    ----------
    a : (5, 5), b_input : (5, 2), b_power : (5,), c_power : (5,), d_power : (2,), c : (3, 5), d : (3, 2) arrays
    dead_time_s : float
    """

    a: NDArray[np.float64]
    b_input: NDArray[np.float64]
    b_power: NDArray[np.float64]
    c_power: NDArray[np.float64]
    d_power: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]
    dead_time_s: float

    def frequency_response(self, omega_rad_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Transfer matrix at the given frequencies, the thermal-depth loop closed.

        Parameters
        ----------
        omega_rad_s : (n,) array
            Frequencies; 0 is not allowed, because depth integrates.

        Returns
        -------
        (n, 3, 2) complex array
            From (force kN, speed rpm) to (depth mm, temperature degC, motor torque N m).
        """
        response = np.empty((len(omega_rad_s), 3, 2), dtype=np.complex128)
        for k, omega in enumerate(omega_rad_s):
            delay = np.exp(-1j * omega * self.dead_time_s)
            closed_a = self.a + delay * np.outer(self.b_power, self.c_power)
            closed_b = self.b_input + delay * np.outer(self.b_power, self.d_power)
            response[k] = self.c @ np.linalg.solve(1j * omega * np.eye(len(self.a)) - closed_a, closed_b) + self.d
        return response


def delay_steps(parameters: ModelParameters, step_s: float = STEP_S) -> int:
    """Dead time in steps.

    Raises
    ------
    ParameterError
        If it is not a whole number (>= 1) of steps.
    """
    delay = parameters.dead_time_s / step_s
    if round(delay) < 1 or abs(delay - round(delay)) > 1e-9:
        raise ParameterError(
            f"model parameter 'dead_time_s' = {parameters.dead_time_s:g}: must be a whole number of {step_s:g} s steps"
        )
    return round(delay)


class ProcessModel:
    """Friction stir welding process, stepped at 10 Hz with inputs held between ticks.

    Parameters
    ----------
    parameters : ModelParameters, optional
        Nominal ones by default.
    step_s : float, optional
        Length of a step; the dead time must be a whole number of steps.

    Raises
    ------
    ParameterError
        If the dead time is not a whole number (>= 1) of steps.
    """

    def __init__(self, parameters: ModelParameters | None = None, step_s: float = STEP_S) -> None:
        self.parameters = parameters or nominal()
        self.step_s = step_s
        self.delay_steps = delay_steps(self.parameters, step_s)
        self.step_function: ca.Function = equations.step_function(self.parameters, step_s)
        self.output_function: ca.Function = equations.output_function(self.parameters)
        self._step = python_function(self.step_function)
        self._outputs = python_function(self.output_function)
        self._least_deviation_mm = self.parameters.shallowest_depth_mm - self.parameters.operating_depth_mm

    def step(self, state: ProcessState, force_kn: float, speed_rpm: float) -> None:
        """Advance ``state`` in place by one step with the inputs held.

        Raises
        ------
        OperatingPointError
            If the shoulder has left the copper (the contact area (19) is zero or negative) or an input is not finite.
        """
        history = state.power_kw
        delayed = history[0]
        x = state.x
        # Written so that NaN fails too. Below, the pressure would change its sign: numbers, but no physics.
        if not x[0] + x[1] + x[2] + x[3] > self._least_deviation_mm:
            raise self._out_of_range(state, force_kn, speed_rpm)
        try:
            result = self._step(*x, *delayed, force_kn, speed_rpm)
        except (ValueError, ZeroDivisionError):
            raise self._out_of_range(state, force_kn, speed_rpm) from None
        if not isfinite(result[7]):
            raise self._out_of_range(state, force_kn, speed_rpm)
        state.x = result[:5]
        history.popleft()
        history.append(result[5:])  # type: ignore[arg-type]

    def outputs(self, state: ProcessState, force_kn: float, speed_rpm: float) -> Outputs:
        """Outputs in a state under given inputs.

        Raises
        ------
        OperatingPointError
            As :meth:`step`.
        """
        x = state.x
        if not x[0] + x[1] + x[2] + x[3] > self._least_deviation_mm:
            raise self._out_of_range(state, force_kn, speed_rpm)
        try:
            return Outputs(*self._outputs(*x, force_kn, speed_rpm))
        except (ValueError, ZeroDivisionError):
            raise self._out_of_range(state, force_kn, speed_rpm) from None

    def _out_of_range(self, state: ProcessState, force_kn: float, speed_rpm: float) -> OperatingPointError:
        depth = self.parameters.operating_depth_mm + sum(state.x[:4])
        return OperatingPointError(
            f"process model: no contact torque at depth {depth:.3f} mm with {force_kn} kN, {speed_rpm} rpm; "
            f"the model holds for finite inputs and depths above {self.parameters.shallowest_depth_mm:.3f} mm"
        )

    def equilibrium(self, depth_mm: float | None = None, temperature_c: float | None = None) -> Equilibrium:
        """Inputs and state that hold a depth and a temperature for ever.

        Depth integrates, so the force is the operating force at every depth; the speed gives the needed power.

        Parameters
        ----------
        depth_mm, temperature_c : float, optional
            The operating point by default.

        Raises
        ------
        OperatingPointError
            If the shoulder does not touch at this depth or the temperature needs no positive power.
        """
        p = self.parameters
        depth = p.operating_depth_mm if depth_mm is None else depth_mm
        temperature = p.operating_temperature_c if temperature_c is None else temperature_c
        if not depth > p.shallowest_depth_mm or not isfinite(depth):
            raise OperatingPointError(
                f"no equilibrium at depth {depth} mm: must be above {p.shallowest_depth_mm:.3f} mm"
            )
        if not temperature > p.ambient_temperature_c or not isfinite(temperature):
            raise OperatingPointError(
                f"no equilibrium at {temperature} degC: must be above the ambient {p.ambient_temperature_c} degC"
            )
        thermal_mm = p.softening_gain_mm_per_c * (temperature - p.operating_temperature_c)
        x = (depth - p.operating_depth_mm - thermal_mm, 0.0, 0.0, thermal_mm, temperature)
        power = (temperature - p.ambient_temperature_c) / p.thermal_gain_c_per_kw
        force = p.operating_force_kn
        state = ProcessState(x, deque([(power, power, power)] * self.delay_steps))
        torque = self.outputs(state, force, 0.0).process_torque_nm
        speed = power * 1e3 / (torque * equations.RAD_PER_S_PER_RPM)
        return Equilibrium(force, speed, self.outputs(state, force, speed), state)

    def linearise(self, equilibrium: Equilibrium | None = None) -> Linearisation:
        """Continuous-time linearisation about an equilibrium (the operating point by default)."""
        at = equilibrium or self.equilibrium()
        a, b_force, b_power, _ = equations.linear_blocks(self.parameters)
        x, force, speed = ca.SX.sym("x", equations.N_STATES), ca.SX.sym("force"), ca.SX.sym("speed")
        depth, temperature, torque, friction, power = self.output_function(x, force, speed)
        y = ca.vertcat(depth, temperature, torque + friction, power)
        jacobian = ca.Function("j", [x, force, speed], [ca.jacobian(y, x), ca.jacobian(y, ca.vertcat(force, speed))])
        by_x, by_u = (np.array(m) for m in jacobian(ca.DM(at.state.x), at.force_kn, at.speed_rpm))
        return Linearisation(
            a=a,
            b_input=np.column_stack([b_force, np.zeros(equations.N_STATES)]),
            b_power=b_power,
            c_power=by_x[3],
            d_power=by_u[3],
            c=by_x[:3],
            d=by_u[:3],
            dead_time_s=self.parameters.dead_time_s,
        )

    def simulate(
        self, force_kn: Sequence[float], speed_rpm: Sequence[float], start: Equilibrium | None = None
    ) -> dict[str, NDArray[np.float64]]:
        """Open-loop simulation from an equilibrium.

        Parameters
        ----------
        force_kn, speed_rpm : sequences of n floats
            Inputs of each step.
        start : Equilibrium, optional
            The operating point by default.

        Returns
        -------
        dict of (n + 1,) arrays
            ``time_s`` and the fields of :class:`Outputs` at the ticks. Torque and power at a tick belong to the inputs
            of the step that ends there (at the first tick: of the equilibrium), as a sensor sees them.

        Raises
        ------
        ValueError
            If the sequences differ in length, or ``start`` is of a model with another dead time.
        OperatingPointError
            If the tool leaves the model's range.
        """
        if len(force_kn) != len(speed_rpm):
            raise ValueError(f"simulate: {len(force_kn)} forces but {len(speed_rpm)} speeds; give as many of each")
        at = start or self.equilibrium()
        state = at.state.copy()
        if len(state.power_kw) != self.delay_steps:
            raise ValueError(f"simulate: start has {len(state.power_kw)} steps of dead time, model {self.delay_steps}")
        rows = [at.outputs]
        for force, speed in zip(force_kn, speed_rpm, strict=True):
            self.step(state, force, speed)
            rows.append(self.outputs(state, force, speed))
        columns = {name: np.array([getattr(row, name) for row in rows]) for name in Outputs.__dataclass_fields__}
        columns["motor_torque_nm"] = columns["process_torque_nm"] + columns["friction_torque_nm"]
        columns["time_s"] = np.arange(len(rows)) * self.step_s
        return columns
