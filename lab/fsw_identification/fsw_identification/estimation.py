"""Maximum-likelihood estimate of model parameters, initial states and slow disturbances from recorded welds.

The recorded inputs drive the model; the rest of the outputs is the sensors' noise. Inputs are what
acted, so a closed loop does not bias the estimate. Unknown slow disturbances of force, heat and
outputs are random walks, whose size is chosen by the evidence; sudden shifts of an output are
found in the residuals and estimated along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.disturbed import (
    disturbed_windows,
    drop_small_shifts,
    find_shifts,
    leave_out,
)
from fsw_identification.evidence import evidence, likely_colour, likely_lag
from fsw_identification.noise import WHITE_S, correlation_s
from fsw_identification.problem import NOISE_FLOOR, WALK, Problem, Shift
from fsw_identification.robust import long_run_covariance
from fsw_identification.simulation import (
    CANDIDATES,
    DEPTH,
    OUTPUTS,
    TEMPERATURE,
    TORQUE,
    added,
    as_shown,
)
from fsw_identification.solver import solve
from fsw_identification.statistics import CORRELATED, long_run_factor
from fsw_identification.weld_data import Segment
from fsw_model import ModelParameters
from fsw_schema.models import InputError

#: a parameter with a larger relative standard deviation is not identifiable
LARGEST_DEVIATION = 0.25
#: as ``LARGEST_DEVIATION``, but at the nominal parameters, before anything is known
_LARGEST_AT_START = 0.3
#: never estimated: (19)-(22) have six coefficients for the three things that welds show
STRUCTURAL = ("geometry_factor", "contact_radius_m", "geometry_offset_m3")
_WHY_STRUCTURAL = (
    "(19)-(22) have six coefficients, welds identify three: "
    "the torque, its slope over force and over depth"
)
#: identifiable even at rest, if the other torque parameters are kept nominal
_LEVEL = "sliding_friction"
#: which are kept nominal first, where several are not identifiable together
_KEPT_FIRST = ("sticking_stress_pa", "contact_slope")
#: up to this share of disturbed windows the start is right, and the rest is a disturbance
_SHARE_OF_DISTURBANCE = 0.25
#: correlation of the residuals from tick to tick, of any output, from which on the noise is tried
#: as coloured
_COLOURED = 0.2
#: a lag of the thermocouple of more standard deviations is tried; how often the sensors are looked
#: at
_LAGS, _LOOKS = 5.0, 2
#: iterations between two searches for shifts
_FEW = 6
#: assumed relative standard deviation of a parameter that is kept nominal
_KEPT_DEVIATION = 0.2
#: residuals that exceed the noise between neighbouring samples by less than this factor count as
#: noise alone
_AS_GOOD = 1.1
#: factors on the starting values, tried one after the other
_STARTS: tuple[dict[str, float], ...] = (
    {},
    {"dead_time_s": 0.7, "tool_lag_s": 1.5, "copper_lag_s": 0.8, "depth_gain_mm_per_kn_s": 1.3},
    {"dead_time_s": 1.3, "tool_lag_s": 0.7, "copper_lag_s": 1.3, "depth_gain_mm_per_kn_s": 0.8},
)

Progress = Callable[[], None]
#: whether the noise is coloured, and by how much the thermocouple lags [s]
Sensors = tuple[bool, float]


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate."""

    parameters: ModelParameters  #: those that were not estimated are as they were given
    free: tuple[str, ...]  #: names of the estimated parameters
    #: (n, n): of the logarithms of the estimated parameters, i.e. of their relative errors
    covariance: FloatArray
    kept: dict[str, str]  #: by name, why a candidate was not estimated but kept nominal
    noise: (
        FloatArray  #: (3,): standard deviations of the outputs' noise in the order of ``OUTPUTS``
    )
    correlation_s: (
        FloatArray  #: (3,): time after which the noise's autocorrelation is down to 1/e, 0: white
    )
    #: (3,): by how much the variance of a mean of the whitened residuals exceeds that of white
    #: noise; 1: they are white
    colour: FloatArray
    segments: list[Segment]
    #: (n, 3) by segment; residuals are NaN where a sample was missing or left out
    predicted: list[FloatArray]
    residuals: list[FloatArray]
    whitened: list[FloatArray]
    disturbances: list[FloatArray]  #: (n, 5), in the order of ``WALKS``, by segment
    #: (2,): mean disturbance of the process and its standard deviation, kN and kW
    offset: FloatArray
    offset_std: FloatArray
    shifts: list[tuple[Shift, float, float]]  #: with size and standard deviation
    #: of the tool in slow disturbances of the temperature, and its standard deviation; the rest is
    #: the sensor's
    share: tuple[float, float]
    #: of the thermocouple behind the tool, and its standard deviation; None where the data do not
    #: tell of any
    lag_s: tuple[float, float] | None
    lag_correlation: FloatArray  #: (n,): of its estimate with those of the parameters
    heat_and_offset: float  #: correlation of slow heat and offset of the temperature
    notes: list[str]  #: what was left out, one line each

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the estimated parameters, in their units."""
        relative = np.sqrt(np.diag(self.covariance))
        return {
            name: float(getattr(self.parameters, name) * r)
            for name, r in zip(self.free, relative, strict=True)
        }

    @property
    def known_lag_s(self) -> float:
        """Lag of the thermocouple; 0 where the data do not tell of any."""
        return 0.0 if self.lag_s is None else self.lag_s[0]

    @property
    def shown(self) -> ModelParameters:
        """The parameters as a controller sees the process: what the thermocouple shows, with its lag."""
        return (
            self.parameters if self.lag_s is None else as_shown(self.parameters, self.known_lag_s)
        )

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the estimated parameters."""
        deviation = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(deviation, deviation))


def identify(
    segments: Sequence[Segment],
    start: ModelParameters | None = None,
    progress: Callable[[float], None] | None = None,
    steady: bool = False,
) -> Fit:
    """Estimate the identifiable parameters of the model.

    Parameters
    ----------
    segments : sequence of Segment
        Of one or more welds of one process.
    start : ModelParameters, optional
        The paper's by default; parameters that are not identifiable keep these values.
    progress : callable, optional
        Called with the share done.
    steady : bool
        Disturbances are constant, without drifts and shifts, so that what is slow is the
        process's.

    Raises
    ------
    InputError
        No parameter is identifiable, or none can be computed.
    """
    iterations = 0

    def count() -> None:
        nonlocal iterations
        iterations += 1
        if progress is not None:
            progress(
                1.0 - np.exp(-iterations / 30.0)
            )  # the number of iterations is not known in advance

    try:
        return _identify(segments, start or ModelParameters(), count, steady)
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"the estimate broke down ({error}); start nearer to the process (--model), or weld a designed experiment, "
            "see --design"
        ) from error


def _identify(
    segments: Sequence[Segment], start: ModelParameters, count: Progress, steady: bool
) -> Fit:
    kept: dict[str, str] = {}
    first = Problem(segments, start, CANDIDATES)
    first.noise = _sensor_noise(segments)
    first.settle()
    free = _select(first, kept, _LARGEST_AT_START)
    best = _best_start(start, segments, free, first.noise, count, steady)
    for _ in range(0 if steady else _LOOKS):
        sensors = _sensors(best)
        if sensors == (best.coloured, best.lag_s):
            break
        best = min(
            best,
            _best_start(start, segments, free, first.noise, count, False, sensors),
            key=evidence,
        )
    while (left := _select(best, kept, LARGEST_DEVIATION)) != best.free:
        nominal = {name: getattr(start, name) for name in best.free if name not in left}
        best.parameters, best.free = best.parameters.changed(**nominal), left
        solve(best, count)
    notes = leave_out(best, _innovation(first.noise, best.autocorrelation), count)
    drop_small_shifts(best)
    solve(best, count, reject=True)
    if steady:
        notes += [
            f"{name}: residuals are correlated over {over_s:.2g} s; --steady takes noise for white, and enlarges the "
            "standard deviations instead"
            for name, over_s in zip(OUTPUTS, correlation_s(likely_colour(best)), strict=True)
            if over_s > WHITE_S
        ]
    return _fit(best, kept | dict.fromkeys(STRUCTURAL, _WHY_STRUCTURAL), notes, rejected=True)


def _sensors(problem: Problem) -> Sensors:
    """What the data tell of the sensors at a solution."""
    coloured = problem.coloured or bool(likely_colour(problem).max() > _COLOURED)
    if problem.lagged:
        return coloured, problem.lag_s
    lag_s, deviation_s = likely_lag(problem)
    return coloured, lag_s if lag_s > _LAGS * deviation_s else 0.0


def _best_start(
    start: ModelParameters,
    segments: Sequence[Segment],
    free: tuple[str, ...],
    noise: FloatArray,
    count: Progress,
    steady: bool,
    sensors: Sensors = (False, 0.0),
) -> Problem:
    """The solution with the largest evidence from several starts, as many as needed."""
    best: Problem | None = None
    for factors in _STARTS:
        scaled = start.scaled(**{name: factor for name, factor in factors.items() if name in free})
        if steady:
            solved = _solve_steady(scaled, segments, free, count)
        else:
            solved = _solve_twice(scaled, segments, free, count, sensors)
        if best is None or evidence(solved) < evidence(best):
            best = solved
        alone = _innovation(noise, solved.autocorrelation)
        share = np.concatenate([disturbed_windows(one, alone) for one in solved.whitened]).mean(
            axis=0
        )
        if (solved.noise < _AS_GOOD * alone).all() or (share < _SHARE_OF_DISTURBANCE).all():
            # what remains is the sensors' noise, or a disturbance: no start can lead to less
            break
    assert best is not None
    return best


def _solve_steady(
    start: ModelParameters, segments: Sequence[Segment], free: tuple[str, ...], count: Progress
) -> Problem:
    """Solution from a start with disturbances that hardly change, and no shifts."""
    problem = Problem(segments, start, [name for name in free if name not in _KEPT_FIRST])
    problem.walk = WALK[0]
    solve(problem, count)
    problem.free = free
    solve(problem, count)
    return problem


def _solve_twice(
    start: ModelParameters,
    segments: Sequence[Segment],
    free: tuple[str, ...],
    count: Progress,
    sensors: Sensors,
) -> Problem:
    """Solution from a start, with shifts and slow disturbances.

    Shifts are found in the residuals of a model that they have biased; so it is repeated from the
    start, with these shifts.
    """
    problem = _solve(start, segments, free, [], np.zeros(0), count, sensors)
    if not problem.shifts:
        return problem
    again = _solve(start, segments, free, problem.shifts, problem.sizes, count, sensors)
    return min(problem, again, key=evidence)


def _solve(
    start: ModelParameters,
    segments: Sequence[Segment],
    free: tuple[str, ...],
    shifts: Sequence[Shift],
    sizes: FloatArray,
    count: Progress,
    sensors: Sensors,
) -> Problem:
    """Solution from a start with known shifts, and others that are found."""
    # without the weakly identifiable parameters first: the valley that they open is long and
    # curved
    problem = Problem(segments, start, [name for name in free if name not in _KEPT_FIRST])
    problem.set_shifts(shifts, sizes)
    problem.coloured, problem.lag_s = sensors
    problem.lagged = problem.lag_s > 0.0
    solve(problem, count)
    problem.free = free
    solve(problem, count)
    if problem.coloured and problem.autocorrelation.max() < _COLOURED:
        # a lag or a shift had made the residuals look so
        problem.coloured, problem.autocorrelation = False, np.zeros(len(OUTPUTS))
    _add_shifts(problem, count)
    problem.fixed_walk = False
    solve(problem, count)
    _add_shifts(problem, count)
    return problem


def _add_shifts(problem: Problem, count: Progress) -> None:
    """Add shifts and solve again, until there are no others."""
    while found := find_shifts(problem):
        problem.set_shifts(
            [*problem.shifts, *found], np.append(problem.sizes, np.zeros(len(found)))
        )
        solve(problem, count, _FEW)


def validate(segments: Sequence[Segment], parameters: ModelParameters, lag_s: float = 0.0) -> Fit:
    """How well a model predicts welds: only initial states and constant disturbances are estimated.

    Parameters and return value as of :func:`identify`; ``lag_s`` is that of the thermocouple.
    """
    problem = Problem(segments, parameters, ())
    problem.walk, problem.lag_s = WALK[0], lag_s
    solve(problem, lambda: None)
    return _fit(problem, {}, [])


def expected_deviations(
    segments: Sequence[Segment], parameters: ModelParameters, noise: FloatArray
) -> dict[str, float]:
    """Relative standard deviations to expect of a weld, by the information of the model at ``parameters``.

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
    problem.settle()
    covariance = np.linalg.inv(problem.information())
    return dict(zip(problem.free, map(float, np.sqrt(np.diag(covariance))), strict=False))


def _innovation(noise: FloatArray, autocorrelation: FloatArray) -> FloatArray:
    """Standard deviation of whitened noise from the differences' ``noise`` of :func:`_sensor_noise`."""
    return np.asarray(noise * np.sqrt(1.0 + autocorrelation))


def _sensor_noise(segments: Sequence[Segment]) -> FloatArray:
    """Noise of the sensors from the differences of neighbouring samples."""
    differences = np.concatenate([np.diff(segment.measured, axis=0) for segment in segments])
    spread = np.nanmedian(np.abs(differences), axis=0) / 0.6745 / np.sqrt(2.0)
    return np.asarray(np.maximum(np.nan_to_num(spread), NOISE_FLOOR))


def _select(problem: Problem, kept: dict[str, str], largest: float) -> tuple[str, ...]:
    """The parameters that are identifiable to ``largest``; for the others ``kept`` says why not.

    Of several that are not identifiable together the least important one is kept nominal first.
    """
    whole = problem.information()
    left, others = list(range(len(problem.free))), range(len(problem.free), len(whole))
    order = {name: rank for rank, name in enumerate(_KEPT_FIRST)}
    while True:
        names = [problem.free[i] for i in left]
        if not names or names == [_LEVEL]:
            raise InputError(
                "no parameter can be identified except perhaps the level of the torque: force and speed hardly move; "
                "weld with steps, see --design"
            )
        chosen = np.array([*left, *others])
        covariance = np.linalg.inv(whole[np.ix_(chosen, chosen)])[: len(left), : len(left)]
        deviation = np.sqrt(np.diag(covariance))
        poor = [i for i in range(len(left)) if deviation[i] > largest]
        if not poor:
            return tuple(names)
        worst = min(poor, key=lambda i: (order.get(names[i], len(order)), -deviation[i]))
        size = f"{100 * deviation[worst]:.0f} %" if deviation[worst] < 1.0 else "more than 100 %"
        kept[names[worst]] = f"standard deviation {size}"
        correlation = np.abs(covariance[worst] / deviation / deviation[worst])
        correlation[worst] = 0.0
        if correlation.max() > CORRELATED:
            kept[names[worst]] += f", together with {names[int(correlation.argmax())]}"
        del left[worst]


def _by_kept(problem: Problem, kept: Sequence[str], covariance: FloatArray) -> FloatArray:
    """What errors of parameters that are kept nominal add to the covariance of everything else."""
    n, information = len(problem.free), problem.variant(free=(*problem.free, *kept)).information()
    at = np.arange(n, n + len(kept))
    others = np.delete(np.arange(len(information)), at)
    gain = _KEPT_DEVIATION * covariance @ information[np.ix_(others, at)]
    return np.asarray(gain @ gain.T)


def _by_doubt(problem: Problem) -> FloatArray:
    """Information that free parameters, shifts, share and lag have in common with errors of the same.

    Counts errors that reach the depth through the doubtful part of the temperature; the rest is
    treated as known.
    """
    free, p, parts = (
        len(problem.free),
        problem.parameters,
        problem.linearised(problem.parameters, True),
    )
    n = free + len(problem.shifts) + 2
    found = np.zeros((n, n))
    for depth, temperature in zip(parts[DEPTH::3], parts[TEMPERATURE::3], strict=True):
        if not problem.known[depth.segment].doubtful_c.any():
            continue
        by_rise = (problem.share - 1.0) * problem.by_rise(depth.segment, p)
        at_knots = -problem.eliminated(temperature, problem.walk).values()[:, :, 1 : 1 + free]
        courses = [
            added(temperature.response, temperature.walk, at_knots[:, :, i]) for i in range(free)
        ]
        depth.columns = np.column_stack([depth.columns, *(by_rise * course for course in courses)])
        problem.compress(depth)
        found[:, :free] += problem.eliminated(depth, problem.walk).border[1 : 1 + n, 1 + n :]
    return found


def _fit(problem: Problem, kept: dict[str, str], notes: list[str], rejected: bool = False) -> Fit:
    residuals, whitened = problem.residuals, problem.whitened
    if rejected:
        inside, whitened = (
            [
                np.where(weights > 0.0, one, np.nan)
                for one, weights in zip(every, problem.weights, strict=True)
            ]
            for every in (residuals, whitened)
        )
        count = np.isfinite(np.concatenate(residuals)).sum(axis=0) - np.isfinite(
            np.concatenate(inside)
        ).sum(axis=0)
        notes = notes + [
            f"{name}: {n} samples left out: outliers"
            for name, n in zip(OUTPUTS, count, strict=True)
            if n
        ]
        residuals = inside
    colour = np.array([long_run_factor([one[:, i] for one in whitened]) for i in range(3)])
    robust = np.diag(long_run_covariance(problem))
    wide = problem.variant(noise=problem.noise * np.sqrt(colour))
    covariance = np.asarray(np.linalg.inv(wide.information()), dtype=np.float64)
    # never smaller than by the model: of a short weld the residuals' own is too small by chance
    wider = np.sqrt(np.maximum(1.0, robust / np.diag(covariance)))
    covariance *= np.outer(wider, wider)
    with_doubt = np.eye(len(covariance)) - covariance @ _by_doubt(wide)
    covariance = with_doubt @ covariance @ with_doubt.T
    covariance += _by_kept(wide, [name for name in kept if name not in STRUCTURAL], covariance)
    offset, offset_std = _mean_disturbance(wide, covariance)
    n, std = len(problem.free), np.sqrt(np.diag(covariance))
    sizes = zip(problem.shifts, map(float, problem.sizes), map(float, std[n:-2]), strict=True)
    return Fit(
        parameters=problem.parameters,
        free=problem.free,
        covariance=covariance[:n, :n],
        kept=kept,
        noise=problem.noise / np.sqrt(1.0 - problem.autocorrelation**2),
        correlation_s=correlation_s(problem.autocorrelation),
        colour=colour,
        segments=problem.segments,
        predicted=problem.predicted,
        residuals=residuals,
        whitened=whitened,
        disturbances=problem.disturbances(),
        offset=offset,
        offset_std=offset_std,
        shifts=list(sizes),
        share=(problem.share, float(std[-2])),
        lag_s=(problem.lag_s, float(std[-1])) if problem.lagged else None,
        lag_correlation=covariance[:n, -1] / std[:n] / std[-1],
        heat_and_offset=_heat_and_offset(problem),
        notes=notes,
    )


def _mean_disturbance(problem: Problem, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2,): mean disturbances of force and power, and their standard deviations; ``covariance`` of the border."""
    parts = problem.linearised(problem.parameters, True)
    means, variances, by_border = np.zeros(2), np.zeros(2), np.zeros((2, len(covariance)))
    total = sum(segment.n_ticks for segment in problem.segments)
    for part, one in zip(parts, problem.eliminate(parts, True)[1], strict=True):
        if part.output != TORQUE:
            weights = np.zeros(part.at_knots.shape)
            weights[:, -2] = problem.segments[part.segment].n_ticks / total / len(weights)
            means[part.output] += float((weights * part.at_knots).sum())
            by_border[part.output] -= np.einsum("kp,kpb->b", weights, one.values()[:, :, 1:])
            variances[part.output] += one.variance(weights)
    return means, np.sqrt(variances + np.einsum("ib,bc,ic->i", by_border, covariance, by_border))


def _heat_and_offset(problem: Problem) -> float:
    """Correlation of heat and offset of the temperature: of their mean rises since the beginning."""
    parts = problem.linearised(problem.parameters, False)
    variances = np.zeros(3)
    for part, one in zip(parts, problem.eliminate(parts, False)[1], strict=True):
        if part.output == TEMPERATURE:
            both = np.zeros((2, *one.shape))
            for which, weights in enumerate(both):
                weights[:, which - 2] = 1.0 / len(weights)
                weights[0, which - 2] -= 1.0
            both[0] *= problem.parameters.thermal_gain_c_per_kw
            variances += [one.variance(weights) for weights in (*both, both.sum(axis=0))]
    heat, offset, together = variances
    return float((together - heat - offset) / (2.0 * np.sqrt(heat * offset)))
