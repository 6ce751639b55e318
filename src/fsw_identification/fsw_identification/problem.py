"""Normal equations and Levenberg-Marquardt steps of the estimate of :mod:`fsw_identification.estimation`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_identification.simulation import CANDIDATES, START, hats, knots, simulate
from fsw_identification.weld_data import Segment
from fsw_model import STEP_S, ModelParameters

#: prior standard deviation of the logarithm of a parameter: none to speak of
_PRIOR_LOG = 2.0
#: prior standard deviations of ``START``
_START_PRIOR = np.array([1.0, 0.3, 20.0, 20.0, 500.0, 20.0])
#: prior standard deviations of shifts of ``OUTPUTS``, and of ``HEAT``
_SHIFT_PRIOR = np.array([1.0, 100.0, 500.0, 100.0])
#: slow disturbances: of force [kN] and power [kW], which act on the process, and of what is shown of the outputs
WALKS = ("force [kN]", "power [kW]", "depth [mm]", "temperature [°C]", "torque [N·m]")
#: prior standard deviations of the disturbances at the beginning; a constant one of an output cannot be told
_OFFSET_PRIOR = np.array([10.0, 20.0, 1e-4, 1e-3, 1e-2])
#: standard deviations of a disturbance's change within KNOT_S: smallest, at the start, largest
WALK = np.array([[1e-3, 1e-3, 2e-5, 1e-3, 1e-2], [0.01, 0.01, 2e-4, 0.01, 0.1], [3.0, 5.0, 0.1, 5.0, 50.0]])
#: at the beginning of a segment depth and temperature are not used for so long: dead time and tool
_SETTLING_TICKS = 40
#: smallest noise that is reckoned with, so that data without noise do not count for infinitely much
NOISE_FLOOR = np.array([1e-4, 5e-3, 0.1])
#: residuals beyond this many standard deviations are left out, at the end
OUTLIER = 5.0
_HUBER = 3.0
#: the output that disturbs the process when it is disturbed, and the part of that which does not show
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
    """A sudden change of an output that the model does not explain, which stays.

    Attributes
    ----------
    segment, output : int
        Where, ``output`` in the order of ``OUTPUTS``; ``HEAT``: of the heat of a shift of the torque, beyond what the
        torque by itself would give (all of it, less, when the sensor is wrong).
    tick : int
        First row of the segment that is shifted.
    """

    segment: int
    output: int
    tick: int


class Problem:
    """Normal equations of one linearisation after the other; all segments of all welds at once.

    Columns of what is unknown: logarithms of the free parameters; per segment ``START`` and the knots of each of
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
    shifts, sizes : list of Shift, (n,) array
    nuisance : list of (m,) array
        By segment.
    last : tuple
        Predictions, residuals and slopes of the last solution, see :meth:`evaluate`.
    """

    def __init__(self, segments: Sequence[Segment], start: ModelParameters, free: Sequence[str]) -> None:
        self.segments, self.parameters, self.free = list(segments), start, tuple(free)
        self.noise, self.walk = np.array([0.01, 1.0, 10.0]), WALK[1].copy()
        self.shifts: list[Shift] = []
        self.sizes = np.zeros(0)
        self.reject, self.fixed_walk = False, True
        self.nuisance = [_initial(segment, start) for segment in self.segments]
        self.segments = [_settled(segment) for segment in self.segments]
        self.last: tuple[list[FloatArray], list[FloatArray], list[FloatArray]] = ([], [], [])

    def evaluate(self) -> tuple[list[FloatArray], list[FloatArray], list[FloatArray]]:
        """Predictions, residuals, and their derivatives (n, 3, columns of the segment), by segment."""
        chosen = [CANDIDATES.index(name) for name in self.free]
        scale = np.array([getattr(self.parameters, name) for name in self.free])
        predicted, residuals, slopes = [], [], []
        for i, (segment, nuisance) in enumerate(zip(self.segments, self.nuisance, strict=True)):
            weights = hats(segment.n_ticks)
            k = weights.shape[1]
            n_process = len(START) + 2 * k
            own = [j for j, shift in enumerate(self.shifts) if shift.segment == i]
            steps = np.zeros((segment.n_ticks, len(own)))
            for column, j in enumerate(own):
                steps[self.shifts[j].tick :, column] = 1.0
            # a shift of the torque heats as well
            of_torque = [column for column, j in enumerate(own) if self.shifts[j].output >= _TORQUE]
            sizes, shows = self.sizes[own], [self.shifts[own[column]].output == _TORQUE for column in of_torque]
            course = simulate(
                self.parameters, segment, nuisance[:n_process], steps[:, of_torque], sizes[of_torque], shows
            )
            n = len(self.free)
            of = np.zeros((segment.n_ticks, 3, n + nuisance.size + len(own)))
            of[:, :, :n] = course.by_candidate[:, :, chosen] * scale
            of[:, :, n : n + n_process] = course.by_nuisance[:, :, :n_process]
            shown = course.outputs + weights @ nuisance[n_process:].reshape(3, k).T
            for output in range(3):
                begin = n + n_process + output * k
                of[:, output, begin : begin + k] = weights
            for column, j in enumerate(own):
                if column in of_torque:
                    slope = course.by_nuisance[:, :, n_process + of_torque.index(column)]
                    of[:, :, n + nuisance.size + column] = slope
                else:
                    shown[:, self.shifts[j].output] += steps[:, column] * sizes[column]
                    of[:, self.shifts[j].output, n + nuisance.size + column] = steps[:, column]
            predicted.append(shown)
            residuals.append(segment.measured - shown)
            slopes.append(of)
        return predicted, residuals, slopes

    @property
    def columns(self) -> int:
        return len(self.free) + sum(one.size for one in self.nuisance) + len(self.shifts)

    def _columns_of(self, segment: int) -> IntArray:
        """Columns that a segment depends on."""
        begin = len(self.free) + sum(one.size for one in self.nuisance[:segment])
        first_shift = self.columns - len(self.shifts)
        own = [first_shift + j for j, shift in enumerate(self.shifts) if shift.segment == segment]
        return np.array([*range(len(self.free)), *range(begin, begin + self.nuisance[segment].size), *own])

    def weights(self, residuals: FloatArray) -> FloatArray:
        """Weights of residuals in standard deviations; 0 where there is no sample."""
        size = np.abs(np.nan_to_num(residuals, nan=np.inf))
        if self.reject:
            return np.asarray(size < OUTLIER, dtype=float)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.minimum(1.0, _HUBER / np.maximum(size, 1e-9)))

    def cost(self, residuals: Sequence[FloatArray]) -> float:
        """Of the data, at the present noise: Huber's, or that of least squares with rejection."""
        total = 0.0
        for one in residuals:
            size = np.abs((one / self.noise)[np.isfinite(one)])
            if self.reject:
                total += float(np.minimum(size, OUTLIER) @ np.minimum(size, OUTLIER))
            else:
                total += float(np.where(size < _HUBER, size**2, _HUBER * (2.0 * size - _HUBER)).sum())
        return total

    def state(self) -> FloatArray:
        """Value of each column, as the prior counts it: parameters from nominal, nuisance from zero."""
        return np.concatenate([np.zeros(len(self.free)), *self.nuisance, self.sizes])

    def prior(self, walk: FloatArray) -> FloatArray:
        """Prior information of the columns; the walk's increments couple neighbouring knots."""
        prior = np.zeros((self.columns, self.columns))
        diagonal = np.arange(len(self.free))
        prior[diagonal, diagonal] = _PRIOR_LOG**-2
        column = len(self.free)
        for segment in self.segments:
            n = knots(segment.n_ticks)
            at = column + np.arange(len(START))
            prior[at, at] = _START_PRIOR**-2
            column += len(START)
            differences = np.diff(np.eye(n), axis=0)
            for which in range(len(WALKS)):
                block = differences.T @ differences / walk[which] ** 2
                block[0, 0] += _OFFSET_PRIOR[which] ** -2
                prior[column : column + n, column : column + n] = block
                column += n
        at = column + np.arange(len(self.shifts))
        prior[at, at] = _SHIFT_PRIOR[[shift.output for shift in self.shifts]] ** -2
        return prior

    def normal(self, residuals: Sequence[FloatArray], slopes: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Information of the data and its gradient."""
        information, gradient = np.zeros((self.columns, self.columns)), np.zeros(self.columns)
        for i, (one, of) in enumerate(zip(residuals, slopes, strict=True)):
            at = self._columns_of(i)
            scaled = one / self.noise
            root = np.sqrt(self.weights(scaled))
            j = (of / self.noise[:, None] * root[:, :, None]).reshape(-1, at.size)
            r = (np.nan_to_num(scaled) * root).ravel()
            information[np.ix_(at, at)] += j.T @ j
            gradient[at] += j.T @ r
        return information, gradient

    def likely_walk(self, information: FloatArray, gradient: FloatArray) -> FloatArray:
        """Sizes of the random walks, one step of MacKay's iteration towards the largest evidence."""
        covariance = np.linalg.inv(information + self.prior(self.walk))
        mean = covariance @ (gradient + information @ self.state())
        squares, told = np.zeros(len(WALKS)), np.zeros(len(WALKS))
        column = len(self.free)
        for segment, nuisance in zip(self.segments, self.nuisance, strict=True):
            k = knots(segment.n_ticks)
            for which in range(len(WALKS)):
                at = slice(column + len(START) + which * k, column + len(START) + (which + 1) * k)
                spread = covariance[at, at]
                variances = np.diag(spread)[1:] + np.diag(spread)[:-1] - 2.0 * np.diag(spread, 1)
                squares[which] += float((np.diff(mean[at]) ** 2).sum())
                told[which] += k - 1 - float(variances.sum()) / self.walk[which] ** 2
            column += nuisance.size
        wanted = np.sqrt(squares / np.maximum(told, 1e-3))
        wanted = np.clip(wanted, self.walk / _WALK_STEP, self.walk * _WALK_STEP)
        return np.asarray(np.clip(wanted, WALK[0], WALK[2]))

    def evidence(self) -> float:
        """Minus twice the logarithm of the evidence at the last solution, but for a constant.

        Other than the cost it can be compared between solutions with walks of other sizes.
        """
        _, residuals, slopes = self.last
        information, _ = self.normal(residuals, slopes)
        prior, state = self.prior(self.walk), self.state()
        increments = sum(knots(segment.n_ticks) - 1 for segment in self.segments)
        samples = np.isfinite(np.concatenate(residuals)).sum(axis=0)
        found = self.cost(residuals) + 2.0 * float(samples @ np.log(self.noise)) + float(state @ prior @ state)
        found += 2.0 * increments * float(np.log(self.walk).sum())
        return found + float(np.linalg.slogdet(information + prior)[1])

    def move(self, by: FloatArray) -> None:
        """Change all unknowns."""
        n = len(self.free)
        moved = {
            name: getattr(self.parameters, name) * float(np.exp(d)) for name, d in zip(self.free, by[:n], strict=True)
        }
        if "dead_time_s" in moved:
            moved["dead_time_s"] = min(max(moved["dead_time_s"], STEP_S), 10.0)
        if "motor_lag_s" in moved:
            moved["motor_lag_s"] = min(max(moved["motor_lag_s"], 0.02), 10.0)
        self.parameters = self.parameters.changed(**moved)
        column = n
        for i, one in enumerate(self.nuisance):
            self.nuisance[i] = one + by[column : column + one.size]
            column += one.size
        self.sizes = self.sizes + by[column:]

    def learn_noise(self, residuals: Sequence[FloatArray]) -> None:
        """Noise of each output from its residuals, without outliers."""
        together = np.concatenate(residuals)
        for i in range(3):
            values = together[np.isfinite(together[:, i]), i]
            spread = max(float(np.median(np.abs(values))) / 0.6745, NOISE_FLOOR[i])
            good = values[np.abs(values) < OUTLIER * spread]
            self.noise[i] = max(float(np.sqrt(np.mean(good**2))) if good.size else spread, NOISE_FLOOR[i])

    def solve(self, progress: Callable[[], None] | None = None, iterations: int = _ITERATIONS) -> float:
        """Levenberg-Marquardt from the present values; returns the cost."""
        damping = 1e-3
        predicted, residuals, slopes = self.evaluate()
        for iteration in range(iterations):
            if progress is not None:
                progress()
            self.learn_noise(residuals)
            information, gradient = self.normal(residuals, slopes)
            settled = True
            if not self.fixed_walk:
                earlier, self.walk = self.walk, self.likely_walk(information, gradient)
                settled = bool((np.abs(np.log(self.walk / earlier)) < _WALK_SETTLED).all())
            prior = self.prior(self.walk)
            whole, pull = information + prior, gradient - prior @ self.state()
            before = self.cost(residuals) + self.state() @ prior @ self.state()
            kept = self.parameters, list(self.nuisance), self.sizes
            while True:
                by = np.linalg.solve(whole + damping * np.diag(np.diag(whole)), pull)
                largest = np.abs(by[: len(self.free)]).max(initial=0.0)
                by = by * min(1.0, _LARGEST_MOVE / max(largest, 1e-12))
                self.move(by)
                predicted, residuals, slopes = self.evaluate()
                after = self.cost(residuals) + self.state() @ prior @ self.state()
                if np.isfinite(after) and after <= before + 1e-6:
                    damping = max(damping / 10.0, 1e-9)
                    break
                self.parameters, self.nuisance, self.sizes = kept[0], list(kept[1]), kept[2]
                damping = max(10.0 * damping, 1e-4)
                if damping > _MOST_DAMPED:
                    predicted, residuals, slopes = self.evaluate()
                    break
            if damping > _MOST_DAMPED:
                break
            if iteration >= _LEAST and settled and float(by @ whole @ by) < _CONVERGED**2:
                break
        self.last = predicted, residuals, slopes
        samples = np.isfinite(np.concatenate(residuals)).sum(axis=0)
        return self.cost(residuals) + 2.0 * float(samples @ np.log(self.noise))


def _settled(segment: Segment) -> Segment:
    """Without the first outputs that depend on power from before the segment, which is taken for constant."""
    measured = segment.measured.copy()
    measured[:_SETTLING_TICKS, :2] = np.nan
    return replace(segment, measured=measured)


def _initial(segment: Segment, p: ModelParameters) -> FloatArray:
    """Nuisance to start from: an equilibrium at the first second of the data."""
    first = segment.measured[:10]
    with np.errstate(all="ignore"):
        depth, temperature, torque = (
            float(np.nanmedian(column)) if np.isfinite(column).any() else float(np.nanmedian(whole))
            for column, whole in zip(first.T, segment.measured.T, strict=True)
        )
    rest = p.operating_depth_mm, p.operating_temperature_c, 1e3
    values = zip((depth, temperature, torque), rest, strict=True)
    depth, temperature, torque = (value if np.isfinite(value) else other for value, other in values)
    rise = temperature - p.operating_temperature_c
    power = rise / p.thermal_gain_c_per_kw
    creep = depth / (1.0 + p.softening_per_c * rise) - p.operating_depth_mm
    return np.concatenate([[creep, 0.0, power, power, torque, power], np.zeros(len(WALKS) * knots(segment.n_ticks))])
