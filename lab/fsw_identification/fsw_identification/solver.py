"""Levenberg-Marquardt steps of the estimate of :mod:`fsw_identification.estimation`.

SciPy's solvers do not apply: noise and random walks are estimated again before each step, so the
objective changes from step to step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.evidence import likely_walk, take_likely_colour
from fsw_identification.problem import Problem
from fsw_identification.simulation import TEMPERATURE, added
from fsw_model import STEP_S, ModelParameters

#: smallest and largest lag of the thermocouple [s]
_LAG_LIMITS_S = (0.05, 10.0)
_LARGEST_MOVE = 0.3
_WALK_SETTLED = 0.3
#: a relative change of the noise's correlation that counts as settled
_COLOUR_SETTLED = 0.1
_LEAST, _ITERATIONS = 3, 30
_MOST_DAMPED = 1e4
#: converged when the next move is below this many standard deviations, all parameters together
_CONVERGED = 0.05


def solve(
    problem: Problem,
    progress: Callable[[], None],
    iterations: int = _ITERATIONS,
    reject: bool = False,
) -> None:
    """Levenberg-Marquardt iterations; outliers count less, or with ``reject`` not at all."""
    damping = 1e-3
    for segment, weights in zip(problem.segments, problem.weights, strict=True):
        weights *= np.isfinite(segment.measured)
    if not problem.fixed_walk:  # the slow disturbance of the temperature may be of the sensor
        for part in problem.parts[TEMPERATURE::3]:
            doubtful = added(part.response, part.walk, part.at_knots)
            problem.known[part.segment] = problem.known[part.segment]._replace(doubtful_c=doubtful)
    for iteration in range(iterations):
        progress()
        problem.settle()
        problem.estimate_noise(reject)
        # Variable projection (Golub and Pereyra 1973): initial states, walks and shifts are linear
        # and eliminated exactly, so the iteration moves the nonlinear parameters alone.
        before, problem.parts, _ = problem.profile(problem.parameters)
        parts, settled = problem.linearised(problem.parameters, True), True
        if problem.coloured:
            earlier = problem.autocorrelation.copy()
            take_likely_colour(problem, parts)
            settled &= bool(
                (
                    np.abs(problem.autocorrelation - earlier) < _COLOUR_SETTLED * (1.0 - earlier)
                ).all()
            )
        if not problem.fixed_walk:
            earlier, problem.walk = problem.walk, likely_walk(problem, parts)
            settled &= bool((np.abs(np.log(problem.walk / earlier)) < _WALK_SETTLED).all())
        # The cost before the move counts with the new noise and walks, else the comparison with
        # the cost after it would reward their change.
        if problem.coloured or not problem.fixed_walk:
            before, problem.parts, _ = problem.profile(problem.parameters)
        damping, size = _descend(problem, problem.eliminate(parts, True)[0], before, damping)
        if damping > _MOST_DAMPED or (iteration >= _LEAST and settled and size < _CONVERGED):
            break
    problem.settle()


def _descend(
    problem: Problem, border: FloatArray, before: float, damping: float
) -> tuple[float, float]:
    """Move without raising the cost; returns the next damping (too large: none) and the size."""
    n, information = len(problem.free), border[1:, 1:]
    moving = [*range(n), *([len(information) - 1] if problem.lagged else [])]
    while n and damping <= _MOST_DAMPED:
        by = _move(border, moving, damping)
        moved, lag_s = _moved(problem.parameters, problem.free, by[:n]), problem.lag_s
        if problem.lagged:
            lag_s = float(np.clip(lag_s + by[-1], *_LAG_LIMITS_S))
        # Judged by the profile cost: knots and shifts are optimal for the moved parameters.
        after, parts, _ = problem.variant(lag_s=lag_s).profile(moved)
        if np.isfinite(after) and after <= before + 1e-6:
            problem.parameters, problem.parts, problem.lag_s = moved, parts, lag_s
            return max(damping / 10.0, 1e-9), float(
                np.sqrt(by @ information[np.ix_(moving, moving)] @ by)
            )
        damping = max(10.0 * damping, 1e-4)
    return damping, 0.0


def _move(border: FloatArray, moving: Sequence[int], damping: float) -> FloatArray:
    """The move, damped and bounded."""
    # Marquardt's scaling: the damping is relative to the diagonal, so units do not matter. Shifts
    # and share are linear and solved with the parameters, undamped.
    extra = np.zeros(len(border) - 1)
    extra[moving] = damping * np.diag(border)[1:][moving]
    by = np.asarray(
        np.linalg.solve(border[1:, 1:] + np.diag(extra), border[1:, 0])[moving], dtype=np.float64
    )
    return by * min(1.0, _LARGEST_MOVE / max(float(np.abs(by).max()), 1e-12))


def _moved(p: ModelParameters, free: Sequence[str], by: FloatArray) -> ModelParameters:
    """Parameters after a change of their logarithms."""
    moved = {name: getattr(p, name) * float(np.exp(d)) for name, d in zip(free, by, strict=True)}
    for name, low, high in (("dead_time_s", STEP_S, 10.0), ("motor_lag_s", 0.02, 10.0)):
        if name in moved:
            moved[name] = min(max(moved[name], low), high)
    return p.changed(**moved)
