"""Maximum-likelihood estimate of model parameters, initial states and slow disturbances from recorded welds.

The recorded inputs drive the model; what remains of the outputs is the sensors' noise. Inputs are what acted, so a
closed loop does not bias the estimate. Unknown slow disturbances of force, heat and outputs are random walks, whose
size is chosen by the evidence; sudden shifts of an output are found in the residuals and estimated along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.disturbed import astray, drop_small_shifts, leave_out, shifts
from fsw_identification.problem import NOISE_FLOOR, OUTLIER, WALK, WALKS, Problem, Shift
from fsw_identification.simulation import CANDIDATES, OUTPUTS, START, hats, knots
from fsw_identification.statistics import long_run_factor
from fsw_identification.weld_data import IdentificationError, Segment
from fsw_model import ModelParameters

#: a parameter with a larger relative standard deviation is one that the data cannot tell
LARGEST_DEVIATION = 0.25
#: never estimated: (19)-(22) have six coefficients for the three things that welds show
STRUCTURAL = ("geometry_factor", "contact_radius_m", "geometry_offset_m3")
_WHY_STRUCTURAL = "(19)-(22) have six coefficients, welds show three: the torque, its slope over force and over depth"
#: what even a weld at rest tells, if everything else of the torque is kept nominal
_LEVEL = "sliding_friction"
#: which are kept nominal first, where several cannot be told apart
_KEPT_FIRST = ("sticking_stress_pa", "contact_slope")
#: up to this share it is a disturbance, and not the wrong start
_SHARE_OF_DISTURBANCE = 0.25
#: iterations between two searches for shifts
_FEW = 6
#: relative standard deviation with which a parameter that is kept nominal is reckoned with
_KEPT_DEVIATION = 0.2
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
    free, unknown = CANDIDATES, dict[str, str]()
    first = Problem(segments, start, free)
    first.noise = _sensor_noise(segments)
    free = _select(first, free, unknown, _LARGEST_AT_START)
    best: Problem | None = None
    for factors in _STARTS:
        scaled = start.scaled(**{name: of for name, of in factors.items() if name in free})
        tried = _from(scaled, segments, free, tell)
        if best is None or tried.evidence() < best.evidence():
            best = tried
        share = np.concatenate([astray(one, first.noise) for one in tried.last[1]]).mean(axis=0)
        if (tried.noise < _AS_GOOD * first.noise).all() or (share < _SHARE_OF_DISTURBANCE).all():
            break  # what remains is the sensors' noise, or a disturbance: no start can lead to less
    assert best is not None
    while (left := _select(best, best.free, unknown, LARGEST_DEVIATION)) != best.free:
        kept = {name: getattr(start, name) for name in best.free if name not in left}
        best.parameters, best.free = best.parameters.changed(**kept), left
        best.solve(tell)
    notes = leave_out(best, first.noise, tell)
    drop_small_shifts(best)
    best.reject = True
    cost = best.solve(tell)
    return _fit(best, unknown | dict.fromkeys(STRUCTURAL, _WHY_STRUCTURAL), notes, cost)


def _from(
    start: ModelParameters, segments: Sequence[Segment], free: tuple[str, ...], tell: Callable[[], None]
) -> Problem:
    """Solution from a start, with shifts and slow disturbances.

    Shifts are found in the residuals of a model that they have bent; so once more from the start, with what was found.
    """
    problem = _solved(start, segments, free, [], tell)
    if not problem.shifts:
        return problem
    again = _solved(start, segments, free, list(zip(problem.shifts, problem.sizes, strict=True)), tell)
    return min(problem, again, key=Problem.evidence)


def _solved(
    start: ModelParameters,
    segments: Sequence[Segment],
    free: tuple[str, ...],
    known: Sequence[tuple[Shift, float]],
    tell: Callable[[], None],
) -> Problem:
    """Solution from a start with known shifts, and others that are found."""
    # without the weakly told parameters first: the valley that they open is long and curved
    problem = Problem(segments, start, [name for name in free if name not in _KEPT_FIRST])
    problem.shifts = [shift for shift, _ in known]
    problem.sizes = np.array([size for _, size in known])
    problem.solve(tell)
    problem.free = free
    problem.solve(tell)
    for problem.fixed_walk in (True, False):
        if not problem.fixed_walk:
            problem.solve(tell)
        while found := shifts(problem):
            problem.shifts += found
            problem.sizes = np.concatenate([problem.sizes, np.zeros(len(found))])
            problem.solve(tell, _FEW)
    return problem


def validate(segments: Sequence[Segment], parameters: ModelParameters) -> Fit:
    """How well a model predicts welds: only initial states and constant disturbances are estimated.

    Parameters and return value as of :func:`identify`.
    """
    problem = Problem(segments, parameters, ())
    problem.walk = WALK[0]
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
    problem = Problem(segments, parameters, CANDIDATES)
    problem.noise, problem.walk = noise, WALK[0]
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
    return np.asarray(np.maximum(np.nan_to_num(spread), NOISE_FLOOR))


def _select(problem: Problem, free: Sequence[str], unknown: dict[str, str], largest: float) -> tuple[str, ...]:
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


def _by_kept(problem: Problem, kept: Sequence[str], covariance: FloatArray) -> FloatArray:
    """What errors of the parameters that are kept nominal add to the covariance of everything else."""
    if not kept:
        return np.zeros_like(covariance)
    free, n = problem.free, len(problem.free)
    problem.free = (*free, *kept)
    _, residuals, slopes = problem.evaluate()
    information, _ = problem.normal(residuals, slopes)
    problem.free = free
    at = np.arange(n, n + len(kept))
    rest = np.delete(np.arange(len(information)), at)
    gain = _KEPT_DEVIATION * covariance @ information[np.ix_(rest, at)]
    return np.asarray(gain @ gain.T)


def _fit(problem: Problem, unknown: dict[str, str], notes: list[str], cost: float) -> Fit:
    predicted, residuals, slopes = problem.last
    if problem.reject:
        residuals = [np.where(np.abs(one / problem.noise) < OUTLIER, one, np.nan) for one in residuals]
        before = sum(np.isfinite(one).sum(axis=0) for one in problem.last[1])
        count = before - sum(np.isfinite(one).sum(axis=0) for one in residuals)
        notes = notes + [f"{name}: {n} samples left out: outliers" for name, n in zip(OUTPUTS, count, strict=True) if n]
    colour = np.array([long_run_factor([one[:, i] for one in residuals]) for i in range(3)])
    white, problem.noise = problem.noise, problem.noise * np.sqrt(colour)
    information, _ = problem.normal(residuals, slopes)
    problem.noise = white
    covariance: FloatArray = np.linalg.inv(information + problem.prior(problem.walk)).astype(np.float64)
    covariance += _by_kept(problem, [name for name in unknown if name not in STRUCTURAL], covariance)
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
