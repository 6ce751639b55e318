"""The linearised least-squares problem of :mod:`fsw_identification.estimation`.

Variable projection (Golub and Pereyra 1973): disturbances, initial states and shifts enter
linearly, so they are eliminated exactly for given parameters; Newton steps are taken only in the
few nonlinear parameters (the border).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any, Self, cast

import numpy as np
import scipy

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.elimination import Compressed, Eliminated, compress, eliminate
from fsw_identification.simulation import (
    CANDIDATES,
    DEPENDS,
    DEPTH,
    KNOT_TICKS,
    OF_TEMPERATURE,
    OUTPUTS,
    TEMPERATURE,
    TORQUE,
    Knowledge,
    Response,
    Walks,
    driven,
    heated,
    respond,
    rising,
    shown,
    softened,
    walks,
)
from fsw_identification.statistics import Whitening, whitening
from fsw_identification.weld_data import Segment
from fsw_model import STEP_S, ModelParameters, ParameterCovariance
from fsw_model.equations import power_kw

#: prior standard deviations of the disturbances at the first knot
_OFFSET_PRIOR = np.array([10.0, 20.0, 1e-4, 1e-3, 1e-2])
#: prior standard deviations of shifts of ``OUTPUTS``, and of ``HEAT``
_SHIFT_PRIOR = np.array([1.0, 100.0, 500.0, 100.0])
#: slow disturbances: of force [kN] and power [kW], which act on the process, and of the measured
#: outputs
WALKS = ("force [kN]", "power [kW]", "depth [mm]", "temperature [°C]", "torque [N·m]")
#: by output, the walks of its input and of itself
WALKS_OF = ((0, 2), (1, 3), (4,))
#: prior standard deviations of the states at the first knot, by output; the third one of the
#: temperature is the thermocouple's
STATE_PRIOR = (np.array([500.0, 50.0]), np.array([20.0, 20.0, 20.0]), np.zeros(0))
#: standard deviations per knot of a disturbance and (second row) of its trend: smallest, at the
#: start, largest
WALK = np.array(
    [[1e-3, 1e-3, 2e-5, 1e-3, 1e-2], [0.01, 0.01, 2e-4, 0.01, 0.1], [3.0, 5.0, 0.1, 5.0, 50.0]]
)
WALK = np.stack([WALK, 0.03 * WALK], axis=1)
#: settling time of the outputs at the start of a segment: dead time and tool, motor
_SETTLING_TICKS = (0, 40, 20)
#: lower bound of the noise, so that noise-free data do not get infinite weight
NOISE_FLOOR = np.array([1e-4, 5e-3, 0.1])
#: residuals beyond this many standard deviations are rejected in the final solution
OUTLIER = 5.0
_HUBER = 3.0
#: the part of a torque disturbance that acts on the process but is not measured
HEAT = 3
#: share of a slow temperature disturbance that is real, in the tool, and softens the copper; the
#: rest is the sensor's: prior mean and standard deviation
SHARE, _SHARE_DEVIATION = 0.5, 0.5
#: prior standard deviation of the thermocouple's lag: fixed, estimated [s]
_LAG_PRIOR_S = (1e-6, 5.0)
#: prior of the trend at the first knot, relative to its change per knot
_TREND = 3.0
#: step of the numerical derivatives in the logarithm of a parameter
_SLOPE = 1e-5
#: window for smoothing the measured temperature before it enters the depth
_SMOOTH_TICKS = 21
#: standard deviation of a parameter's relative change from weld to weld of a type (chosen)
STEP = 0.01
#: the same to a weld of another type: wall, rim and lid lead the heat away differently; the
#: machine is the same (chosen)
_TYPE_STEP, _TYPE_STEP_THERMAL = 0.05, 0.2
#: standard deviation of the relative error of what no weld has shown yet
UNSEEN = 0.2
#: prior standard deviation of a logarithm without earlier welds: practically uninformative
_NO_PRIOR = 2.0
#: of the tool where a lag of the thermocouple is estimated, of the thermocouple in model files
_OF_TOOL = ("tool_lag_s", "dead_time_s")


@dataclass(frozen=True)
class Prior:
    """Mean and covariance of the parameters' logarithms; without a mean, no prior.

    The logarithms take a random step from weld to weld, so that the estimates of a series are a
    Kalman filter: each starts from the last one's mean and covariance, widened by that step.
    """

    mean: ModelParameters | None = None
    covariance: FloatArray | None = None  #: in the order of ``CANDIDATES``

    @classmethod
    def of(
        cls, mean: ModelParameters, known: ParameterCovariance, other_type: bool = False
    ) -> Prior:
        """Prior of the next weld, from the estimate of the last one."""
        at = {name: i for i, name in enumerate(CANDIDATES)}
        rows = [i for i, name in enumerate(known.parameters) if name in at]
        seen = [at[known.parameters[i]] for i in rows]
        covariance = np.diag(np.full(len(CANDIDATES), UNSEEN**2))
        covariance[np.ix_(seen, seen)] = known.matrix[np.ix_(rows, rows)]
        steps = [
            (_TYPE_STEP_THERMAL if name in OF_TEMPERATURE[:2] else _TYPE_STEP)
            if other_type
            else STEP
            for name in CANDIDATES
        ]
        return cls(mean, covariance + np.diag(np.square(steps)))

    def covariance_of(self, names: Sequence[str], lagged: bool = False) -> FloatArray:
        """Covariance of these parameters, (n, n); ``lagged``: those of the tool are not known."""
        if self.covariance is None:
            return np.diag(np.full(len(names), _NO_PRIOR**2))
        at = [CANDIDATES.index(name) for name in names]
        covariance = self.covariance[np.ix_(at, at)].copy()
        for i in [i for i, name in enumerate(names) if lagged and name in _OF_TOOL]:
            covariance[i], covariance[:, i] = 0.0, 0.0
            covariance[i, i] = _NO_PRIOR**2
        return covariance

    def lacks(self, p: ModelParameters, names: Sequence[str]) -> FloatArray:
        """What the logarithms of parameters lack of the mean, (n,)."""
        if self.mean is None:
            return np.zeros(len(names))
        return np.array([np.log(getattr(self.mean, name) / getattr(p, name)) for name in names])


@dataclass(frozen=True, slots=True)
class Shift:
    """A sudden, lasting change of an output that the model does not explain."""

    #: its place; ``output`` in the order of ``OUTPUTS``, or ``HEAT``: the heat of a torque shift
    #: beyond what the measured torque gives (negative if the sensor is wrong)
    segment: int
    output: int
    tick: int  #: first shifted row of the segment


@dataclass(slots=True)
class Part:
    """An output of a segment, linearised at some parameters."""

    segment: int
    output: int
    response: Response
    walk: Walks
    columns: FloatArray  #: (n, 1 + border): residuals and slopes
    at_knots: FloatArray  #: (k, p)
    data: Compressed = field(init=False)

    def shown(self) -> FloatArray:
        """Model output without shifts."""
        return shown(self.response, self.walk, self.at_knots)


class Problem:
    """Normal equations of successive linearisations, over all segments of all welds together.

    The border consists of the logarithms of the free parameters, the sizes of the shifts, the
    tool's share in slow temperature disturbances, and the thermocouple's lag. ``free`` are the
    names of the estimated parameters, whose initial values are in ``start``; ``prior`` is what
    earlier welds say of them.
    """

    def __init__(
        self,
        segments: Sequence[Segment],
        start: ModelParameters,
        free: Sequence[str],
        prior: Prior | None = None,
    ) -> None:
        self.parameters, self.free, self.prior = start, tuple(free), prior or Prior()
        #: (3,): standard deviation of each output's whitened residuals
        self.noise = np.array([0.01, 1.0, 10.0])
        #: (3,): autocorrelation of each output's noise from tick to tick
        self.autocorrelation = np.zeros(len(OUTPUTS))
        self.coloured = False  #: whether ``autocorrelation`` is estimated
        #: (2, 5): standard deviation per knot of each of ``WALKS``, and of its trend
        self.walk = WALK[1].copy()
        self.fixed_walk = True  #: whether ``walk`` is kept
        self.shifts: list[Shift] = []
        self.sizes = np.zeros(0)  #: of the shifts
        #: of the thermocouple behind the tool, which softens the copper; 0: none
        self.lag_s = 0.0
        self.lagged = False  #: whether ``lag_s`` is estimated
        self.share = SHARE  #: of the tool in slow temperature disturbances
        self.segments = list(segments)
        self.weights = [
            np.isfinite(_settled(segment.measured)).astype(float) for segment in segments
        ]
        #: (n, 3) by segment, at the last solution
        self.predicted, self.residuals, self.whitened = (
            list[FloatArray](),
            list[FloatArray](),
            list[FloatArray](),
        )
        self.known = [measured(segment, start) for segment in segments]
        self.parts: list[Part] = []

    def variant(self, **attributes: Any) -> Self:
        """Return a shallow copy with other attributes: for a query, or a stage of the solution.

        Only a solution changes a problem: parameters, noise, walks and what it predicts.
        """
        other = copy(self)
        vars(other).update(attributes)
        return other

    def set_shifts(self, shifts: Sequence[Shift], sizes: FloatArray) -> None:
        """Replace all shifts."""
        self.shifts, self.sizes = list(shifts), np.asarray(sizes, dtype=float)

    @property
    def lag_deviation_s(self) -> float:
        """Prior standard deviation of the thermocouple's lag."""
        return _LAG_PRIOR_S[self.lagged]

    @property
    def prior_covariance(self) -> FloatArray:
        """Prior covariance of the free parameters' logarithms, (free, free)."""
        return self.prior.covariance_of(self.free, self.lagged or self.lag_s > 0.0)

    def disturbances(self) -> list[FloatArray]:
        """(n, 5) by segment: time series of ``WALKS``."""
        series = [np.zeros((segment.n_ticks, len(WALKS))) for segment in self.segments]
        for part in self.parts:
            for which, at_knots in zip(
                reversed(WALKS_OF[part.output]), part.at_knots.T[::-1], strict=False
            ):
                series[part.segment][:, which] = _between(at_knots, len(series[part.segment]))
        return series

    def _shift_slopes(
        self, i: int, output: int, p: ModelParameters, real: bool = True
    ) -> FloatArray:
        """Effect of a unit of each shift and of the share on an output, (n, shifts + 1).

        If not ``real``, only the effect on the sensor's reading.
        """
        segment, known = self.segments[i], self.known[i]
        slopes = np.zeros((segment.n_ticks, len(self.shifts) + 1))
        if real and output == DEPTH:
            slopes[:, -1] = self.by_rise(i, p) * known.doubtful_c
        for column, shift in enumerate(self.shifts):
            if shift.segment != i:
                continue
            step = (np.arange(segment.n_ticks) >= shift.tick).astype(float)
            if shift.output == output:
                slopes[:, column] = step
            elif (
                real and shift.output >= TORQUE and output == TEMPERATURE
            ):  # a shift of the torque heats
                power = np.asarray(power_kw(*cast("Any", (step, segment.speed_rpm))))
                slopes[:, column] = heated(p, power, power, self.lag_s)
        return slopes

    def by_rise(self, i: int, p: ModelParameters) -> FloatArray:
        """(n,): sensitivity of the depth to the tool's temperature [mm/°C], by (27)."""
        return p.softening_per_c * self.known[i].depth_mm / softened(p, self.known[i], self.lag_s)

    def _slopes(self, i: int, output: int, at_knots: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of an output by the parameters' logarithms, (n, free), and by the lag, (n,).

        ``at_knots`` are the values at the knots. They are finite differences with the unknowns at
        the knots held fixed, as variable projection requires.
        """
        segment, known, p = self.segments[i], self.known[i], self.parameters

        def at(parameters: ModelParameters, lag_s: float) -> FloatArray:
            response = respond(output, parameters, segment, known, lag_s)
            walk = walks(response)
            return shown(response, walk, driven(walk, at_knots))

        slopes, here = np.zeros((segment.n_ticks, len(self.free))), at(p, self.lag_s)
        by_lag = np.zeros(segment.n_ticks)
        for column, name in enumerate(self.free):
            if name in DEPENDS[output]:
                changed = p.changed(**{name: getattr(p, name) * (1.0 + _SLOPE)})
                slopes[:, column] = (at(changed, self.lag_s) - here) / _SLOPE
        if output == DEPTH:
            by_lag = self.by_rise(i, p) * known.rate_c_per_s
        elif output == TEMPERATURE and self.lag_s > 0.0:
            by_lag = (at(p, self.lag_s * (1.0 + _SLOPE)) - here) / (self.lag_s * _SLOPE)
        return slopes, by_lag

    def linearised(self, p: ModelParameters, slopes: bool) -> list[Part]:
        """All parts: raw residuals, slopes by shifts and, if ``slopes``, by parameters and lag."""
        parts: list[Part] = []
        for i, segment in enumerate(self.segments):
            for output in range(len(OUTPUTS)):
                response = respond(output, p, segment, self.known[i], self.lag_s)
                walk, at_knots = (
                    walks(response),
                    self.parts[len(parts)].at_knots if slopes else np.zeros(0),
                )
                columns = [
                    np.nan_to_num(segment.measured[:, output])[:, None],
                    self._shift_slopes(i, output, p),
                ]
                if slopes:
                    by_free, by_lag = self._slopes(i, output, at_knots)
                    columns = [columns[0], by_free, columns[1], by_lag[:, None]]
                columns[0] = columns[0] - (response.factor * response.course)[:, None]
                part = Part(i, output, response, walk, np.hstack(columns), at_knots)
                self.compress(part)
                parts.append(part)
        return parts

    def whitening(self, i: int, output: int) -> Whitening:
        """Whitening of an output of a segment."""
        return whitening(
            np.isfinite(_settled(self.segments[i].measured)[:, output]),
            float(self.autocorrelation[output]),
        )

    def compress(self, part: Part) -> None:
        """Compress a part's rows with the present noise and weights."""
        white, weights = (
            self.whitening(part.segment, part.output),
            self.weights[part.segment][:, part.output],
        )
        part.data = compress(part.walk, part.response.factor, part.columns, weights, white)

    def eliminate(
        self, parts: Sequence[Part], slopes: bool, sizes: FloatArray | None = None
    ) -> tuple[FloatArray, list[Eliminated]]:
        """Information of residuals and border, with prior, without knots; the eliminated parts."""
        walk, eliminated = self.walk if sizes is None else sizes, []
        of_shifts = _SHIFT_PRIOR[[shift.output for shift in self.shifts]] ** -2.0
        of_free = [0.0] * (len(self.free) if slopes else 0)
        of_lag = [self.lag_deviation_s**-2.0] * slopes
        border = np.diag([0.0, *of_free, *of_shifts, _SHARE_DEVIATION**-2.0, *of_lag])
        if slopes:  # the prior's mean is a measurement of the parameters
            measured = np.column_stack(
                [self.prior.lacks(self.parameters, self.free), np.eye(len(self.free))]
            )
            n = len(self.free) + 1
            border[:n, :n] += measured.T @ np.linalg.solve(self.prior_covariance, measured)
        for part in parts:
            eliminated.append(self.eliminated(part, walk))
            border += eliminated[-1].border
        return border, eliminated

    def eliminated(self, part: Part, walk: FloatArray) -> Eliminated:
        """Eliminate the knots of a part, for given sizes of the walks."""
        which, states = (
            list(WALKS_OF[part.output]),
            STATE_PRIOR[part.output][: part.response.gains.size],
        )
        start = np.concatenate([states, _TREND * walk[1, which], _OFFSET_PRIOR[which]])
        steps = np.concatenate([np.zeros(states.size), walk[1, which], walk[0, which]])
        return eliminate(part.data, part.walk, float(self.noise[part.output]), start, steps)

    def profile(self, p: ModelParameters) -> tuple[float, list[Part], FloatArray]:
        """Cost at parameters with optimal knots, shifts and share; also those two."""
        parts = self.linearised(p, False)
        border, eliminated = self.eliminate(parts, False)
        # The border's optimum follows from the Schur complement: minimise the quadratic form
        # [1, -s] border [1, -s]' over s.
        sizes = np.asarray(np.linalg.solve(border[1:, 1:], border[1:, 0]), dtype=np.float64)
        for part, unknowns in zip(parts, eliminated, strict=True):
            values = unknowns.values()
            part.at_knots = values[:, :, 0] - values[:, :, 1:] @ sizes
        lacks = self.prior.lacks(p, self.free)
        cost = border[0, 0] - border[1:, 0] @ sizes
        cost += lacks @ np.linalg.solve(self.prior_covariance, lacks)
        return float(cost), parts, sizes

    def settle(self) -> None:
        """Update knots, shifts and share at the present parameters, and the links between outputs.

        The depth equation uses the smoothed measured temperature; the model's would carry its own
        errors into it.
        """
        _, self.parts, sizes = self.profile(self.parameters)
        self.sizes, self.share = sizes[:-1], SHARE + float(sizes[-1])
        self.predicted, self.residuals, self.whitened = [], [], []
        for i, segment in enumerate(self.segments):
            parts, p = self.parts[3 * i : 3 * i + 3], self.parameters
            shifts, of_sensor = (
                np.column_stack(
                    [self._shift_slopes(i, output, p, real) @ sizes for output in range(3)]
                )
                for real in (True, False)
            )
            self.predicted.append(np.column_stack([part.shown() for part in parts]) + shifts)
            self.residuals.append(_settled(segment.measured) - self.predicted[-1])
            self.whitened.append(np.column_stack([self._white(i, output) for output in range(3)]))
            slow = np.column_stack(
                [_between(part.at_knots[:, -1], segment.n_ticks) for part in parts]
            )
            seen = (
                np.where(np.isfinite(segment.measured), segment.measured, self.predicted[-1])
                - of_sensor
            )
            depth = self.predicted[-1] - of_sensor if not self.fixed_walk else _smooth(seen)
            doubtful = self.known[i].doubtful_c
            rate = _rate(seen[:, TEMPERATURE])
            if not self.fixed_walk:
                # by the model, whose states are known only once the temperature is used
                model_rate = rising(
                    p, segment, self.known[i], self.lag_s, parts[TEMPERATURE].at_knots
                )
                model_rate += _rate((shifts - of_sensor)[:, TEMPERATURE])
                rate[_SETTLING_TICKS[TEMPERATURE] :] = model_rate[_SETTLING_TICKS[TEMPERATURE] :]
            rise = (
                _smooth(seen)[:, TEMPERATURE]
                - (1.0 - SHARE) * doubtful
                - p.operating_temperature_c
            )
            self.known[i] = Knowledge(
                rise, (depth - slow)[:, DEPTH], slow[:, TORQUE], doubtful, rate
            )

    def information(self) -> FloatArray:
        """Information of free parameters, shifts and share, from data and prior."""
        return self.eliminate(self.linearised(self.parameters, True), True)[0][1:, 1:]

    def _white(self, i: int, output: int) -> FloatArray:
        """Whitened residuals."""
        return self.whitening(i, output).of(self.residuals[i][:, output])

    def take_noise(self, output: int) -> None:
        """Estimate an output's noise from its whitened residuals, without outliers."""
        whitened = np.concatenate([self._white(i, output) for i in range(len(self.segments))])
        self.noise[output] = max(_spread(whitened), NOISE_FLOOR[output])

    def estimate_noise(self, reject: bool) -> None:
        """Estimate the noise and weight the samples: outliers count less (Huber), or not."""
        for output in range(len(OUTPUTS)):
            self.take_noise(output)
        for i, whitened in enumerate(self.whitened):
            size = np.abs(np.nan_to_num(whitened / self.noise, nan=np.inf))
            huber = np.where(
                np.isfinite(size), np.minimum(1.0, _HUBER / np.maximum(size, 1e-9)), 0.0
            )
            self.weights[i] = np.where(size < OUTLIER, 1.0, 0.0) if reject else huber


def _spread(values: FloatArray) -> float:
    """Standard deviation without outliers (median absolute deviation, then trimmed)."""
    known = values[np.isfinite(values)]
    spread = float(np.median(np.abs(known))) / 0.6745 if known.size else 0.0
    good = known[np.abs(known) < OUTLIER * spread]
    return float(np.sqrt(np.mean(good**2))) if good.size else spread


def _between(at_knots: FloatArray, n: int) -> FloatArray:
    """Linear interpolation between knots."""
    return np.interp(np.arange(n), KNOT_TICKS * np.arange(len(at_knots)), at_knots)


def _settled(measured: FloatArray) -> FloatArray:
    """Mask the first samples that depend on the unknown past power or torque."""
    settled = measured.copy()
    for output, ticks in enumerate(_SETTLING_TICKS):
        settled[:ticks, output] = np.nan
    return settled


def measured(segment: Segment, p: ModelParameters) -> Knowledge:
    """Depth and temperature as measured, smoothed."""
    shown = []
    for column, usual in zip(
        segment.measured.T, (p.operating_depth_mm, p.operating_temperature_c), strict=False
    ):
        known = np.flatnonzero(np.isfinite(column))
        filled = (
            np.interp(np.arange(column.size), known, column[known])
            if known.size
            else np.full(column.size, usual)
        )
        shown.append(_smooth(filled))
    none = np.zeros(segment.n_ticks)
    return Knowledge(
        shown[TEMPERATURE] - p.operating_temperature_c, shown[DEPTH], none, none, _rate(filled)
    )


def _rate(values: FloatArray) -> FloatArray:
    """Smoothed derivative per second (Savitzky-Golay)."""
    return np.asarray(scipy.signal.savgol_filter(values, _SMOOTH_TICKS, 2, deriv=1, delta=STEP_S))


def _smooth(values: FloatArray) -> FloatArray:
    return np.asarray(scipy.signal.savgol_filter(values, _SMOOTH_TICKS, 2, axis=0))
