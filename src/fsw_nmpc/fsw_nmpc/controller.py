"""The nonlinear model predictive controller: estimator, corridors, solver, acceptance and fallback."""

from __future__ import annotations

from dataclasses import replace
from math import floor, isfinite
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Diagnosis, Limits, Measurement, Proposal, Reference
from fsw_model import STEP_S, ModelParameters, nominal
from fsw_nmpc.acceptance import MovePlan
from fsw_nmpc.corridor import Corridor
from fsw_nmpc.estimator import Estimator, EstimatorTuning
from fsw_nmpc.ocp import Problem, Solution, Solver, Weights
from fsw_nmpc.tuning import Tuning

Vector = NDArray[np.float64]
#: a gap in the ticks that is too long to be predicted over: the estimator starts anew
_LONGEST_GAP_S = 3.0
_NOTHING = (float("nan"),) * 3


class NmpcController:
    """NMPC of depth and temperature, a :class:`fsw_control.Controller`.

    Parameters
    ----------
    solver : Solver
        Its horizon and model are used.
    parameters : ModelParameters, optional
        The model of the estimator; the same as the solver's.
    tuning : Tuning, optional
    limits : Limits, optional
    estimator_tuning : EstimatorTuning, optional
    plan_reuse : int
        How many ticks a failed solve is bridged by the rest of the last accepted plan.

    Attributes
    ----------
    bad_cycles : int
        Ticks without an accepted solution so far.
    """

    name = "nmpc"
    tolerated_sensors: tuple[str, ...] = ("depth", "torque", "thermocouple")

    def __init__(
        self,
        solver: Solver,
        parameters: ModelParameters | None = None,
        tuning: Tuning | None = None,
        limits: Limits | None = None,
        estimator_tuning: EstimatorTuning | None = None,
        plan_reuse: int = 5,
    ) -> None:
        self.solver = solver
        self.parameters = parameters or nominal()
        self.limits = limits or Limits()
        self.plan_reuse = plan_reuse
        self.estimator = Estimator(self.parameters, estimator_tuning)
        self._depth: Corridor | None = None
        self._temperature: Corridor | None = None
        self.bad_cycles = 0
        self.configure(tuning or Tuning())
        self._plan = MovePlan(solver.horizon)
        self.reset(Command(self.parameters.operating_force_kn, self._operating_speed_rpm()))

    def _operating_speed_rpm(self) -> float:
        return 0.5 * (self.limits.speed_min_rpm + self.limits.speed_max_rpm)

    def configure(self, tuning: Tuning) -> None:
        """Change the tuning at runtime, without a bump: estimator and filtered set-points go on."""
        time_s = self.solver.horizon.time_s
        kind = tuning.corridor
        depth = Corridor(time_s, tuning.corridor_depth_s, tuning.dead_band_depth_mm, kind, tuning.depth_shape)
        temperature = Corridor(
            time_s, tuning.corridor_temperature_s, tuning.dead_band_temperature_c, kind, tuning.temperature_shape
        )
        if self._depth is not None and self._temperature is not None:
            depth.follow(self._depth)
            temperature.follow(self._temperature)
        self.tuning, self._depth, self._temperature = tuning, depth, temperature
        self._weights = Weights.from_tuning(tuning, self.solver.horizon, self.limits)

    def replace_solver(self, solver: Solver) -> None:
        """Go on with another solver, whose horizon may have other blocks; the plan is carried over."""
        self.solver = solver
        self._plan = self._plan.on(solver.horizon)
        self.configure(self.tuning)

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self.estimator.is_started = False
        self._plan.clear()
        self._bad_in_a_row = 0
        self._late_s = 0.0
        self._applied = applied
        self._reference: Reference | None = None
        self._proposed: Command | None = None
        self._restart_corridors()

    def _restart_corridors(self) -> None:
        """Let the corridors begin at the outputs."""
        assert self._depth is not None and self._temperature is not None
        self._depth.start_at(None)
        self._temperature.start_at(None)

    def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
        """See :meth:`fsw_control.Controller.step`."""
        began = perf_counter()
        if isfinite(applied.force_kn) and isfinite(applied.speed_rpm):
            self._applied = applied
        applied = self._applied
        if isfinite(reference.depth_mm) and isfinite(reference.temperature_c):
            self._reference = reference
        if not self._estimate(measurement, applied, dt_s):
            return Proposal(applied, False, f"waiting for valid sensors: {_needed(measurement)}")
        if self._reference is None:
            return Proposal(applied, False, f"no usable reference: {reference}")
        if self._proposed is not None and _differ(applied, self._proposed):
            # someone else is in command: when this controller takes over it begins where the outputs are
            self._restart_corridors()
        problem = self._problem(self._reference, applied, dt_s)
        solution = self.solver.solve(problem, self._plan.moves)
        refusal = self._plan.refusal(solution, problem)
        if refusal and self._plan.moves.any():
            # the start may have been the cause: a failed solve must not poison the next
            cold = self.solver.solve(problem, np.zeros_like(self._plan.moves))
            solution = replace(cold, iterations=solution.iterations + cold.iterations)
            refusal = self._plan.refusal(solution, problem)
        return self._propose(solution, refusal, applied, began)

    def _estimate(self, measurement: Measurement, applied: Command, dt_s: float) -> bool:
        """Bring the estimator to this tick; False while there is nothing to start from."""
        self._late_s += dt_s if 0.0 <= dt_s < _LONGEST_GAP_S else _LONGEST_GAP_S
        ticks = floor(self._late_s / STEP_S + 0.5)
        self._late_s -= ticks * STEP_S
        if self.estimator.is_started and ticks * STEP_S < _LONGEST_GAP_S:
            nothing = Measurement(measurement.time_s, *_NOTHING, False, False, False)
            for missed in range(ticks - 1, -1, -1):
                if not self.estimator.step(nothing if missed else measurement, applied):
                    break
            if self.estimator.is_started:
                return True
            self._plan.clear()
        self._restart_corridors()
        self._late_s = 0.0
        return self.estimator.start(measurement, applied)

    def _problem(self, reference: Reference, applied: Command, dt_s: float) -> Problem:
        assert self._depth is not None and self._temperature is not None
        elapsed_s = dt_s if 0.0 <= dt_s < _LONGEST_GAP_S else STEP_S
        estimator = self.estimator
        return Problem(
            estimator.estimate(),
            applied,
            self.limits,
            *self._depth.bands(reference.depth_mm, estimator.depth_mm, elapsed_s, estimator.depth_offset_mm),
            *self._temperature.bands(
                reference.temperature_c, estimator.temperature_c, elapsed_s, estimator.temperature_offset_c
            ),
            self._weights,
        )

    def _propose(self, solution: Solution, refusal: str, applied: Command, began: float) -> Proposal:
        healthy, reason = True, ""
        if not refusal:
            self._bad_in_a_row = 0
            move = self._plan.accept(solution)
        else:
            self._bad_in_a_row += 1
            self.bad_cycles += 1
            move = self._plan.follow()
            reason = f"solver: {refusal}; following the last plan ({self._bad_in_a_row} of {self.plan_reuse})"
            healthy = self._bad_in_a_row <= self.plan_reuse
        blind = self.estimator.blind_sensors
        if blind:
            healthy, reason = False, f"no valid {', '.join(blind)} for {self.estimator.tuning.blind_limit_s:g} s"
        command = self.limits.clip(Command(applied.force_kn + move[0], applied.speed_rpm + move[1]), applied)
        self._proposed = command
        plan = self._plan.seen_from(applied)
        self._plan.shift()
        diagnosis = Diagnosis(
            depth_estimate_mm=self.estimator.depth_mm,
            temperature_estimate_c=self.estimator.temperature_c,
            disturbances=self.estimator.disturbances(),
            solver_status=refusal or f"{self.solver.name}: {solution.status}",
            iterations=solution.iterations,
            solve_time_s=perf_counter() - began,
            active_limits=self.limits.active(command, applied),
            bad_cycles=self.bad_cycles,
            plan=plan,
        )
        return Proposal(command, healthy, reason, diagnosis)


def _differ(one: Command, other: Command) -> bool:
    """Whether two commands are more apart than by rounding."""
    return abs(one.force_kn - other.force_kn) > 1e-6 or abs(one.speed_rpm - other.speed_rpm) > 1e-6


def _needed(measurement: Measurement) -> str:
    invalid = [name for name in measurement.invalid_sensors() if name != "torque"]
    return ", ".join(invalid) or "depth and temperature are no weld's"
