"""Maximum-likelihood estimate of model parameters, initial states and slow disturbances from recorded welds.

The recorded inputs drive the model; what remains of the outputs is the sensors' noise. Inputs are what acted, so a
closed loop does not bias the estimate. Unknown slow disturbances of force, heat and outputs are random walks, whose
size is chosen by the evidence; sudden shifts of an output are found in the residuals and estimated along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fsw_analysis.identification.simulation import (
    CANDIDATES,
    OUTPUTS,
    START,
    hats,
    knots,
    simulate,
)
from fsw_analysis.identification.statistics import long_run_factor
from fsw_analysis.identification.weld_data import IdentificationError, Segment
from fsw_analysis.weld_signals import FloatArray
from fsw_control.weld import TICK_S
from fsw_model import STEP_S, ModelParameters

#: a parameter with a larger relative standard deviation is one that the data cannot tell
LARGEST_DEVIATION = 0.25
#: never estimated: (19)-(22) have six coefficients for the three things that welds show
STRUCTURAL = ("geometry_factor", "contact_radius_m", "geometry_offset_m3")
_WHY_STRUCTURAL = "(19)-(22) have six coefficients, welds show three: the torque, its slope over force and over depth"
#: what even a weld at rest tells, if everything else of the torque is kept nominal
_LEVEL = "sliding_friction"
#: which are kept nominal first, where several cannot be told apart
_KEPT_FIRST = ("sticking_stress_pa", "contact_slope")
#: prior standard deviation of the logarithm of a parameter: none to speak of
_PRIOR_LOG = 2.0
#: prior standard deviations of ``START``
_START_PRIOR = np.array([1.0, 0.3, 20.0, 20.0, 500.0, 20.0])
#: slow disturbances: of force [kN] and power [kW], which act on the process, and of what is shown of the outputs
WALKS = ("force [kN]", "power [kW]", "depth [mm]", "temperature [°C]", "torque [N·m]")
#: prior standard deviations of the disturbances at the beginning; a constant one of an output cannot be told
_OFFSET_PRIOR = np.array([10.0, 20.0, 1e-4, 1e-3, 1e-2])
#: standard deviations of a disturbance's change within KNOT_S: smallest, at the start, largest
_WALK = np.array([[1e-3, 1e-3, 2e-5, 1e-3, 1e-2], [0.01, 0.01, 2e-4, 0.01, 0.1], [3.0, 5.0, 0.1, 5.0, 50.0]])
#: smallest noise that is reckoned with, so that data without noise do not count for infinitely much
_NOISE_FLOOR = np.array([1e-4, 5e-3, 0.1])
#: residuals beyond this many standard deviations are left out, at the end
_OUTLIER = 5.0
_HUBER = 3.0
_LARGEST_MOVE = 0.3
#: largest factor on the size of a random walk in one iteration
_WALK_STEP = 4.0
_WALK_SETTLED = 0.3
_LEAST, _ITERATIONS = 3, 30
_MOST_DAMPED = 1e4
#: converged when the next move is below this many standard deviations, all unknowns together
_CONVERGED = 0.05
#: a shift of an output: samples before and after that are compared, and how many standard deviations are a shift
_SHIFT_TICKS, _SHIFT = 30, 9.0
_MOST_SHIFTS = 12
#: a shift of fewer standard deviations is dropped in the end
_REAL_SHIFT = 5.0
#: residuals are limited to this many standard deviations where shifts are looked for, so that a spike is none
_CLIP = 5.0
#: length of a stretch, and the median residual, in standard deviations, from which on it is left out
_STRETCH_TICKS, _ASTRAY = 200, 0.7
#: as ``LARGEST_DEVIATION``, but at the nominal parameters, before anything is known
_LARGEST_AT_START = 0.3
#: correlation from which on two parameters are said to be told only together
_CORRELATED = 0.9
#: residuals that exceed the noise between neighbouring samples by less than this are nothing but that noise
_AS_GOOD = 1.1
#: factors on the starting values, tried one after the other
_STARTS: tuple[dict[str, float], ...] = (
    {},
    {"dead_time_s": 0.7, "tool_lag_s": 1.5, "copper_lag_s": 0.8, "depth_gain_mm_per_kn_s": 1.3},
    {"dead_time_s": 1.3, "tool_lag_s": 0.7, "copper_lag_s": 1.3, "depth_gain_mm_per_kn_s": 0.8},
)


@dataclass(frozen=True, slots=True)
class Shift:
    """A sudden change of an output that the model does not explain: from ``at_s`` on it is ``size`` higher."""

    segment: int
    output: int
    tick: int


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate.

    Attributes
    ----------
    parameters : ModelParameters
        Those that were not estimated are as they were given.
    free : tuple of str
        Names of the estimated parameters.
    covariance : (n, n) array
        Of the logarithms of the estimated parameters, i.e. of their relative errors.
    unknown : dict of str to str
        By name, why a candidate was not estimated.
    noise : (3,) array
        Standard deviations of the residuals in the order of ``OUTPUTS``.
    colour : (3,) array
        By how much the variance of a mean of the residuals exceeds that of white noise; 1 where they are white.
    walk : (5,) array
        Standard deviation of the change within ``KNOT_S`` of each of ``WALKS``.
    segments : list of Segment
    predicted, residuals : list of (n, 3) array
        By segment; residuals are NaN where a sample was missing or left out.
    disturbances : list of (n, 5) array
        In the order of ``WALKS``, by segment.
    offset, offset_std : (2,) array
        Mean disturbance of the process and its standard deviation, kN and kW.
    shifts : list of (Shift, float, float)
        With size and standard deviation.
    notes : list of str
        What was left out, one line each.
    cost : float
        Minus twice the logarithm of the likelihood, but for a constant.
    """

    parameters: ModelParameters
    free: tuple[str, ...]
    covariance: FloatArray
    unknown: dict[str, str]
    noise: FloatArray
    colour: FloatArray
    walk: FloatArray
    segments: list[Segment]
    predicted: list[FloatArray]
    residuals: list[FloatArray]
    disturbances: list[FloatArray]
    offset: FloatArray
    offset_std: FloatArray
    shifts: list[tuple[Shift, float, float]]
    notes: list[str]
    cost: float

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the estimated parameters, in their units."""
        relative = np.sqrt(np.diag(self.covariance))
        return {name: float(getattr(self.parameters, name) * of) for name, of in zip(self.free, relative, strict=True)}

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the estimated parameters."""
        deviation = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(deviation, deviation))


class _Problem:
    """Normal equations of one linearisation after the other; all segments of all welds at once."""

    def __init__(self, segments: Sequence[Segment], start: ModelParameters, free: Sequence[str]) -> None:
        self.segments, self.parameters, self.free = list(segments), start, tuple(free)
        self.noise, self.walk = np.array([0.01, 1.0, 10.0]), _WALK[1].copy()
        self.shifts: list[Shift] = []
        self.sizes = np.zeros(0)
        self.reject, self.fixed_walk = False, True
        self.nuisance = [_initial(segment, start) for segment in self.segments]

    # columns: logarithms of the free parameters; nuisance of each segment; sizes of the shifts
    def evaluate(self) -> tuple[list[FloatArray], list[FloatArray], list[FloatArray]]:
        """Predictions, residuals, and their derivatives (n, 3, columns), by segment."""
        chosen = [CANDIDATES.index(name) for name in self.free]
        scale = np.array([getattr(self.parameters, name) for name in self.free])
        predicted, residuals, slopes = [], [], []
        column = len(self.free)
        for i, (segment, nuisance) in enumerate(zip(self.segments, self.nuisance, strict=True)):
            weights = hats(segment.n_ticks)
            k = weights.shape[1]
            n_process = len(START) + 2 * k
            course = simulate(self.parameters, segment, nuisance[:n_process])
            of = np.zeros((segment.n_ticks, 3, self.columns))
            of[:, :, : len(self.free)] = course.by_candidate[:, :, chosen] * scale
            of[:, :, column : column + n_process] = course.by_nuisance
            shown = course.outputs + weights @ nuisance[n_process:].reshape(3, k).T
            for output in range(3):
                begin = column + n_process + output * k
                of[:, output, begin : begin + k] = weights
            for j, shift in enumerate(self.shifts):
                if shift.segment == i:
                    shown[shift.tick :, shift.output] += self.sizes[j]
                    of[shift.tick :, shift.output, self.columns - len(self.shifts) + j] = 1.0
            column += nuisance.size
            predicted.append(shown)
            residuals.append(segment.measured - shown)
            slopes.append(of)
        return predicted, residuals, slopes

    @property
    def columns(self) -> int:
        return len(self.free) + sum(one.size for one in self.nuisance) + len(self.shifts)

    def weights(self, residuals: FloatArray) -> FloatArray:
        """Weights of residuals in standard deviations; 0 where there is no sample."""
        size = np.abs(np.nan_to_num(residuals, nan=np.inf))
        if self.reject:
            return np.asarray(size < _OUTLIER, dtype=float)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.minimum(1.0, _HUBER / np.maximum(size, 1e-9)))

    def cost(self, residuals: Sequence[FloatArray]) -> float:
        """Of the data, at the present noise: Huber's, or that of least squares with rejection."""
        total = 0.0
        for one in residuals:
            size = np.abs((one / self.noise)[np.isfinite(one)])
            if self.reject:
                total += float(np.minimum(size, _OUTLIER) @ np.minimum(size, _OUTLIER))
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
        return prior

    def normal(self, residuals: Sequence[FloatArray], slopes: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Information of the data and its gradient."""
        information, gradient = np.zeros((self.columns, self.columns)), np.zeros(self.columns)
        for one, of in zip(residuals, slopes, strict=True):
            scaled = one / self.noise
            root = np.sqrt(self.weights(scaled))
            j = (of / self.noise[:, None] * root[:, :, None]).reshape(-1, self.columns)
            r = (np.nan_to_num(scaled) * root).ravel()
            information += j.T @ j
            gradient += j.T @ r
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
        return np.asarray(np.clip(wanted, _WALK[0], _WALK[2]))

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
        self.parameters = replace(self.parameters, **moved)
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
            spread = max(float(np.median(np.abs(values))) / 0.6745, _NOISE_FLOOR[i])
            good = values[np.abs(values) < _OUTLIER * spread]
            self.noise[i] = max(float(np.sqrt(np.mean(good**2))) if good.size else spread, _NOISE_FLOOR[i])

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


def _initial(segment: Segment, p: ModelParameters) -> FloatArray:
    """Nuisance to start from: an equilibrium at the first second of the data."""
    first = segment.measured[:10]
    with np.errstate(all="ignore"):
        depth, temperature, torque = (
            float(np.nanmedian(column)) if np.isfinite(column).any() else float(np.nanmedian(whole))
            for column, whole in zip(first.T, segment.measured.T, strict=True)
        )
    rise = temperature - p.operating_temperature_c
    power = rise / p.thermal_gain_c_per_kw
    creep = depth / (1.0 + p.softening_per_c * rise) - p.operating_depth_mm
    return np.concatenate([[creep, 0.0, power, power, torque, power], np.zeros(len(WALKS) * knots(segment.n_ticks))])


def identify(
    segments: Sequence[Segment],
    start: ModelParameters | None = None,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Estimate what the data can tell of the model.

    Parameters
    ----------
    segments : sequence of Segment
        Of one or more welds of one process.
    start : ModelParameters, optional
        The paper's by default; what the data cannot tell keeps these values.
    progress : callable, optional
        Called with the share done.

    Raises
    ------
    IdentificationError
        The data tell no parameter.
    """
    start = start or ModelParameters()
    tell = _Progress(progress)
    free, unknown = tuple(name for name in CANDIDATES if name not in STRUCTURAL), dict[str, str]()
    first = _Problem(segments, start, free)
    first.noise = _sensor_noise(segments)
    free = _select(first, free, unknown, _LARGEST_AT_START)
    best: _Problem | None = None
    lowest = np.inf
    for factors in _STARTS:
        tried = _Problem(segments, start.scaled(**{name: of for name, of in factors.items() if name in free}), free)
        cost = tried.solve(tell)
        if cost < lowest:
            lowest, best = cost, tried
        if (tried.noise < _AS_GOOD * first.noise).all():
            break  # what remains is the sensors' noise: no start can lead to less
    assert best is not None
    for best.fixed_walk in (True, False):
        if not best.fixed_walk:
            best.solve(tell)
        while found := _shifts(best):
            best.shifts += found
            best.sizes = np.concatenate([best.sizes, np.zeros(len(found))])
            best.solve(tell)
    while (left := _select(best, best.free, unknown, LARGEST_DEVIATION)) != best.free:
        kept = {name: getattr(start, name) for name in best.free if name not in left}
        best.parameters, best.free = replace(best.parameters, **kept), left
        best.solve(tell)
    notes = _leave_out(best, tell)
    _drop_small_shifts(best)
    best.reject = True
    cost = best.solve(tell)
    return _fit(best, unknown | dict.fromkeys(STRUCTURAL, _WHY_STRUCTURAL), notes, cost)


def validate(segments: Sequence[Segment], parameters: ModelParameters) -> Fit:
    """How well a model predicts welds: only initial states and constant disturbances are estimated.

    Parameters and return value as of :func:`identify`.
    """
    problem = _Problem(segments, parameters, ())
    problem.walk = _WALK[0]
    return _fit(problem, {}, [], problem.solve())


def expected_deviations(
    segments: Sequence[Segment], parameters: ModelParameters, noise: FloatArray
) -> dict[str, float]:
    """Relative standard deviations that a weld promises, by the information of the model at ``parameters``.

    Parameters
    ----------
    segments : sequence of Segment
        Of a simulated weld.
    parameters : ModelParameters
    noise : (3,) array
        Standard deviations of the sensors in the order of ``OUTPUTS``.
    """
    problem = _Problem(segments, parameters, [name for name in CANDIDATES if name not in STRUCTURAL])
    problem.noise, problem.walk = noise, _WALK[0]
    _, residuals, slopes = problem.evaluate()
    information, _ = problem.normal([0.0 * one for one in residuals], slopes)
    covariance = np.linalg.inv(information + problem.prior(problem.walk))
    return dict(zip(problem.free, map(float, np.sqrt(np.diag(covariance))), strict=False))


class _Progress:
    """Share done, of a number of iterations that is not known."""

    def __init__(self, told: Callable[[float], None] | None) -> None:
        self._told, self._count = told, 0

    def __call__(self) -> None:
        self._count += 1
        if self._told is not None:
            self._told(1.0 - np.exp(-self._count / 30.0))


def _sensor_noise(segments: Sequence[Segment]) -> FloatArray:
    """Noise of the sensors from the differences of neighbouring samples."""
    differences = np.concatenate([np.diff(segment.measured, axis=0) for segment in segments])
    spread = np.nanmedian(np.abs(differences), axis=0) / 0.6745 / np.sqrt(2.0)
    return np.asarray(np.maximum(np.nan_to_num(spread), _NOISE_FLOOR))


def _select(problem: _Problem, free: Sequence[str], unknown: dict[str, str], largest: float) -> tuple[str, ...]:
    """The parameters that the data tell to ``largest``; for the others ``unknown`` says why not.

    Of several that cannot be told apart the least important one is kept nominal first.
    """
    _, residuals, slopes = problem.evaluate()
    information, _ = problem.normal(residuals, slopes)
    whole = information + problem.prior(problem.walk)
    rest = np.arange(len(free), problem.columns)
    left = list(range(len(free)))
    while True:
        if not left or [free[i] for i in left] == [_LEVEL]:
            raise IdentificationError(
                "the data tell no parameter but perhaps the level of the torque: force and speed hardly move; "
                "weld with steps, see --design"
            )
        chosen = np.array([*left, *rest])
        covariance = np.linalg.inv(whole[np.ix_(chosen, chosen)])[: len(left), : len(left)]
        deviation = np.sqrt(np.diag(covariance))
        poor = [i for i in range(len(left)) if deviation[i] > largest]
        if not poor:
            return tuple(free[i] for i in left)
        order = {name: rank for rank, name in enumerate(_KEPT_FIRST)}
        worst = min(poor, key=lambda i: (order.get(free[left[i]], len(order)), -deviation[i]))
        name = free[left[worst]]
        size = f"{100 * deviation[worst]:.0f} %" if deviation[worst] < 1.0 else "more than 100 %"
        unknown[name] = f"standard deviation {size}"
        correlation = np.abs(covariance[worst] / deviation / deviation[worst])
        correlation[worst] = 0.0
        if len(left) > 1 and correlation.max() > _CORRELATED:
            unknown[name] += f", together with {free[left[int(correlation.argmax())]]}"
        del left[worst]


def _shifts(problem: _Problem) -> list[Shift]:
    """The largest shift in the residuals of each output of each segment, where there is one."""
    _, residuals, _ = problem.last
    found: list[Shift] = []
    for i, one in enumerate(residuals):
        known = np.isfinite(one)
        limited = np.nan_to_num(np.clip(one / problem.noise, -_CLIP, _CLIP))
        sums, counts = (np.vstack([np.zeros((1, 3)), np.cumsum(of, axis=0)]) for of in (limited, known))
        at = np.arange(1, len(one))
        low, high = np.maximum(at - _SHIFT_TICKS, 0), np.minimum(at + _SHIFT_TICKS, len(one))
        n_before, n_after = counts[at] - counts[low], counts[high] - counts[at]
        with np.errstate(all="ignore"):
            difference = (sums[high] - sums[at]) / n_after - (sums[at] - sums[low]) / n_before
            size = np.abs(difference) / np.sqrt(1.0 / n_before + 1.0 / n_after)
        size[(n_before < _SHIFT_TICKS / 2) | (n_after < _SHIFT_TICKS / 2)] = 0.0
        for output in range(3):
            tick = int(at[np.argmax(size[:, output])])
            shift = Shift(i, output, tick)
            near = [s for s in problem.shifts if s.segment == i and s.output == output and abs(s.tick - tick) < 5]
            if size[:, output].max() > _SHIFT and not near and len(problem.shifts) + len(found) < _MOST_SHIFTS:
                found.append(shift)
    return found


def _drop_small_shifts(problem: _Problem) -> None:
    """Forget shifts that turned out to be none, e.g. the end of a stretch that is left out."""
    if not problem.shifts:
        return
    _, residuals, slopes = problem.last
    information, _ = problem.normal(residuals, slopes)
    deviation = np.sqrt(np.diag(np.linalg.pinv(information + problem.prior(problem.walk))))[-len(problem.shifts) :]
    large = np.abs(problem.sizes) > _REAL_SHIFT * deviation
    problem.shifts = [shift for shift, real in zip(problem.shifts, large, strict=True) if real]
    problem.sizes = problem.sizes[large]


def _leave_out(problem: _Problem, tell: Callable[[], None]) -> list[str]:
    """Leave out stretches in which an output goes its own way; returns what was left out."""
    _, residuals, _ = problem.last
    notes: list[str] = []
    for i, one in enumerate(residuals):
        segment = problem.segments[i]
        measured = segment.measured.copy()
        for output, name in enumerate(OUTPUTS):
            stretches = np.array_split(np.arange(segment.n_ticks), max(1, round(segment.n_ticks / _STRETCH_TICKS)))
            means = [np.abs(_median(one[part, output] / problem.noise[output])) for part in stretches]
            astray = [part for part, mean in zip(stretches, means, strict=True) if mean > _ASTRAY]
            if len(astray) > len(stretches) / 3:
                notes.append(f"{name}: the model does not follow it in {len(astray)} of {len(stretches)} stretches; "
                             "do not trust what depends on it")  # fmt: skip
                continue
            for part in astray:
                measured[part, output] = np.nan
                begin, end = segment.time_s[part[0]], segment.time_s[part[-1]] + TICK_S
                notes.append(f"{name}: {begin:.0f} to {end:.0f} s left out: the model does not follow it")
        problem.segments[i] = replace(segment, measured=measured)
    if notes:
        problem.solve(tell)
    return notes


def _median(values: FloatArray) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else 0.0


def _fit(problem: _Problem, unknown: dict[str, str], notes: list[str], cost: float) -> Fit:
    predicted, residuals, slopes = problem.last
    if problem.reject:
        residuals = [np.where(np.abs(one / problem.noise) < _OUTLIER, one, np.nan) for one in residuals]
        before = sum(np.isfinite(one).sum(axis=0) for one in problem.last[1])
        count = before - sum(np.isfinite(one).sum(axis=0) for one in residuals)
        notes = notes + [f"{name}: {n} samples left out: outliers" for name, n in zip(OUTPUTS, count, strict=True) if n]
    colour = np.array([long_run_factor([one[:, i] for one in residuals]) for i in range(3)])
    white, problem.noise = problem.noise, problem.noise * np.sqrt(colour)
    information, _ = problem.normal(residuals, slopes)
    problem.noise = white
    covariance = np.linalg.inv(information + problem.prior(problem.walk))
    n = len(problem.free)
    disturbances, mean = [], np.zeros((2, problem.columns))
    total = sum(segment.n_ticks for segment in problem.segments)
    column = n
    for segment, nuisance in zip(problem.segments, problem.nuisance, strict=True):
        weights, k = hats(segment.n_ticks), knots(segment.n_ticks)
        by_knot = nuisance[len(START) :].reshape(len(WALKS), k)
        disturbances.append(weights @ by_knot.T)
        for which in range(2):
            begin = column + len(START) + which * k
            mean[which, begin : begin + k] = weights.sum(axis=0) / total
        column += nuisance.size
    sizes_std = np.sqrt(np.diag(covariance))[problem.columns - len(problem.shifts) :]
    return Fit(
        parameters=problem.parameters,
        free=problem.free,
        covariance=np.asarray(covariance[:n, :n], dtype=np.float64),
        unknown=unknown,
        noise=white,
        colour=colour,
        walk=problem.walk,
        segments=problem.segments,
        predicted=predicted,
        residuals=residuals,
        disturbances=disturbances,
        offset=mean @ problem.state(),
        offset_std=np.sqrt(np.diag(mean @ covariance @ mean.T)),
        shifts=[(s, float(a), float(b)) for s, a, b in zip(problem.shifts, problem.sizes, sizes_std, strict=True)],
        notes=notes,
        cost=cost,
    )
