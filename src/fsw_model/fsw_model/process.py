"""The numeric process: step, outputs, equilibrium, linearisation and open-loop simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw_control.schema.errors import InputError
from fsw_control.schema.extensions import Extra
from fsw_model import equations
from fsw_model.equations import STEP_S
from fsw_model.parameters import ModelParameters, nominal

Power = tuple[float, ...]

_CASADI = Extra("fsw-control", "science", ("casadi",))


class OperatingPointError(InputError):
    """No equilibrium at the desired depth and temperature, or the shoulder has left the copper."""


class OutsideModelError(OperatingPointError):
    """A step would leave the model's range: shoulder out of the copper, or input not finite."""

    def __init__(self, depth_mm: float, force_kn: float, speed_rpm: float) -> None:
        super().__init__(
            f"process model: depth {depth_mm:.4g} mm with {force_kn:.4g} kN, {speed_rpm:.4g} rpm; "
            "the model is valid for finite inputs while the shoulder is in the copper, above 0 mm"
        )
        self.depth_mm, self.force_kn, self.speed_rpm = depth_mm, force_kn, speed_rpm


@dataclass(slots=True)
class ProcessState:
    """State of the process: the six states, and the power within the dead time."""

    x: tuple[float, ...]  #: in the order of ``equations.STATE_NAMES``
    #: power deviation (24) during each step of the last dead time, oldest first, see
    #: ``equations.N_POWER``
    power: deque[Power]

    def copy(self) -> ProcessState:
        """Independent copy."""
        return ProcessState(self.x, deque(self.power))


class Outputs(NamedTuple):
    """Outputs of the process under given inputs, without noise."""

    depth_mm: float
    temperature_c: float
    copper_temperature_c: float
    motor_torque_nm: float
    process_torque_nm: float
    friction_torque_nm: float
    power_kw: float


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Inputs, outputs and state of a steady state (depth integrates, so any depth is one)."""

    force_kn: float
    speed_rpm: float
    outputs: Outputs
    state: ProcessState


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Process linearised about an equilibrium, as deviations.

    ``dx/dt = a x + b u + b_power p(t - dead_time_s)``, ``p = c_power x + d_power u``, ``y = c x``
    with u = (force kN, speed rpm), p = power kW, y = (depth mm, temperature degC, motor torque N
    m).
    """

    a: NDArray[np.float64]  #: (6, 6)
    b: NDArray[np.float64]  #: (6, 2)
    b_power: NDArray[np.float64]  #: (6,)
    c_power: NDArray[np.float64]  #: (6,)
    d_power: NDArray[np.float64]  #: (2,)
    c: NDArray[np.float64]  #: (3, 6)
    dead_time_s: float

    def frequency_response(self, omega_rad_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Transfer matrix at n frequencies above 0, with the thermal-depth loop closed.

        Returns
        -------
        (n, 3, 2) complex array
            From (force kN, speed rpm) to (depth mm, temperature degC, motor torque N m).
        """
        omega = np.asarray(omega_rad_s)[:, None, None]
        delay = np.exp(-1j * omega * self.dead_time_s)
        closed_a = self.a + delay * np.outer(self.b_power, self.c_power)
        closed_b = self.b + delay * np.outer(self.b_power, self.d_power)
        return np.asarray(
            self.c @ np.linalg.solve(1j * omega * np.eye(len(self.a)) - closed_a, closed_b)
        )


class ProcessModel:
    """The friction stir welding process, stepped at 10 Hz with inputs held between ticks.

    Its parameters are the paper's by default. Steps and linearisations are by CasADi, of the extra
    ``science``; without it they raise ``fsw_control.schema.extensions.MissingExtraError``.
    """

    def __init__(self, parameters: ModelParameters | None = None) -> None:
        self.parameters = p = parameters or nominal()
        self.delay_steps = equations.delay_steps(p)

    @cached_property
    def step_function(self) -> Any:
        """A step as a CasADi function, see :func:`fsw_model.functions.step_function`."""
        return _functions().step_function(self.parameters)

    @cached_property
    def output_function(self) -> Any:
        """The outputs as a CasADi function, see :func:`fsw_model.functions.output_function`."""
        return _functions().output_function(self.parameters)

    def step(self, state: ProcessState, force_kn: float, speed_rpm: float) -> None:
        """Advance ``state`` in place by one step with the inputs held.

        Raises
        ------
        OutsideModelError
            If the shoulder would leave the copper (depth (27) not above 0) or an input is not
            finite; the state is then unchanged.
        """
        power = state.power
        x, sent_kw, (depth_mm,) = (
            part.full().ravel().tolist()
            for part in self.step_function(
                state.x, power[0], power[1 if self.delay_steps > 1 else 0], force_kn, speed_rpm
            )
        )
        if not (depth_mm > 0.0 and isfinite(sent_kw[0])):  # written so that NaN fails too
            raise OutsideModelError(depth_mm, force_kn, speed_rpm)
        state.x = tuple(x)
        power.popleft()
        power.append(tuple(sent_kw))

    def outputs(self, state: ProcessState, force_kn: float, speed_rpm: float) -> Outputs:
        """Outputs in a state under given inputs."""
        return self._outputs(state.x, force_kn, speed_rpm)

    def _outputs(self, x: Sequence[float], force_kn: float, speed_rpm: float) -> Outputs:
        return Outputs(**equations.outputs(self.parameters, x, force_kn, speed_rpm))

    def equilibrium(
        self, depth_mm: float | None = None, temperature_c: float | None = None
    ) -> Equilibrium:
        """Inputs and state that hold a depth and a temperature (default: the operating point).

        Depth integrates, so the force is the operating force at every depth; the speed gives the
        needed power.

        Raises
        ------
        OperatingPointError
            If the shoulder is not in the copper or the temperature needs no positive power.
        """
        p = self.parameters
        depth = p.operating_depth_mm if depth_mm is None else depth_mm
        temperature = p.operating_temperature_c if temperature_c is None else temperature_c
        if not (depth > 0.0 and isfinite(depth)):
            raise OperatingPointError(
                f"no equilibrium at depth {depth:.4g} mm: must be above 0 mm"
            )
        rise_c = temperature - p.operating_temperature_c
        power_kw = p.operating_power_kw + rise_c / p.thermal_gain_c_per_kw
        softening = 1.0 + p.softening_per_c * rise_c
        if not (power_kw > 0.0 and softening > 0.0 and isfinite(temperature)):
            raise OperatingPointError(
                f"no equilibrium at {temperature:.4g} degC: needs {power_kw:.4g} kW and "
                f"a correction factor (27) of {softening:.4g}; both must be positive"
            )
        force = p.operating_force_kn
        settled = (depth / softening - p.operating_depth_mm, 0.0, 0.0, rise_c, rise_c)
        torque = self._outputs((*settled, 0.0), force, 0.0).process_torque_nm
        speed = power_kw * 30000.0 / (pi * torque)
        friction = self._outputs((*settled, 0.0), force, speed).friction_torque_nm
        arriving: Power = (power_kw - p.operating_power_kw, 0.0, 0.0, 0.0)
        state = ProcessState((*settled, torque + friction), deque([arriving] * self.delay_steps))
        return Equilibrium(force, speed, self.outputs(state, force, speed), state)

    def linearise(self, equilibrium: Equilibrium | None = None) -> Linearisation:
        """Continuous-time linearisation about an equilibrium (the operating point by default)."""
        at = equilibrium or self.equilibrium()
        slopes = _functions().slopes_function(self.parameters)
        a, b, b_power, c_power, d_power, c = (
            m.full() for m in slopes(at.state.x, at.state.power[0][0], [at.force_kn, at.speed_rpm])
        )
        return Linearisation(
            a, b, b_power.ravel(), c_power.ravel(), d_power.ravel(), c, self.parameters.dead_time_s
        )

    def simulate(
        self,
        force_kn: Sequence[float],
        speed_rpm: Sequence[float],
        start: Equilibrium | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Open-loop simulation from an equilibrium.

        Parameters
        ----------
        force_kn, speed_rpm : sequences of n floats
            Inputs of each step.
        start : Equilibrium, optional
            Of a model with the same dead time; the operating point by default.

        Returns
        -------
        dict of (n,) arrays
            ``time_s``, the fields of :class:`Outputs`, ``force_kn`` and ``speed_rpm``. Row k is at
            the beginning of step k, with the inputs of that step.

        Raises
        ------
        ValueError
            If the sequences differ in length, or ``start`` is of a model with another dead time.
        OperatingPointError
            If the shoulder leaves the copper.
        """
        if len(force_kn) != len(speed_rpm):
            raise ValueError(
                f"simulate: {len(force_kn)} forces but {len(speed_rpm)} speeds; "
                "give as many of each"
            )
        state = (start or self.equilibrium()).state.copy()
        if len(state.power) != self.delay_steps:
            raise ValueError(
                f"simulate: start has {len(state.power)} steps of dead time, "
                f"model {self.delay_steps}"
            )
        rows = []
        for force, speed in zip(force_kn, speed_rpm, strict=True):
            rows.append(self._outputs(state.x, force, speed))
            self.step(state, force, speed)
        names = Outputs._fields
        columns = dict(zip(names, np.array(rows).reshape(-1, len(names)).T, strict=True))
        columns["force_kn"], columns["speed_rpm"] = (
            np.array(force_kn, float),
            np.array(speed_rpm, float),
        )
        return {"time_s": np.arange(len(rows)) * STEP_S, **columns}


def _functions() -> Any:
    return _CASADI.module("fsw_model.functions", "the process as CasADi functions")
