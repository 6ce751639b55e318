"""Normal equations and Levenberg-Marquardt steps of the estimate of :mod:`fsw_identification.estimation`.

No solver of SciPy does this: noise and size of the random walks are estimated again before each step, so that what is
minimised changes from step to step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.special import huber

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_identification.simulation import CANDIDATES, START, hats, knots, simulate
from fsw_identification.weld_data import Segment
from fsw_model import STEP_S, ModelParameters

#: prior standard deviation of the logarithm of a parameter: practically none
_PRIOR_LOG = 2.0
#: prior standard deviations of ``START``
_START_PRIOR = np.array([1.0, 0.3, 20.0, 20.0, 500.0, 20.0])
#: prior standard deviations of shifts of ``OUTPUTS``, and of ``HEAT``
_SHIFT_PRIOR = np.array([1.0, 100.0, 500.0, 100.0])
#: slow disturbances: of force [kN] and power [kW], which act on the process, and of what is shown of the outputs
WALKS = ("force [kN]", "power [kW]", "depth [mm]", "temperature [°C]", "torque [N·m]")
#: prior standard deviations of the disturbances at the beginning; a constant one of an output is not identifiable
_OFFSET_PRIOR = np.array([10.0, 20.0, 1e-4, 1e-3, 1e-2])
#: standard deviations of a disturbance's change within KNOT_S: smallest, at the start, largest
WALK = np.array([[1e-3, 1e-3, 2e-5, 1e-3, 1e-2], [0.01, 0.01, 2e-4, 0.01, 0.1], [3.0, 5.0, 0.1, 5.0, 50.0]])
#: at the beginning of a segment depth and temperature are not used for so long: dead time and tool
_SETTLING_TICKS = 40
#: smallest noise that is assumed, so that noise-free data do not get infinite weight
NOISE_FLOOR = np.array([1e-4, 5e-3, 0.1])
#: residuals beyond this many standard deviations are left out, at the end
OUTLIER = 5.0
_HUBER = 3.0
#: the output whose disturbance acts on the process, and the part of that which is not measured
_TORQUE, HEAT = 2, 3
_LARGEST_MOVE = 0.3
#: largest factor on the size of a random walk in one iteration
_WALK_STEP = 4.0
_WALK_SETTLED = 0.3
_LEAST, _ITERATIONS = 3, 30
_MOST_DAMPED = 1e4
#: converged when the next move is below this many standard deviations, all unknowns together
_CONVERGED = 0.05


@dataclass(frozen=True, slots=True)
class Shift:
    """A sudden change of an output that the model does not explain, which stays."""

    #: where, ``output`` in the order of ``OUTPUTS``; ``HEAT``: of the heat of a shift of the torque, beyond what the
    #: torque by itself would give (all of it, less, when the sensor is wrong)
    segment: int
    output: int
    tick: int  #: first row of the segment that is shifted


class Evaluation(NamedTuple):
    """Predictions (n, 3), residuals (n, 3) and their slopes (n, 3, columns of the segment), by segment."""

    predicted: list[FloatArray]
    residuals: list[FloatArray]
    slopes: list[FloatArray]


class Problem:
    """Normal equations of one linearisation after the other; all segments of all welds at once.

    Columns of the unknowns: logarithms of the free parameters; per segment ``START`` and the knots of each of
    ``WALKS``; sizes of the shifts.

    Parameters
    ----------
    segments : sequence of Segment
    start : ModelParameters
    free : sequence of str
        Names of the parameters to estimate.

    Attributes
    ----------
    noise : (3,) array
        Standard deviation of each output's residuals.
    walk : (5,) array
        Standard deviation of the change within ``KNOT_S`` of each of ``WALKS``.
    fixed_walk : bool
        Whether ``walk`` stays as it is.
    reject : bool
        Whether outliers are left out, instead of counting less (Huber).
    shifts : list of Shift
    values : array
        Of all columns but those of the parameters.
    last : Evaluation
        At the last solution.
    """

    def __init__(self, segments: Sequence[Segment], start: ModelParameters, free: Sequence[str]) -> None:
        self.parameters, self.free = start, tuple(free)
        self.noise, self.walk = np.array([0.01, 1.0, 10.0]), WALK[1].copy()
        self.shifts: list[Shift] = []
        self.reject, self.fixed_walk = False, True
        starts = [_initial(segment, start) for segment in segments]
        self.values = np.concatenate(starts)
        self._bounds = list(pairwise(np.cumsum([0, *(one.size for one in starts)]).tolist()))
        self.segments = [_settled(segment) for segment in segments]
        self.last = Evaluation([], [], [])

    @property
    def sizes(self) -> FloatArray:
        """Sizes of the shifts."""
        return self.values[self._bounds[-1][1] :]

    def set_shifts(self, shifts: Sequence[Shift], sizes: FloatArray) -> None:
        """Replace all shifts."""
        self.shifts = list(shifts)
        self.values = np.concatenate([self.values[: self._bounds[-1][1]], sizes])

    def evaluate(self) -> Evaluation:
        """Simulate all segments with the present values."""
        found = [self._evaluate(i, segment) for i, segment in enumerate(self.segments)]
        return Evaluation(*map(list, zip(*found, strict=True)))

    def _evaluate(self, i: int, segment: Segment) -> tuple[FloatArray, FloatArray, FloatArray]:
        nuisance, weights = self.values[slice(*self._bounds[i])], hats(segment.n_ticks)
        k, n = weights.shape[1], len(self.free)
        n_process = len(START) + 2 * k
        own = [j for j, shift in enumerate(self.shifts) if shift.segment == i]
        sizes, outputs = self.sizes[own], np.array([self.shifts[j].output for j in own], dtype=int)
        ticks = np.array([self.shifts[j].tick for j in own], dtype=int)
        steps = (np.arange(segment.n_ticks)[:, None] >= ticks).astype(float)
        heats = outputs >= _TORQUE  # a shift of the torque heats as well
        course = simulate(
            self.parameters, segment, nuisance[:n_process], steps[:, heats], sizes[heats], outputs[heats] == _TORQUE
        )
        slopes = np.zeros((segment.n_ticks, 3, n + nuisance.size + len(own)))
        scale = np.array([getattr(self.parameters, name) for name in self.free])
        slopes[:, :, :n] = course.by_candidate[:, :, [CANDIDATES.index(name) for name in self.free]] * scale
        slopes[:, :, n : n + n_process] = course.by_nuisance[:, :, :n_process]
        by_shift = slopes[:, :, n + nuisance.size :]
        by_shift[:, :, heats] = course.by_nuisance[:, :, n_process:]
        shown = course.outputs + weights @ nuisance[n_process:].reshape(3, k).T
        for output in range(3):
            begin = n + n_process + output * k
            slopes[:, output, begin : begin + k] = weights
        for column in np.flatnonzero(~heats):
            shown[:, outputs[column]] += steps[:, column] * sizes[column]
            by_shift[:, outputs[column], column] = steps[:, column]
        return shown, segment.measured - shown, slopes

    @property
    def columns(self) -> int:
        """Number of unknowns."""
        return len(self.free) + self.values.size

    def _columns_of(self, segment: int) -> IntArray:
        """Columns that a segment depends on."""
        n, end = len(self.free), self._bounds[-1][1]
        own = [n + end + j for j, shift in enumerate(self.shifts) if shift.segment == segment]
        begin, end = self._bounds[segment]
        return np.array([*range(n), *range(n + begin, n + end), *own])

    def walk_columns(self, segment: int) -> IntArray:
        """Columns of the knots of ``WALKS`` in a segment, (5, knots)."""
        begin, end = self._bounds[segment]
        columns: IntArray = len(self.free) + np.arange(begin + len(START), end).reshape(len(WALKS), -1)
        return columns

    def weights(self, residuals: FloatArray) -> FloatArray:
        """Weights of residuals in standard deviations; 0 where there is no sample."""
        size = np.abs(np.nan_to_num(residuals, nan=np.inf))
        if self.reject:
            return np.asarray(size < OUTLIER, dtype=float)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.minimum(1.0, _HUBER / np.maximum(size, 1e-9)))

    def cost(self, residuals: Sequence[FloatArray]) -> float:
        """Of the data at the present noise, Huber's or that of least squares with rejection, and of the prior."""
        state = self.state()
        total = float(state @ self.prior() @ state)
        for one in residuals:
            size = np.abs((one / self.noise)[np.isfinite(one)])
            total += float((np.minimum(size, OUTLIER) ** 2 if self.reject else 2.0 * huber(_HUBER, size)).sum())
        return total

    def state(self) -> FloatArray:
        """Value of each column, as the prior counts it: the parameters' are 0."""
        return np.concatenate([np.zeros(len(self.free)), self.values])

    def prior(self) -> FloatArray:
        """Prior information of the columns; the walk's increments couple neighbouring knots."""
        blocks = [_PRIOR_LOG**-2 * np.eye(len(self.free))]
        for segment in self.segments:
            blocks.append(np.diag(_START_PRIOR**-2))
            differences = np.diff(np.eye(knots(segment.n_ticks)), axis=0)
            for walk, offset in zip(self.walk, _OFFSET_PRIOR, strict=True):
                block = differences.T @ differences / walk**2
                block[0, 0] += offset**-2
                blocks.append(block)
        blocks.append(np.diag(_SHIFT_PRIOR[[shift.output for shift in self.shifts]] ** -2))
        return np.asarray(block_diag(*blocks))

    def normal(self, at: Evaluation) -> tuple[FloatArray, FloatArray]:
        """Information of the data and its gradient."""
        information, gradient = np.zeros((self.columns, self.columns)), np.zeros(self.columns)
        for i, (residuals, slopes) in enumerate(zip(at.residuals, at.slopes, strict=True)):
            own = self._columns_of(i)
            scaled = residuals / self.noise
            root = np.sqrt(self.weights(scaled))
            j = (slopes / self.noise[:, None] * root[:, :, None]).reshape(-1, own.size)
            information[np.ix_(own, own)] += j.T @ j
            gradient[own] += j.T @ (np.nan_to_num(scaled) * root).ravel()
        return information, gradient

    def information(self, at: Evaluation) -> FloatArray:
        """Information of data and prior."""
        return self.normal(at)[0] + self.prior()

    def likely_walk(self, information: FloatArray, gradient: FloatArray) -> FloatArray:
        """Sizes of the random walks, one step of MacKay's iteration towards the largest evidence."""
        covariance = np.linalg.inv(information + self.prior())
        mean = covariance @ (gradient + information @ self.state())
        squares, freedom = np.zeros(len(WALKS)), np.zeros(len(WALKS))
        for i in range(len(self.segments)):
            for which, at in enumerate(self.walk_columns(i)):
                spread = covariance[np.ix_(at, at)]
                variances = np.diag(spread)[1:] + np.diag(spread)[:-1] - 2.0 * np.diag(spread, 1)
                squares[which] += float((np.diff(mean[at]) ** 2).sum())
                freedom[which] += at.size - 1 - float(variances.sum()) / self.walk[which] ** 2
        wanted = np.sqrt(squares / np.maximum(freedom, 1e-3))
        wanted = np.clip(wanted, self.walk / _WALK_STEP, self.walk * _WALK_STEP)
        return np.asarray(np.clip(wanted, WALK[0], WALK[2]))

    def evidence(self) -> float:
        """Minus twice the logarithm of the evidence at the last solution, but for a constant.

        Other than the cost it can be compared between solutions with walks of other sizes.
        """
        increments = sum(knots(segment.n_ticks) - 1 for segment in self.segments)
        samples = np.isfinite(np.concatenate(self.last.residuals)).sum(axis=0)
        walks = 2.0 * increments * float(np.log(self.walk).sum())
        found = self.cost(self.last.residuals) + 2.0 * float(samples @ np.log(self.noise)) + walks
        return found + float(np.linalg.slogdet(self.information(self.last))[1])

    def move(self, by: FloatArray) -> None:
        """Change all unknowns."""
        n = len(self.free)
        moved = {
            name: getattr(self.parameters, name) * float(np.exp(d)) for name, d in zip(self.free, by[:n], strict=True)
        }
        for name, low, high in (("dead_time_s", STEP_S, 10.0), ("motor_lag_s", 0.02, 10.0)):
            if name in moved:
                moved[name] = min(max(moved[name], low), high)
        self.parameters, self.values = self.parameters.changed(**moved), self.values + by[n:]

    def estimate_noise(self, residuals: Sequence[FloatArray]) -> None:
        """Noise of each output from its residuals, without outliers."""
        for i, column in enumerate(np.concatenate(residuals).T):
            values = column[np.isfinite(column)]
            spread = max(float(np.median(np.abs(values))) / 0.6745, NOISE_FLOOR[i])
            good = values[np.abs(values) < OUTLIER * spread]
            self.noise[i] = max(float(np.sqrt(np.mean(good**2))) if good.size else spread, NOISE_FLOOR[i])

    def solve(self, progress: Callable[[], None], iterations: int = _ITERATIONS) -> None:
        """Levenberg-Marquardt from the present values."""
        damping, self.last = 1e-3, self.evaluate()
        for iteration in range(iterations):
            progress()
            self.estimate_noise(self.last.residuals)
            information, gradient = self.normal(self.last)
            settled = True
            if not self.fixed_walk:
                earlier, self.walk = self.walk, self.likely_walk(information, gradient)
                settled = bool((np.abs(np.log(self.walk / earlier)) < _WALK_SETTLED).all())
            prior = self.prior()
            whole, pull = information + prior, gradient - prior @ self.state()
            damping, by = self._descend(whole, pull, damping)
            if damping > _MOST_DAMPED:
                break
            if iteration >= _LEAST and settled and float(by @ whole @ by) < _CONVERGED**2:
                break

    def _descend(self, whole: FloatArray, pull: FloatArray, damping: float) -> tuple[float, FloatArray]:
        """Move so that the cost does not rise; the next damping, more than ``_MOST_DAMPED`` if no move does, and it."""
        before, kept = self.cost(self.last.residuals), (self.parameters, self.values)
        while True:
            by = np.linalg.solve(whole + damping * np.diag(np.diag(whole)), pull)
            largest = np.abs(by[: len(self.free)]).max(initial=0.0)
            by = by * min(1.0, _LARGEST_MOVE / max(largest, 1e-12))
            self.move(by)
            found = self.evaluate()
            after = self.cost(found.residuals)
            if np.isfinite(after) and after <= before + 1e-6:
                self.last = found
                return max(damping / 10.0, 1e-9), by
            self.parameters, self.values = kept
            damping = max(10.0 * damping, 1e-4)
            if damping > _MOST_DAMPED:
                return damping, by


def _settled(segment: Segment) -> Segment:
    """Without the first outputs that depend on power from before the segment, which is taken for constant."""
    measured = segment.measured.copy()
    measured[:_SETTLING_TICKS, :2] = np.nan
    return replace(segment, measured=measured)


def _initial(segment: Segment, p: ModelParameters) -> FloatArray:
    """Nuisance to start from: an equilibrium at the first second of the data."""
    shown = [p.operating_depth_mm, p.operating_temperature_c, 1e3]
    for i, column in enumerate(segment.measured.T):
        first = column[:10][np.isfinite(column[:10])]
        known = first if first.size else column[np.isfinite(column)]
        if known.size:
            shown[i] = float(np.median(known))
    depth, temperature, torque = shown
    rise = temperature - p.operating_temperature_c
    power = rise / p.thermal_gain_c_per_kw
    creep = depth / (1.0 + p.softening_per_c * rise) - p.operating_depth_mm
    return np.concatenate([[creep, 0.0, power, power, torque, power], np.zeros(len(WALKS) * knots(segment.n_ticks))])
