"""The process model for Python: its equations, linearisations and forms for other tools."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fsw.arguments import validated
from fsw.welds import needed
from fsw_control.schema.models import InputError
from fsw_model import STEP_S, Equilibrium, ModelParameters, ProcessModel, equations, nominal

if TYPE_CHECKING:
    import casadi as ca

Vector = NDArray[np.float64]


INPUTS = ("force_kn", "speed_rpm")
OUTPUTS = ("depth_mm", "temperature_c", "motor_torque_nm")


class Model:
    """The process of the paper, equations (16)-(27), with some parameters.

    Parameters
    ----------
    parameters : ModelParameters

    Attributes
    ----------
    parameters : ModelParameters
    process : ProcessModel
        Numeric process; its ``step_function`` and ``output_function`` are CasADi functions of a
        tick.

    Examples
    --------
    >>> import fsw
    >>> at = fsw.model().process.equilibrium(2.66, 816.4)
    >>> round(at.force_kn, 1), round(at.speed_rpm, 3)
    (78.4, 407.576)
    """

    @validated
    def __init__(self, parameters: ModelParameters) -> None:
        self.parameters = parameters
        self.process = ProcessModel(parameters)

    @validated
    def equation(self, number: int) -> ca.Function:
        """An equation of the paper as a CasADi function; its argument names include the units.

        (16), (17), (18) are derivatives with respect to time, (16) without its dead time; (19)
        holds (20)-(22).

        Raises
        ------
        fsw_control.schema.models.InputError
            For a number that is none of these: 8, 16-19, 23, 24, 26, 27.

        Examples
        --------
        >>> import fsw
        >>> torque = fsw.model().equation(19)
        >>> round(float(torque(78.4, 2.66)))
        1022
        """
        function = self._equations.get(number)
        if function is None:
            raise InputError(
                f"equation {number}: there are {', '.join(map(str, self._equations))}"
            )
        return function

    @cached_property
    def _equations(self) -> dict[int, ca.Function]:
        ca, p = needed("casadi"), self.parameters
        force, speed, depth, torque, motor = map(ca.SX.sym, ("F", "w", "z", "M", "tau"))
        modes, lags, arriving = ca.SX.sym("l", 3), ca.SX.sym("T", 2), ca.SX.sym("P")
        (a, b), (poles, gains) = equations.thermal_block(p), equations.depth_modes(p)
        friction = _function(
            "friction", {"speed_rpm": speed}, "torque_nm", equations.friction_torque_nm(p, speed)
        )
        thermal = ca.DM(a) @ lags + ca.DM(b) * arriving
        moved = ca.DM(poles) * modes + ca.DM(gains) * (force - p.operating_force_kn)
        depth_of = equations.depth_mm(p, modes[0], modes[1], modes[2], lags[1])
        lag = (torque - motor) / p.motor_lag_s
        of_tool = equations.process_torque_nm(p, force, depth)
        power = equations.power_kw(torque, speed)
        return {
            8: friction,
            16: _function(
                "thermal", {"copper_tool_c": lags, "power_kw": arriving}, "c_per_s", thermal
            ),
            17: _function(
                "depth_modes", {"modes_mm": modes, "force_kn": force}, "mm_per_s", moved
            ),
            18: _function(
                "motor", {"torque_nm": torque, "motor_torque_nm": motor}, "nm_per_s", lag
            ),
            19: _function(
                "process_torque", {"force_kn": force, "depth_mm": depth}, "torque_nm", of_tool
            ),
            23: friction,
            24: _function("power", {"torque_nm": torque, "speed_rpm": speed}, "power_kw", power),
            26: _function(
                "temperature",
                {"copper_tool_c": lags},
                "temperature_c",
                p.operating_temperature_c + lags[1],
            ),
            27: _function(
                "depth", {"modes_mm": modes, "copper_tool_c": lags}, "depth_mm", depth_of
            ),
        }

    @cached_property
    def discrete(self) -> ca.Function:
        """A tick of 0.1 s as (x, u) -> (x next, y), exact, with the dead time in the state.

        ``x`` holds the six states of :mod:`fsw_model.equations` and the power of each tick of the
        dead time, four numbers each; ``u`` is (force kN, speed rpm), ``y`` (depth mm, temperature
        degC, motor torque N m) at the start of the tick. Explicit, as required for acados'
        ``disc_dyn_expr``.

        Examples
        --------
        >>> import fsw
        >>> model = fsw.model()
        >>> x = model.state()
        >>> x_next, y = model.discrete(x, [78.4, 407.576])
        >>> x.shape, [round(float(value), 2) for value in y.full().ravel()[:2]]
        ((118,), [2.66, 816.4])
        """
        ca, n, n_power = needed("casadi"), self.process.delay_steps, equations.N_POWER
        x, u = ca.SX.sym("x", equations.N_STATES + n * n_power), ca.SX.sym("u", 2)
        own, power = x[: equations.N_STATES], x[equations.N_STATES :]
        newer = power[n_power : 2 * n_power] if n > 1 else power[:n_power]
        moved, sent, _ = self.process.step_function(own, power[:n_power], newer, u[0], u[1])
        shown = self.process.output_function(own, u[0], u[1])
        after = ca.vertcat(moved, power[n_power:], sent)
        y = ca.vertcat(shown[0], shown[1], shown[3])
        return ca.Function("discrete", [x, u], [after, y], ["x", "u"], ["x_next", "y"])

    def __repr__(self) -> str:
        """What differs from the paper's parameters."""
        own = {
            name: value
            for name, value in self.parameters.model_dump().items()
            if value != getattr(nominal(), name)
        }
        words = " ".join(f"{name}={value:g}" for name, value in own.items())
        return f"<Model {words or 'of the paper'}>"

    @property
    def state_names(self) -> list[str]:
        """Names of the state of :attr:`discrete`.

        The power's four numbers of a tick are ``power_TICK_NUMBER``, the oldest tick first.
        """
        numbers = range(equations.N_POWER)
        power = [f"power_{k}_{i}" for k in range(self.process.delay_steps) for i in numbers]
        return [*equations.STATE_NAMES, *power]

    @validated
    def state(self, at: Equilibrium | None = None) -> Vector:
        """State of :attr:`discrete` at an equilibrium, by default the operating point."""
        state = (at or self.process.equilibrium()).state
        return np.concatenate([state.x, np.ravel(state.power)])

    @validated
    def linearise(
        self,
        depth_mm: float | None = None,
        temperature_c: float | None = None,
        delay: Literal["pade", "exact"] = "pade",
        order: int = 4,
    ) -> Any:
        """Linearise about an equilibrium, as a ``control.StateSpace`` of deviations.

        Raises ImportError without the package ``control``.

        Parameters
        ----------
        depth_mm, temperature_c : float, optional
            By default those of the operating point.
        delay : {"pade", "exact"}
            Continuous, with a Padé approximation of the dead time; or per tick of 0.1 s, with the
            exact dead time.
        order : int
            Of the Padé approximation.

        Returns
        -------
        control.StateSpace
            From (force kN, speed rpm) to (depth mm, temperature degC, motor torque N m).

        Raises
        ------
        fsw_model.OperatingPointError
            If there is no such equilibrium.

        Examples
        --------
        >>> import fsw
        >>> plant = fsw.model().linearise(delay="exact")
        >>> plant.dt, plant.ninputs, plant.noutputs
        (0.1, 2, 3)
        """
        control = needed("control")

        at = self.process.equilibrium(depth_mm, temperature_c)
        names = {"inputs": list(INPUTS), "outputs": list(OUTPUTS), "states": self.state_names}
        if delay == "exact":
            a, b, c, d = self._slopes(self.state(at), [at.force_kn, at.speed_rpm])
            return control.ss(a, b, c, d, STEP_S, **names)
        if order < 1:
            raise InputError(f"linearise: order is at least 1, not {order}")
        a, b, c = self._with_pade(at, order)
        names["states"] = [*equations.STATE_NAMES, *(f"pade_{i}" for i in range(order))]
        return control.ss(a, b, c, np.zeros((3, 2)), **names)

    def _slopes(self, x: Vector, u: Sequence[float]) -> list[Vector]:
        """Matrices A, B, C, D of :attr:`discrete` at a point."""
        ca = needed("casadi")
        states, inputs = ca.SX.sym("x", x.size), ca.SX.sym("u", 2)
        parts = [
            ca.jacobian(of, by) for of in self.discrete(states, inputs) for by in (states, inputs)
        ]
        return [part.full() for part in ca.Function("slopes", [states, inputs], parts)(x, u)]

    def _with_pade(self, at: Equilibrium, order: int) -> tuple[Vector, Vector, Vector]:
        """A, B, C in continuous time; the states of the Padé approximation come last."""
        control = needed("control")
        from scipy.signal import tf2ss

        lin = self.process.linearise(at)
        az, bz, cz, dz = tf2ss(*control.pade(lin.dead_time_s, order))
        # power that arrives, over both states
        arriving = np.concatenate([dz[0, 0] * lin.c_power, cz.ravel()])
        a = np.zeros((len(lin.a) + order,) * 2)
        a[:6, :6], a[6:, 6:], a[6:, :6] = lin.a, az, bz @ lin.c_power[None, :]
        a[:6] += np.outer(lin.b_power, arriving)
        b = np.vstack(
            [lin.b + np.outer(lin.b_power, dz[0, 0] * lin.d_power), bz @ lin.d_power[None, :]]
        )
        return a, b, np.hstack([lin.c, np.zeros((3, order))])

    def to_do_mpc(self) -> Any:
        """Create a discrete ``do_mpc.model.Model`` with 0.1 s per step; needs do-mpc.

        Its state ``x`` is that of :attr:`discrete`, its inputs are ``force_kn`` and ``speed_rpm``,
        and its expressions ``depth_mm``, ``temperature_c`` and ``motor_torque_nm``.

        Examples
        --------
        >>> import fsw
        >>> fsw.model().to_do_mpc().n_x
        118
        """
        ca, made = needed("casadi"), needed("do_mpc.model").Model("discrete", "SX")
        x = made.set_variable("_x", "x", (self.state().size, 1))
        after, y = self.discrete(
            x, ca.vertcat(*(made.set_variable("_u", name) for name in INPUTS))
        )
        for i, name in enumerate(OUTPUTS):
            made.set_expression(name, y[i])
        made.set_rhs("x", after)
        made.setup()
        return made


def _function(name: str, inputs: Mapping[str, ca.SX], result: str, value: ca.SX) -> ca.Function:
    return needed("casadi").Function(name, [*inputs.values()], [value], [*inputs], [result])


@validated
def model(
    source: str | Path | ModelParameters | None = None,
    *,
    factors: Mapping[str, float] | None = None,
    **values: float,
) -> Model:
    """The process model.

    Parameters
    ----------
    source : str, Path or ModelParameters, optional
        Model file, e.g. from :func:`identify`, or parameters; by default the paper's.
    factors : mapping of str to float, optional
        Factors on parameters, e.g. ``{"thermal_gain_c_per_kw": 1.2}``.
    **values : float
        Parameters in the unit of their name, e.g. ``dead_time_s=3.4``.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the file cannot be read or a value is not physical.

    Examples
    --------
    >>> import fsw
    >>> fsw.model(dead_time_s=3.4, factors={"thermal_gain_c_per_kw": 1.2})
    <Model thermal_gain_c_per_kw=21.72 dead_time_s=3.4>
    """
    parameters = ModelParameters() if source is None else source
    if not isinstance(parameters, ModelParameters):
        parameters = ModelParameters.from_file(Path(parameters))
    if factors:
        parameters = parameters.scaled(**{name: float(factor) for name, factor in factors.items()})
    return Model(
        parameters.changed(**{name: float(value) for name, value in values.items()})
        if values
        else parameters
    )
