"""The nonlinear model predictive controller: estimator, corridors, solver, acceptance and fallback."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Diagnosis, Limits, Measurement, Plan, Proposal, Reference
from fsw_model import ModelParameters, nominal
from fsw_nmpc.corridor import Corridor
from fsw_nmpc.estimator import Estimator, EstimatorTuning
from fsw_nmpc.ocp import Problem, Solution, Solver, Weights
from fsw_nmpc.tuning import Tuning

Vector = NDArray[np.float64]


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
    """

    name = "nmpc"
    tolerated_sensors = ("depth", "torque", "thermocouple")

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
        self._moves = np.zeros(2 * solver.horizon.n_blocks)
        self._bad_in_a_row = 0
        self.bad_cycles = 0
        self.configure(tuning or Tuning())

    def configure(self, tuning: Tuning) -> None:
        """Change the tuning at runtime, without a bump: estimator and filtered set-points go on."""
        horizon = self.solver.horizon
        centres = (self._depth.centre, self._temperature.centre) if hasattr(self, "_depth") else (None, None)
        continuing = tuning.corridor == "continuing"
        self.tuning = tuning
        self._depth = Corridor(horizon.time_s, tuning.corridor_depth_s, tuning.dead_band_depth_mm, continuing)
        self._temperature = Corridor(
            horizon.time_s, tuning.corridor_temperature_s, tuning.dead_band_temperature_c, continuing
        )
        self._depth.start_at(centres[0])
        self._temperature.start_at(centres[1])
        self._weights = Weights.from_tuning(tuning, horizon, self.limits)

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self.estimator.is_started = False
        self._moves[:] = 0.0
        self._bad_in_a_row = 0
        self._depth.start_at(None)
        self._temperature.start_at(None)

    def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
        """See :meth:`fsw_control.Controller.step`."""
        began = perf_counter()
        if self.estimator.is_started:
            self.estimator.step(measurement, applied)
        elif not self.estimator.start(measurement, applied):
            return Proposal(applied, False, f"waiting for valid sensors: {', '.join(measurement.invalid_sensors())}")
        depth, temperature = self.estimator.depth_mm, self.estimator.temperature_c
        depth_band = self._depth.bands(reference.depth_mm, depth, dt_s)
        temperature_band = self._temperature.bands(reference.temperature_c, temperature, dt_s)
        problem = Problem(
            self.estimator.estimate(), applied, self.limits, *depth_band, *temperature_band, self._weights
        )
        solution = self.solver.solve(problem, self._shifted(self._moves))
        if not self._acceptable(solution):
            # a failed solve must not poison the next: start cold
            cold = self.solver.solve(problem, np.zeros_like(self._moves))
            solution = replace(cold, iterations=solution.iterations + cold.iterations)
        return self._propose(solution, problem, applied, perf_counter() - began)

    def _acceptable(self, solution: Solution) -> bool:
        return solution.solved and bool(np.isfinite(solution.moves).all() and np.isfinite(solution.depth_mm).all())

    def _propose(self, solution: Solution, problem: Problem, applied: Command, solve_time_s: float) -> Proposal:
        healthy, reason = True, ""
        if self._acceptable(solution):
            self._moves = solution.moves
            self._bad_in_a_row = 0
        else:
            self._moves = self._shifted(self._moves)
            self._bad_in_a_row += 1
            self.bad_cycles += 1
            reason = f"solver: {solution.status}; following the last plan ({self._bad_in_a_row} of {self.plan_reuse})"
            healthy = self._bad_in_a_row <= self.plan_reuse
        blind = self.estimator.blind_sensors
        if blind:
            healthy, reason = False, f"no valid {', '.join(blind)} for {self.estimator.tuning.blind_limit_s} s"
        wanted = Command(applied.force_kn + float(self._moves[0]), applied.speed_rpm + float(self._moves[1]))
        command = self.limits.clip(wanted, applied)
        diagnosis = Diagnosis(
            depth_estimate_mm=self.estimator.depth_mm,
            temperature_estimate_c=self.estimator.temperature_c,
            disturbances=self.estimator.disturbances(),
            solver_status=solution.status,
            iterations=solution.iterations,
            solve_time_s=solve_time_s,
            active_limits=self.limits.active(command, applied),
            bad_cycles=self.bad_cycles,
            plan=self._plan(solution, applied),
        )
        return Proposal(command, healthy, reason, diagnosis)

    def _interval_moves(self, moves: Vector) -> Vector:
        return moves.reshape(-1, 2)[self.solver.horizon.interval_block]

    def _shifted(self, moves: Vector) -> Vector:
        """The same plan seen one tick later, on the blocks again."""
        horizon = self.solver.horizon
        later = np.vstack([self._interval_moves(moves)[1:], np.zeros((1, 2))])
        sums = np.zeros((horizon.n_blocks, 2))
        np.add.at(sums, horizon.interval_block, later)
        return np.asarray((sums / horizon.block_sizes[:, None]).ravel())

    def _plan(self, solution: Solution, applied: Command) -> Plan:
        inputs = np.cumsum(self._interval_moves(self._moves), axis=0)
        return Plan(
            time_s=tuple(self.solver.horizon.time_s.tolist()),
            depth_mm=tuple(solution.depth_mm.tolist()),
            temperature_c=tuple(solution.temperature_c.tolist()),
            force_kn=tuple((applied.force_kn + inputs[:, 0]).tolist()),
            speed_rpm=tuple((applied.speed_rpm + inputs[:, 1]).tolist()),
        )
