"""Maximum-likelihood estimate of model parameters, initial states and slow disturbances.

The recorded inputs of welds drive the model; the residuals are sensor noise (output error method,
Ljung 1999, chapter 7). Inputs are those that acted, so a closed loop does not bias the estimate.
Unknown slow disturbances of force, heat and outputs are random walks whose size maximises the
evidence (marginal likelihood); sudden shifts of an output are found in the residuals and estimated
jointly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.schema.models import InputError
from fsw_identification.disturbed import (
    disturbed_windows,
    drop_small_shifts,
    find_shifts,
    leave_out,
)
from fsw_identification.evidence import evidence, likely_colour, likely_lag, long_run_covariance
from fsw_identification.problem import NOISE_FLOOR, UNSEEN, WALK, Prior, Problem, Shift
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
from fsw_identification.statistics import CORRELATED, WHITE_S, correlation_s, long_run_factor
from fsw_identification.weld_data import Segment
from fsw_model import ModelParameters

#: a parameter with a larger relative standard deviation counts as not identifiable
LARGEST_DEVIATION = 0.25
#: the same at the nominal parameters, before anything is known
_LARGEST_AT_START = 0.3
#: never estimated: (19)-(22) have six coefficients for three observable quantities
STRUCTURAL = ("geometry_factor", "contact_radius_m", "geometry_offset_m3")
_WHY_STRUCTURAL = (
    "(19)-(22) have six coefficients, welds identify three: "
    "the torque, its slope over force and over depth"
)
#: identifiable even at rest if the other torque parameters are nominal
_LEVEL = "sliding_friction"
#: kept nominal first if several are not identifiable together
_KEPT_FIRST = ("sticking_stress_pa", "contact_slope")
#: up to this share of disturbed windows the start is good, and the rest is a disturbance
_SHARE_OF_DISTURBANCE = 0.25
#: residual autocorrelation of an output, from tick to tick, above which coloured noise is tried
_COLOURED = 0.2
#: a thermocouple lag of more standard deviations is tried; number of such reviews of the sensors
_LAGS, _LOOKS = 5.0, 2
#: iterations between two searches for shifts
_FEW = 6
#: residuals within this factor of the noise between neighbouring samples count as noise alone
_AS_GOOD = 1.1
#: factors on the starting values, tried in sequence
_STARTS: tuple[dict[str, float], ...] = (
    {},
    {"dead_time_s": 0.7, "tool_lag_s": 1.5, "copper_lag_s": 0.8, "depth_gain_mm_per_kn_s": 1.3},
    {"dead_time_s": 1.3, "tool_lag_s": 0.7, "copper_lag_s": 1.3, "depth_gain_mm_per_kn_s": 0.8},
)

Progress = Callable[[], None]
#: coloured noise or not, and the thermocouple's lag [s]
Sensors = tuple[bool, float]


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate."""

    parameters: ModelParameters  #: parameters that were not estimated keep their given values
    free: tuple[str, ...]  #: names of the estimated parameters
    #: (n, n): of the logarithms of the estimated parameters, i.e. of their relative errors
    covariance: FloatArray
    kept: dict[str, str]  #: by name, why a candidate was kept nominal
    #: (3,): standard deviations of the outputs' noise in the order of ``OUTPUTS``
    noise: FloatArray
    #: (3,): correlation time of the noise (decay to 1/e), 0: white
    correlation_s: FloatArray
    #: (3,): variance of a mean of the whitened residuals relative to white noise; 1: white
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
    #: tool's share in slow temperature disturbances, and its standard deviation; the rest is the
    #: sensor's
    share: tuple[float, float]
    #: thermocouple lag and its standard deviation; None if the data do not show one
    lag_s: tuple[float, float] | None
    lag_correlation: FloatArray  #: (n,): of its estimate with those of the parameters
    heat_and_offset: float  #: correlation of slow heat and offset of the temperature
    notes: list[str]  #: exclusions, one line each
    #: by parameter, how far the data move it from its prior, in the prior's standard deviations
    moved: dict[str, float]

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
        """Lag of the thermocouple; 0 if the data do not show one."""
        return 0.0 if self.lag_s is None else self.lag_s[0]

    @property
    def shown(self) -> ModelParameters:
        """Parameters as seen by a controller: of the thermocouple's reading, with its lag."""
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
    prior: Prior | None = None,
) -> Fit:
    """Estimate the identifiable parameters of the model.

    Parameters
    ----------
    segments : sequence of Segment
        Segments of one or more welds of one process.
    start : ModelParameters, optional
        Initial values, by default the paper's; parameters that are not identifiable keep them.
    progress : callable, optional
        Called with the completed share.
    steady : bool
        Assume constant disturbances, without drifts and shifts, so that slow effects are
        attributed to the process.
    prior : Prior, optional
        What earlier welds say of the parameters, by default nothing.

    Raises
    ------
    InputError
        If no parameter is identifiable, or the computation fails.
    """
    iterations = 0

    def count() -> None:
        nonlocal iterations
        iterations += 1
        if progress is not None:
            # the number of iterations is not known in advance
            progress(1.0 - np.exp(-iterations / 30.0))

    try:
        return _identify(segments, start or ModelParameters(), count, steady, prior or Prior())
    except InputError as error:
        if not error.problems:  # else a parameter is outside its range
            raise
        raise InputError(
            f"no process in the model's range fits ({error}); are the units of the log right?"
        ) from None
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"the estimate broke down ({error}); start nearer to the process (--model), "
            "or weld a designed experiment, see --design"
        ) from error


def _identify(
    segments: Sequence[Segment],
    start: ModelParameters,
    count: Progress,
    steady: bool,
    prior: Prior,
) -> Fit:
    kept: dict[str, str] = {}
    # Stages: candidates by their expected deviation, starts, sensors (noise colour, lag) by the
    # evidence, removal of parameters that turn out not identifiable, disturbed windows, outliers.
    first = Problem(segments, start, CANDIDATES, prior)
    first.noise = _sensor_noise(segments)
    first.settle()
    free = _select(first, kept, _LARGEST_AT_START)
    best = _best_start(start, first, free, count, steady)
    # A wrong noise model biases the residuals from which the right one is read, hence more than
    # one look; the richer sensor model stays only if the evidence is better.
    for _ in range(0 if steady else _LOOKS):
        sensors = _sensors(best)
        if sensors == (best.coloured, best.lag_s):
            break
        best = min(
            best,
            _best_start(start, first, free, count, False, sensors),
            key=evidence,
        )
    # At the solution the deviations may be larger than expected at the start: what the data do not
    # determine goes back to its nominal value, and the others are estimated without it.
    while (left := _select(best, kept, LARGEST_DEVIATION)) != best.free:
        nominal = {name: getattr(start, name) for name in best.free if name not in left}
        best.parameters, best.free = best.parameters.changed(**nominal), left
        solve(best, count)
    # differences show the noise itself; of coloured noise the whitened part is larger
    notes = leave_out(best, first.noise * np.sqrt(1.0 + best.autocorrelation), count)
    drop_small_shifts(best)
    solve(best, count, reject=True)
    if steady:
        notes += [
            f"{name}: residuals are correlated over {over_s:.2g} s; "
            "--steady takes noise for white, and enlarges the standard deviations instead"
            for name, over_s in zip(OUTPUTS, correlation_s(likely_colour(best)), strict=True)
            if over_s > WHITE_S
        ]
    return _fit(best, kept | dict.fromkeys(STRUCTURAL, _WHY_STRUCTURAL), notes, rejected=True)


def _sensors(problem: Problem) -> Sensors:
    """Noise colour and thermocouple lag suggested by a solution."""
    coloured = problem.coloured or bool(likely_colour(problem).max() > _COLOURED)
    if problem.lagged:
        return coloured, problem.lag_s
    lag_s, deviation_s = likely_lag(problem)
    return coloured, lag_s if lag_s > _LAGS * deviation_s else 0.0


def _best_start(
    start: ModelParameters,
    first: Problem,
    free: tuple[str, ...],
    count: Progress,
    steady: bool,
    sensors: Sensors = (False, 0.0),
) -> Problem:
    """Best solution of a problem by evidence from several starts, as many as needed."""
    best: Problem | None = None
    for factors in _STARTS:
        scaled = start.scaled(**{name: factor for name, factor in factors.items() if name in free})
        if steady:
            solved = _solve_steady(scaled, first, free, count)
        else:
            solved = _solve_twice(scaled, first, free, count, sensors)
        if best is None or evidence(solved) < evidence(best):
            best = solved
        # Noise between neighbouring samples is a lower bound that no model can beat; residuals
        # close to it leave nothing for another start to find.
        alone = first.noise * np.sqrt(1.0 + solved.autocorrelation)
        share = np.concatenate([disturbed_windows(row, alone) for row in solved.whitened]).mean(
            axis=0
        )
        if (solved.noise < _AS_GOOD * alone).all() or (share < _SHARE_OF_DISTURBANCE).all():
            # the rest is sensor noise or a disturbance: no start can improve on that
            break
    assert best is not None
    return best


def _solve_steady(
    start: ModelParameters, first: Problem, free: tuple[str, ...], count: Progress
) -> Problem:
    """Solve with disturbances that hardly change, and without shifts."""
    problem = Problem(
        first.segments, start, [name for name in free if name not in _KEPT_FIRST], first.prior
    )
    problem = problem.variant(walk=WALK[0])
    solve(problem, count)
    problem = problem.variant(free=free)
    solve(problem, count)
    return problem


def _solve_twice(
    start: ModelParameters,
    first: Problem,
    free: tuple[str, ...],
    count: Progress,
    sensors: Sensors,
) -> Problem:
    """Solve with shifts and slow disturbances.

    Shifts are found in the residuals of a model that they have biased; the solution is therefore
    repeated from the start with these shifts.
    """
    problem = _solve(start, first, free, [], np.zeros(0), count, sensors)
    if not problem.shifts:
        return problem
    again = _solve(start, first, free, problem.shifts, problem.sizes, count, sensors)
    # by the evidence (as minus twice its logarithm), since both have different numbers of shifts
    return min(problem, again, key=evidence)


def _solve(
    start: ModelParameters,
    first: Problem,
    free: tuple[str, ...],
    shifts: Sequence[Shift],
    sizes: FloatArray,
    count: Progress,
    sensors: Sensors,
) -> Problem:
    """Solve with known shifts, and search for others."""
    # first without the weakly identifiable parameters, which open a long and curved valley
    problem = Problem(
        first.segments, start, [name for name in free if name not in _KEPT_FIRST], first.prior
    )
    coloured, lag_s = sensors
    problem = problem.variant(coloured=coloured, lag_s=lag_s, lagged=lag_s > 0.0)
    problem.set_shifts(shifts, sizes)
    solve(problem, count)
    # Walks keep their starting size until the shifts are known: a larger walk would follow a
    # jump and hide it.
    problem = problem.variant(free=free)
    solve(problem, count)
    if problem.coloured and problem.autocorrelation.max() < _COLOURED:
        # a lag or a shift had coloured the residuals
        problem = problem.variant(coloured=False, autocorrelation=np.zeros(len(OUTPUTS)))
    _add_shifts(problem, count)
    problem = problem.variant(fixed_walk=False)
    solve(problem, count)
    _add_shifts(problem, count)
    return problem


def _add_shifts(problem: Problem, count: Progress) -> None:
    """Add shifts and solve again until no more are found."""
    while shifts := find_shifts(problem):
        problem.set_shifts(
            [*problem.shifts, *shifts], np.append(problem.sizes, np.zeros(len(shifts)))
        )
        solve(problem, count, _FEW)


def validate(segments: Sequence[Segment], parameters: ModelParameters, lag_s: float = 0.0) -> Fit:
    """Assess a model on welds: only initial states and constant disturbances are estimated.

    Parameters and return value as in :func:`identify`; ``lag_s`` is the thermocouple's lag.
    """
    problem = Problem(segments, parameters, ()).variant(walk=WALK[0], lag_s=lag_s)
    solve(problem, lambda: None)
    return _fit(problem, {}, [])


def expected_deviations(
    segments: Sequence[Segment], parameters: ModelParameters, noise: FloatArray
) -> dict[str, float]:
    """Relative standard deviations to expect from a weld, by the Fisher information.

    Parameters
    ----------
    segments : sequence of Segment
        Of a simulated weld.
    parameters : ModelParameters
    noise : (3,) array
        Standard deviations of the sensors in the order of ``OUTPUTS``.
    """
    problem = Problem(segments, parameters, CANDIDATES).variant(noise=noise, walk=WALK[0])
    problem.settle()
    covariance = np.linalg.inv(problem.information())
    return dict(zip(problem.free, map(float, np.sqrt(np.diag(covariance))), strict=False))


def _sensor_noise(segments: Sequence[Segment]) -> FloatArray:
    """Noise of the sensors from the differences of neighbouring samples."""
    # Within a tick the process hardly moves, so a difference is that of two noise samples
    # (variance doubled). The median (0.6745 of sigma for a normal distribution) ignores jumps.
    differences = np.concatenate([np.diff(segment.measured, axis=0) for segment in segments])
    spread = np.nanmedian(np.abs(differences), axis=0) / 0.6745 / np.sqrt(2.0)
    return np.asarray(np.maximum(np.nan_to_num(spread), NOISE_FLOOR))


def _select(problem: Problem, kept: dict[str, str], largest: float) -> tuple[str, ...]:
    """Parameters that are identifiable to ``largest``; ``kept`` gets the reason for the others.

    Of several that are not identifiable together, the least important one is kept nominal first.
    """
    whole = problem.information()
    left, others = list(range(len(problem.free))), range(len(problem.free), len(whole))
    order = {name: rank for rank, name in enumerate(_KEPT_FIRST)}
    while True:
        names = [problem.free[i] for i in left]
        if not names or names == [_LEVEL]:
            raise InputError(
                "no parameter can be identified except perhaps the level of the torque: "
                "force and speed hardly move; "
                "weld with steps, see --design"
            )
        chosen = np.array([*left, *others])
        covariance = np.linalg.inv(whole[np.ix_(chosen, chosen)])[: len(left), : len(left)]
        deviation = np.sqrt(np.diag(covariance))
        # One at a time, since removing a parameter makes those correlated with it identifiable.
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
    """Covariance added to everything else by errors of parameters that are kept nominal."""
    n, information = len(problem.free), problem.variant(free=(*problem.free, *kept)).information()
    at = np.arange(n, n + len(kept))
    others = np.delete(np.arange(len(information)), at)
    # First-order propagation: an error d of a kept parameter moves the estimate by
    # covariance @ information[others, kept] d.
    gain = UNSEEN * covariance @ information[np.ix_(others, at)]
    return np.asarray(gain @ gain.T)


def _by_doubt(problem: Problem) -> FloatArray:
    """Information shared by free parameters, shifts, share and lag with their own errors.

    It accounts for errors that reach the depth through the doubtful part of the temperature; the
    rest is treated as known.
    """
    free, p, parts = (
        len(problem.free),
        problem.parameters,
        problem.linearised(problem.parameters, True),
    )
    n = free + len(problem.shifts) + 2
    shared = np.zeros((n, n))
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
        shared[:, :free] += problem.eliminated(depth, problem.walk).border[1 : 1 + n, 1 + n :]
    return shared


def _fit(problem: Problem, kept: dict[str, str], notes: list[str], rejected: bool = False) -> Fit:
    residuals, whitened = problem.residuals, problem.whitened
    if rejected:
        inside, whitened = (
            [
                np.where(weights > 0.0, values, np.nan)
                for values, weights in zip(every, problem.weights, strict=True)
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
    # Three corrections of the model's covariance: coloured residuals (as more noise), the sandwich
    # estimate where it is larger, and errors shared through doubtful temperatures or kept values.
    colour = np.array([long_run_factor([row[:, i] for row in whitened]) for i in range(3)])
    robust = np.diag(long_run_covariance(problem))
    wide = problem.variant(noise=problem.noise * np.sqrt(colour))
    covariance = np.asarray(np.linalg.inv(wide.information()), dtype=np.float64)
    # never smaller than by the model: residuals of a short weld underestimate it by chance
    wider = np.sqrt(np.maximum(1.0, robust / np.diag(covariance)))
    covariance *= np.outer(wider, wider)
    # errors of the free parameters also move the doubtful part of the temperature, and through it
    # the depth: the estimate's reaction to its own error, to first order
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
        moved=_moved(problem),
    )


def _moved(problem: Problem) -> dict[str, float]:
    """How far the data move each parameter from its prior; empty without one."""
    if problem.prior.mean is None:
        return {}
    # The update's variance is at most the prior's, and less than it by an estimate that the
    # corrections above enlarge: the prior's is the one that raises no false alarms.
    expected = np.sqrt(np.diag(problem.prior_covariance))
    sizes = np.abs(problem.prior.lacks(problem.parameters, problem.free)) / expected
    return dict(zip(problem.free, map(float, sizes), strict=True))


def _mean_disturbance(problem: Problem, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2,): mean disturbances of force and power, and their standard deviations."""
    parts = problem.linearised(problem.parameters, True)
    means, variances, by_border = np.zeros(2), np.zeros(2), np.zeros((2, len(covariance)))
    total = sum(segment.n_ticks for segment in problem.segments)
    for part, unknowns in zip(parts, problem.eliminate(parts, True)[1], strict=True):
        if part.output != TORQUE:
            weights = np.zeros(part.at_knots.shape)
            weights[:, -2] = problem.segments[part.segment].n_ticks / total / len(weights)
            means[part.output] += float((weights * part.at_knots).sum())
            by_border[part.output] -= np.einsum("kp,kpb->b", weights, unknowns.values()[:, :, 1:])
            variances[part.output] += unknowns.variance(weights)
    return means, np.sqrt(variances + np.einsum("ib,bc,ic->i", by_border, covariance, by_border))


def _heat_and_offset(problem: Problem) -> float:
    """Correlation of the mean rises of heat and temperature offset since the beginning."""
    parts = problem.linearised(problem.parameters, False)
    variances = np.zeros(3)
    for part, unknowns in zip(parts, problem.eliminate(parts, False)[1], strict=True):
        if part.output == TEMPERATURE:
            both = np.zeros((2, *unknowns.shape))
            for which, weights in enumerate(both):
                weights[:, which - 2] = 1.0 / len(weights)
                weights[0, which - 2] -= 1.0
            both[0] *= problem.parameters.thermal_gain_c_per_kw
            variances += [unknowns.variance(weights) for weights in (*both, both.sum(axis=0))]
    heat, offset, together = variances
    return float((together - heat - offset) / (2.0 * np.sqrt(heat * offset)))
