"""The nonlinear model predictive controller: a thin binding of the C library."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np

from fsw_control import Command, Diagnosis, Measurement, Plan, Proposal, Reference, weld
from fsw_control.heat_plan import HeatPlan
from fsw_control.parameters import defaults, problem
from fsw_control.reason import Reason, ReasonCode
from fsw_nmpc.covariance import Rejoining, output_deviations
from fsw_nmpc.horizon import horizon_of
from fsw_nmpc.library import KERNEL, Library, Missing, SolveStatus, tuning_of
from fsw_nmpc.library import Reason as Fault
from fsw_nmpc.parameters import NmpcParameters
from fsw_nmpc.tuning import Settings

#: disturbance estimates in the library's order; depth and temperature are sensor offsets
_DISTURBANCES = (
    "force_kn",
    "power_kw",
    "torque_scale",
    "depth_mm",
    "temperature_c",
    "depth_rate_mm_per_s",
    "temperature_rate_c_per_s",
    "depth_gain",
)
#: their standard deviations
_DEVIATIONS = (
    "force_deviation_kn",
    "power_deviation_kw",
    "torque_scale_deviation",
    "depth_deviation_mm",
    "temperature_deviation_c",
    "depth_rate_deviation_mm_per_s",
    "temperature_rate_deviation_c_per_s",
    "depth_gain_deviation",
)
#: relative difference up to which two thermal models are the same: as written in files
_SAME_MODEL = 1e-3
_SENSORS = {Missing.DEPTH: "depth", Missing.TORQUE: "torque", Missing.TEMPERATURE: "thermocouple"}
_STATUS_TEXTS = {
    SolveStatus.OK: "solved",
    SolveStatus.ITERATION_CAP: "iteration cap",
    SolveStatus.NOT_FINITE: "not finite",
    SolveStatus.TOO_FAST: "solution moves faster than the limits",
    SolveStatus.OUTSIDE_BOUNDS: "solution leaves the bounds",
    SolveStatus.NOT_SOLVED: "nothing to solve",
}


class NmpcController:
    """NMPC of depth and temperature, a :class:`fsw_control.Controller`.

    Estimator, reference trajectories, problem, solver, acceptance, fallback and limits are a C
    library (``kernel/``); this class only passes data. Every parameter except the model can be
    changed at runtime, bumplessly. A new horizon is built in the background while the present one
    stays in use; if that fails, the proposals report why, and the next change of any parameter
    tries again.

    Parameters
    ----------
    values : mapping of str to Any, optional
        Parameters as described by :class:`NmpcParameters`; missing ones have their default.

    Raises
    ------
    ValueError
        If the values cannot be used or the library cannot be built.
    """

    name = "nmpc"
    parameters, variant = NmpcParameters, "preset"
    tolerated_sensors: tuple[str, ...] = ("depth", "torque", "thermocouple")

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        self._log: Callable[[str], object] = lambda _: None
        self._complain = self._log
        self._values = defaults(self.parameters) | dict(values or {})
        self.settings = Settings.of(self._values)
        self._maker: threading.Thread | None = None
        self._made: tuple[Settings, Library | str] | None = None
        self._failure = ""
        self._use(self.settings, _make(self.settings))
        self.reset(Command(weld.FORCE_KN, weld.SPEED_RPM))

    def use_logger(self, logger: Any) -> None:
        """Log which solver is in use (``info``) and a horizon that cannot be built (``error``)."""
        self._log, self._complain = logger.info, logger.error
        self._say_solver()

    def check(self, values: Mapping[str, Any]) -> str | None:
        """Return why these parameters cannot be used, or None."""
        return problem(Settings.of, self._values | dict(values))

    def configure(self, values: Mapping[str, Any]) -> None:
        """Apply new parameters at runtime; the proposals do not jump.

        Raises
        ------
        ValueError
            If the values cannot be used.
        """
        merged = self._values | dict(values)
        new = Settings.of(merged)
        self._values, self.settings = merged, new
        self.library.configure(tuning_of(new))
        self._prepare()

    def _use(self, settings: Settings, library: Library) -> None:
        self.library, self._blocks = library, settings.tuning.blocks
        self._time_s = tuple(library.horizon.time_s.tolist())
        lengths_s = library.horizon.step_length_s
        self._middle_s = tuple((np.cumsum(lengths_s) - 0.5 * lengths_s).tolist())
        self._has_heat = False
        self._say_solver()

    def _say_solver(self) -> None:
        self._log(f"solver: rti, {self._blocks} blocks, library {KERNEL.source_id()}")

    def _prepare(self) -> None:
        """Build the horizon of the settings in the background, unless it is in use."""
        if self._maker is not None:
            return
        self._failure = ""
        if self.settings.tuning.blocks != self._blocks:
            self._maker = threading.Thread(
                target=self._make, args=(self.settings,), name="nmpc horizon", daemon=True
            )
            self._maker.start()

    def _make(self, settings: Settings) -> None:
        try:
            self._made = settings, _make(settings)
        except Exception as error:
            self._made = settings, " ".join(f"{error or type(error).__name__}".split())

    def finish_changes(self, timeout_s: float = 60.0) -> None:
        """Wait until the horizon made in the background is in use; TimeoutError if it is late."""
        while (maker := self._maker) is not None:
            maker.join(timeout_s)
            if maker.is_alive():
                raise TimeoutError(f"the horizon is not ready after {timeout_s:g} s")
            self._take()

    def _take(self) -> None:
        """Switch to the horizon built in the background if it is ready, else note the failure."""
        if self._made is None:
            return
        made_for, made = self._made
        self._maker = self._made = None
        if made_for.tuning.blocks != self.settings.tuning.blocks:
            self._prepare()
        elif isinstance(made, str):
            self._failure = f"that of {self._blocks} blocks stays in use: {made}"
            self._complain(Reason(ReasonCode.HORIZON, detail=self._failure).words)
        else:
            made.configure(tuning_of(self.settings))
            made.go_on_from(self.library)
            self._use(self.settings, made)

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self._rejoining: Rejoining | None = None
        self.library.reset(applied.force_kn, applied.speed_rpm)

    def rejoin(self) -> None:
        """The next step is in mid-weld: nothing is proposed until the heat is known."""
        at_rest = self.settings.tuning.estimator.start_deviation
        self._rejoining = Rejoining(self.settings.model.dead_time_s, at_rest)

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        """See :meth:`fsw_control.Controller.step`."""
        began = perf_counter()
        self._take()
        library, m = self.library, measurement
        inputs, outputs = library.input, library.output
        library.take(m, reference, applied, dt_s)
        inputs.depth_fresh = m.depth_valid and "depth" not in m.held
        inputs.torque_fresh = m.torque_valid and "torque" not in m.held
        inputs.temperature_fresh = m.temperature_valid and "thermocouple" not in m.held
        inputs.force_kn, inputs.speed_rpm = m.force_kn, m.speed_rpm
        coming = reference.coming if self.settings.preview else ()
        inputs.n_changes = min(len(coming), len(inputs.change))
        for change, set_point in zip(inputs.change, coming, strict=False):
            change.at_s, change.depth_mm, change.temperature_c = (
                set_point.at_s - m.time_s,
                set_point.depth_mm,
                set_point.temperature_c,
            )
        self._take_heat(reference.heat, m.time_s)
        library.step()
        if self._rejoining is not None and self._rejoining.follow(library, dt_s):
            self._rejoining = None
        command = Command(outputs.force_kn, outputs.speed_rpm)
        reason = self._reason(m)
        if outputs.reason in (Fault.WAITING_FOR_SENSORS, Fault.WAITING_FOR_REFERENCE):
            return Proposal(command, False, reason)
        diagnosis = Diagnosis(
            depth_estimate_mm=outputs.depth_mm,
            temperature_estimate_c=outputs.temperature_c,
            torque_estimate_nm=outputs.torque_nm,
            disturbances={
                "attainable_depth_mm": outputs.attainable[0],
                "attainable_temperature_c": outputs.attainable[1],
                "copper_temperature_c": outputs.copper_c,
                **(
                    {"known_heat_share": self.library.state.estimator.known_weight}
                    if self._has_heat
                    else {}
                ),
                **dict(zip(_DISTURBANCES, outputs.disturbance, strict=True)),
                **dict(zip(_DEVIATIONS, outputs.deviation, strict=True)),
            },
            solver_status=f"rti: {_STATUS_TEXTS[outputs.solve_status]}",
            iterations=outputs.iterations,
            solve_time_s=perf_counter() - began,
            active_limits=self.settings.limits.active(command, applied),
            bad_cycles=outputs.bad_cycles,
            plan=self._plan() if outputs.has_plan else None,
        )
        if self._rejoining is not None and outputs.healthy:
            return Proposal(command, False, Reason(ReasonCode.REJOINING), diagnosis)
        return Proposal(command, bool(outputs.healthy), reason, diagnosis)

    def _take_heat(self, heat: HeatPlan | None, now_s: float) -> None:
        """Pass the changes of the known heat: over the last tick, and along the horizon."""
        inputs, n = self.library.input, len(self._middle_s)
        if heat is None or not self.settings.preview or not self._is_of_model(heat):
            if self._has_heat:
                inputs.known_rise_kw = inputs.known_deviation_kw = 0.0
                inputs.known_ahead_kw[0:n] = [0.0] * n
            self._has_heat = False
            return
        self._has_heat = True
        last = (now_s - 1.5 * weld.TICK_S, now_s - 0.5 * weld.TICK_S)
        before_kw, now_kw = map(heat.heat, last)
        inputs.known_rise_kw = now_kw - before_kw
        inputs.known_deviation_kw = heat.deviation(*last)
        inputs.known_ahead_kw[0:n] = [heat.heat(now_s + in_s) - now_kw for in_s in self._middle_s]

    def _is_of_model(self, heat: HeatPlan) -> bool:
        """Whether the heat was found with this controller's thermal model."""
        own = self.settings.model
        return bool(heat.model) and all(
            name in type(own).model_fields
            and abs(getattr(own, name) - value) <= _SAME_MODEL * abs(value)
            for name, value in heat.model.items()
        )

    def _reason(self, m: Measurement) -> Reason:
        outputs, s = self.library.output, self.settings
        if outputs.reason == Fault.PROPOSING:
            return Reason(ReasonCode.HORIZON, detail=self._failure) if self._failure else Reason()
        if outputs.reason == Fault.WAITING_FOR_SENSORS:
            missing = tuple(name for name in m.invalid_sensors() if name != "torque")
            return (
                Reason(ReasonCode.WAITING_FOR_SENSORS, missing)
                if missing
                else Reason(ReasonCode.NOT_WELDING)
            )
        if outputs.reason == Fault.WAITING_FOR_REFERENCE:
            return Reason(ReasonCode.NO_REFERENCE)
        if outputs.reason == Fault.BLIND:
            blind = tuple(name for bit, name in _SENSORS.items() if outputs.blind & bit)
            return Reason(ReasonCode.BLIND, blind, s.blind_limit_s)
        if outputs.reason == Fault.OUT_OF_BOUNDS:
            return Reason(ReasonCode.OUT_OF_BOUNDS)
        status = _STATUS_TEXTS[outputs.solve_status]
        again = f"following the last plan ({outputs.bad_in_a_row} of {s.plan_reuse})"
        return Reason(ReasonCode.SOLVER, detail=f"{status}; {again}")

    def plan_deviations(self, time_s: Sequence[float]) -> tuple[list[float], list[float]]:
        """Standard deviations of depth [mm] and temperature [degC] along the last plan.

        As the sensors will show them. Not part of the plan, as this takes as long as a step.
        """
        depth, temperature = output_deviations(self.library.state, np.array(time_s))
        return depth.tolist(), temperature.tolist()

    def _plan(self) -> Plan:
        outputs, n = self.library.output, len(self._time_s)
        return Plan(
            time_s=self._time_s,
            depth_mm=tuple(outputs.plan_depth_mm[0:n]),
            temperature_c=tuple(outputs.plan_temperature_c[0:n]),
            force_kn=tuple(outputs.plan_force_kn[0:n]),
            speed_rpm=tuple(outputs.plan_speed_rpm[0:n]),
        )


def _make(settings: Settings) -> Library:
    """The library for the settings."""
    try:
        return Library(
            settings.model, horizon_of(settings.model, settings.tuning.blocks), tuning_of(settings)
        )
    except (RuntimeError, OSError) as error:
        raise ValueError(f"nmpc: {error}") from None
