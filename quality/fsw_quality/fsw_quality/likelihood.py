"""Generalised likelihood ratios of faults, by a Kalman filter of what a healthy weld may do.

A healthy weld differs from the model by coefficients that are known to their covariance only, and
by disturbances: these are the states of the filter (nuisance parameters), so that what they
explain is no fault. Each fault has a signature in the residuals from its onset on. Passed through
the filter, it leaves a trace in the innovations; the likelihood ratio is that of the innovations
with and without it, at the most likely size and onset (Willsky and Jones, IEEE Trans. Autom.
Control 21, 1976, 108-112; Gertler, Fault Detection and Diagnosis in Engineering Systems, 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import exp, sqrt
from pathlib import Path

import numpy as np

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_control.weld import SPEED_RPM
from fsw_model import ModelParameters, ParameterCovariance, equations
from fsw_quality.residuals import COEFFICIENTS, DEPTH, HEAT, TORQUE

#: states behind the coefficients and the probe's lag: swing of the torque, which may be the
#: sensor's, sway of the process and its level [N m]; offset of the depth, edges of the workpiece
#: [mm], force that is missing [kN], coloured noise of the depth [mm];
#: temperature that the power does not explain [degC], its level at rest [degC] and the slope of
#: that [degC/s], coloured noise of the temperature [degC]. Behind them a filter has the swings of
#: the seconds before, until they reach the thermocouple
_STATES = (
    "swing",
    "sway",
    "level",
    "offset",
    "edge",
    "force",
    "depth_noise",
    "warmth",
    "rest",
    "slope",
    "heat_noise",
)
_N = len(COEFFICIENTS) + 1
SWING, SWAY, LEVEL, OFFSET, EDGE, FORCE, DEPTH_NOISE, WARMTH, REST, SLOPE, HEAT_NOISE = range(
    _N, _N + len(_STATES)
)
N_STATES = _N + len(_STATES)
#: standard deviations of the states at the begin of a weld, beside the coefficients' (chosen,
#: wide)
_BEGIN = {
    SWING: 5.0,
    SWAY: 2.0,
    LEVEL: 30.0,
    OFFSET: 0.02,
    FORCE: 0.5,
    DEPTH_NOISE: 0.002,
    WARMTH: 1.0,
    REST: 100.0,
    SLOPE: 0.02,
}
#: correlation times of swing and coloured noises that are tried [s] (chosen)
_CORRELATED_S = {
    SWING: (1.5, 5.0, 1.5, 5.0),
    DEPTH_NOISE: (1.0, 2.0, 4.0, 6.0),
    HEAT_NOISE: (1.0, 2.0, 4.0, 6.0),
}
#: correlation time of the sway [s], and its sizes that are tried with those times of the swing, as
#: factors on the least (chosen)
_SWAY_S, _SWAYS = 15.0, (1.0, 1.0, 5.0, 5.0)
#: what the states do in a second (standard deviation of a walk; of a coloured noise, its own):
#: least, chosen
_LEAST = {
    SWING: 0.3,
    SWAY: 0.4,
    LEVEL: 0.06,
    FORCE: 0.001,
    DEPTH_NOISE: 1e-4,
    WARMTH: 0.02,
    REST: 0.03,
    SLOPE: 1e-4,
    HEAT_NOISE: 0.01,
}
#: an edge of the workpiece shifts the depth by about so much [mm]; from so many standard errors on
#: (chosen)
_EDGE_MM, _EDGE = 0.05, 4.5
#: walk of the coefficients of heat and depth, the first eight, in a second, in their standard
#: deviations: it covers what the sensitivities, which are linear, leave over, and copper that is
#: not the same everywhere (chosen)
_WALK = 0.02
#: level at rest of the temperature on a canister, whose heat is unknown [degC] in a second
#: (chosen)
_UNKNOWN_HEAT = 3.0
#: for each residual, the coloured state whose size and time are learnt
_LEARNT = {TORQUE: SWING, DEPTH: DEPTH_NOISE, HEAT: HEAT_NOISE}
#: factors on the sizes that are tried (chosen)
_FACTORS = 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0, 96.0
_TRIED = list(product(range(4), _FACTORS))
#: digits of the warmth by a N m, much less than its least walk, and most seconds that it is late
#: (chosen)
_DIGITS, _MOST_LATE_S = 3, 20
#: share of what is taken for a sway that may be slow noise of the torque sensor all the same
#: (chosen)
_SENSORS = 0.5
#: a larger size is taken if the loss of log likelihood is not more than this (chosen)
_NEARLY = 1.0
#: innovations that are larger than expected count less: time over which they are observed [s],
#: largest that counts
_OBSERVED_S, _CLIP = 60.0, 9.0
#: what an identified coefficient differs by from weld to weld, relative (chosen)
_FROM_WELD_TO_WELD = 0.02
#: relative standard deviation of a coefficient that nobody identified: of plants within 10 %; of
#: the tool's lag, which stands for the probe's, too; lag of the probe [s] (chosen)
_UNIDENTIFIED, _TOOL_LAG, _PROBE_S = 0.07, 1.2, 1.5


_WALKING = np.isin([*COEFFICIENTS, "probe"], COEFFICIENTS[:8])


def default_covariance() -> FloatArray:
    """Covariance of the coefficients, relative, and the probe's lag.

    Wide enough for a model within 10 %.
    """
    sigma = np.array(
        [_TOOL_LAG if name == "tool_lag_s" else _UNIDENTIFIED for name in COEFFICIENTS]
        + [_PROBE_S]
    )
    return np.diag(sigma**2)


def covariance_from(file: str | Path) -> FloatArray | None:
    """The default covariance with that of identified parameters put in; None without a file.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the file cannot be read or is no covariance.
    """
    if not str(file):
        return None
    known, covariance = ParameterCovariance.from_file(file), default_covariance()
    pairs = [
        (i, COEFFICIENTS.index(name))
        for i, name in enumerate(known.parameters)
        if name in COEFFICIENTS
    ]
    rows, places = [i for i, _ in pairs], [place for _, place in pairs]
    covariance[np.ix_(places, places)] = known.matrix[
        np.ix_(rows, rows)
    ] + _FROM_WELD_TO_WELD**2 * np.eye(len(rows))
    return covariance


@dataclass(slots=True)
class Second:
    """Residuals of a second (NaN: withheld), sensitivities, variance of their white noise."""

    residuals: FloatArray  #: (3,)
    sensitivities: FloatArray  #: (3, coefficients and the probe's lag)
    variances: FloatArray  #: (3,)
    nm_per_mm: float  #: of the torque, by the depth that the tool has sunk
    #: variance that the states gain in this second, because the model moves inexactly, by state
    moves: dict[int, float]


@dataclass(slots=True)
class Sizes:
    """Factors on the least disturbances, and correlation times [s] of coloured ones, by state."""

    factors: FloatArray
    times_s: dict[int, float]


def _tried(choices: dict[int, tuple[int, float]]) -> Sizes:
    """Sizes by residual: which time, and the factor."""
    sizes = Sizes(np.ones(N_STATES), {})
    for residual, (which, factor) in choices.items():
        state = _LEARNT[residual]
        sizes.factors[state], sizes.times_s[state] = factor, _CORRELATED_S[state][which]
    sizes.times_s[SWAY], sizes.factors[SWAY] = _SWAY_S, _SWAYS[choices[TORQUE][0]]
    return sizes


def _likeliest(lost: FloatArray) -> tuple[int, float]:
    """The likeliest time, and the largest factor with it that is nearly as likely."""
    which = _TRIED[int(np.argmin(lost))][0]
    likely = lost <= lost.min() + 2.0 * _NEARLY
    return which, max(_TRIED[i][1] for i in np.flatnonzero(likely) if _TRIED[i][0] == which)


def warmth_of(parameters: ModelParameters) -> tuple[float, int]:
    """Warming of the model's tool in a second per N m of torque [degC], and its delay [s].

    Power is computed from the measured torque, so that a swing, which may be the sensor's noise,
    heats the model and not the workpiece. The filter knows the swing by the torque, and takes its
    heat out once the dead time and the tool's lag are over.
    """
    follow = 1.0 - exp(-1.0 / parameters.copper_lag_s)
    gain = parameters.thermal_gain_c_per_kw * float(equations.power_kw(1.0, SPEED_RPM))
    late_s = round(parameters.dead_time_s + parameters.tool_lag_s)
    return round(gain * follow, _DIGITS), min(late_s, _MOST_LATE_S)


class Filter:
    """Kalman filters of healthy welds, several that differ in the sizes of the disturbances."""

    def __init__(
        self,
        parameters: ModelParameters,
        covariance: FloatArray,
        known_heat: bool,
        tried: Sequence[Sizes],
    ) -> None:
        self._warmth_per_nm, late = warmth_of(parameters)
        n, self.n_states = len(tried), N_STATES + late
        swings = [SWING, *range(N_STATES, self.n_states)]
        shape = n, self.n_states, self.n_states
        self._step, self._fresh = np.tile(np.eye(self.n_states), (n, 1, 1)), np.zeros(shape)
        follow = 1.0 - exp(-1.0 / parameters.copper_lag_s)
        self._step[:, WARMTH, [WARMTH, REST]] = 1.0 - follow, follow
        self._step[:, REST, SLOPE] = 1.0
        self._step[:, swings[1:], swings[1:]] = 0.0
        self._step[:, swings[1:], swings[:-1]] = 1.0
        self._step[:, WARMTH, swings[-1]] = -self._warmth_per_nm
        self._step[:, OFFSET, FORCE] = parameters.depth_gain_mm_per_kn_s
        walk = np.zeros(self.n_states)
        walk[list(_LEAST)] = list(_LEAST.values())
        walk[:_N] = _WALK * np.sqrt(np.diag(covariance)) * _WALKING
        if not known_heat:
            walk[REST] = _UNKNOWN_HEAT
        for sizes, step, fresh in zip(tried, self._step, self._fresh, strict=True):
            kept, factors = np.zeros(self.n_states), np.ones(self.n_states)
            factors[:N_STATES] = sizes.factors
            factors[WARMTH] *= self._warmer(sizes)
            for state, time_s in sizes.times_s.items():
                kept[state] = step[state, state] = exp(-1.0 / time_s)
            np.fill_diagonal(fresh, (walk * factors) ** 2 * (1.0 - kept**2))
        begin = np.zeros(shape[1:])
        begin[:_N, :_N] = covariance
        for state, size in _BEGIN.items():
            begin[state, state] = size**2
        self.x, self.p = np.zeros(shape[:2]), np.repeat(begin[None], n, axis=0)

    def _warmer(self, sizes: Sizes) -> float:
        """Factor on the walk of the warmth by the sway, which may be the torque sensor's noise."""
        sensors_nm = _SENSORS * sizes.factors[SWAY] * _LEAST[SWAY]
        warmth_c = self._warmth_per_nm * sensors_nm * sqrt(2.0 * max(_CORRELATED_S[SWING]))
        return sqrt(1.0 + (warmth_c / _LEAST[WARMTH]) ** 2)

    def step(self, second: Second, traces: Traces | None = None) -> FloatArray:
        """Take a second.

        Returns twice the loss of log likelihood, by residual and filter, shape (3, filters).
        """
        self.x = np.einsum("nij,nj->ni", self._step, self.x)
        self.p = self._step @ self.p @ self._step.transpose(0, 2, 1) + self._fresh
        for state, variance in second.moves.items():
            self.p[:, state, state] += variance
        self.p[:, WARMTH, WARMTH] += self._warmth_per_nm**2 * second.variances[TORQUE]
        if traces is not None:
            traces.effect = np.tensordot(self._step[0], traces.effect, 1)
        lost, self.edges_mm = np.zeros((3, len(self.x))), np.zeros(len(self.x))
        for i in (DEPTH, TORQUE, HEAT):  # an edge shows in the depth
            if not np.isfinite(second.residuals[i]):
                continue
            row = _row(i, second, self.n_states)
            gain = self.p @ row
            variance = np.maximum(gain @ row, 0.0) + second.variances[i]
            innovation = second.residuals[i] - self.x @ row
            if i == DEPTH and (edge := innovation**2 > _EDGE**2 * variance).any():
                self.p[edge, EDGE, EDGE] += _EDGE_MM**2
                self.edges_mm = np.where(edge, innovation, 0.0)
                gain = self.p @ row
                variance = np.maximum(gain @ row, 0.0) + second.variances[i]
            gain /= variance[:, None]
            lost[i] = innovation**2 / variance + np.log(variance)
            self.x += gain * innovation[:, None]
            # Joseph's form, which keeps the covariance positive
            left = np.eye(self.n_states) - gain[:, :, None] * row
            noise = second.variances[i] * gain[:, :, None] * gain[:, None, :]
            self.p = left @ self.p @ left.transpose(0, 2, 1) + noise
            if traces is not None:
                traces.take(i, row, gain[0], float(innovation[0]), float(variance[0]))
        return lost


def _row(residual: int, second: Second, n_states: int) -> FloatArray:
    row = np.zeros(n_states)
    row[:_N] = second.sensitivities[residual]
    states = {
        TORQUE: (SWING, SWAY, LEVEL),
        DEPTH: (OFFSET, EDGE, DEPTH_NOISE),
        HEAT: (WARMTH, HEAT_NOISE),
    }
    row[list(states[residual])] = 1.0
    if residual == TORQUE:  # an edge is not what the tool stirs
        row[EDGE] = -second.nm_per_mm
    return row


class Traces:
    """Traces of faults in the innovations of one filter, by onset and fault."""

    def __init__(self, states: int, onsets: int, faults: int) -> None:
        self.effect = np.zeros((states, onsets, faults))
        self.product, self.power = np.zeros((onsets, faults)), np.zeros((onsets, faults))
        self.signatures = np.zeros((3, onsets, faults))
        self._excess = [1.0] * 3  # running mean of the squared innovations over their variance

    def begin(self, onset: int) -> None:
        """Faults begin now in a place, whose former ones are forgotten."""
        self.effect[:, onset] = self.product[onset] = self.power[onset] = 0.0

    def take(
        self, residual: int, row: FloatArray, gain: FloatArray, innovation: float, variance: float
    ) -> None:
        """Take an innovation."""
        trace = self.signatures[residual] - np.tensordot(row, self.effect, 1)
        self.effect += gain[:, None, None] * trace
        counted = variance * max(1.0, self._excess[residual])
        self.product += trace * innovation / counted
        self.power += trace * trace / counted
        excess = min(innovation**2 / variance, _CLIP)
        self._excess[residual] += (excess - self._excess[residual]) / _OBSERVED_S

    def sizes(self) -> tuple[FloatArray, FloatArray]:
        """Most likely sizes and their standard errors, shape (onsets, faults).

        Without information 0 and infinity.
        """
        known = self.power > 1e-12
        power = np.where(known, self.power, 1.0)
        return np.where(known, self.product / power, 0.0), np.where(
            known, 1.0 / np.sqrt(power), np.inf
        )

    def ratios(self, sizes: FloatArray) -> FloatArray:
        """Log likelihood ratios of faults of these sizes to none, shape (onsets, faults)."""
        return sizes * self.product - 0.5 * sizes**2 * self.power

    def averages(self, expected: FloatArray, possible: IntArray) -> tuple[FloatArray, FloatArray]:
        """Sizes and standard errors with the onset unknown, shape (faults,).

        Mean and deviation over all onsets.

        The size at the likeliest onset is too large, because that onset is chosen by it. So each
        of the ``possible`` onsets, shape (onsets,), counts by its likelihood, with sizes normally
        distributed about 0 by ``expected`` (Bayesian model averaging; Hoeting et al., Statistical
        Science 14, 1999, 382-417).
        """
        precision = self.power[possible] + 1.0 / expected**2
        means = self.product[possible] / precision
        weights = 0.5 * (self.product[possible] * means - np.log(precision))
        weights = np.exp(weights - weights.max(axis=0))
        weights /= weights.sum(axis=0)
        mean = (weights * means).sum(axis=0)
        return mean, np.sqrt((weights * (1.0 / precision + (means - mean) ** 2)).sum(axis=0))


class Healthy:
    """The filter of a weld.

    It learns how large the disturbances are, then takes the weld from its begin.
    """

    def __init__(
        self, parameters: ModelParameters, covariance: FloatArray, known_heat: bool
    ) -> None:
        self._arguments = parameters, covariance, known_heat
        self._seconds: list[Second] = []
        self._filter = Filter(
            *self._arguments, [_tried(dict.fromkeys(_LEARNT, value)) for value in _TRIED]
        )
        self._lost = np.zeros((3, len(_TRIED)))
        self.n_states = self._filter.n_states
        self._torque = np.zeros(self.n_states)
        self.learnt: Sizes | None = None  #: sizes of the disturbances, once they are known

    def step(self, second: Second, traces: Traces | None = None) -> float:
        """Take a second.

        Returns by how much an edge of the workpiece has moved the depth [mm], mostly 0.
        """
        if np.isfinite(second.residuals[TORQUE]):
            self._torque = _row(TORQUE, second, self.n_states)
            self._torque[[SWING, SWAY, EDGE]] = 0.0
        if self.learnt is None:  # the seconds are taken again later, so that their zero must stay
            self._seconds.append(second)
            self._lost += self._filter.step(second)
            return 0.0
        self._filter.step(second, traces)
        edge_mm = float(self._filter.edges_mm[0])
        self._filter.x[:, EDGE] -= edge_mm
        return edge_mm

    @property
    def _best(self) -> int:
        """The likeliest filter."""
        return 0 if self.learnt is not None else int(np.argmin(self._lost.sum(axis=0)))

    def learn(self) -> None:
        """Take the sizes of the disturbances that are most likely, of each residual its own."""
        for second in self._seconds:
            second.variances = self._seconds[-1].variances
        choices = {residual: _likeliest(lost) for residual, lost in enumerate(self._lost)}
        # the likeliest noise of the heat depends on the torque's: try it again with that
        again = Filter(*self._arguments, [_tried(choices | {HEAT: value}) for value in _TRIED])
        choices[HEAT] = _likeliest(sum(again.step(second)[HEAT] for second in self._seconds))
        self.learnt = _tried(choices)
        self._filter = Filter(*self._arguments, [self.learnt])
        for second in self._seconds:
            self._filter.step(second)
        self._seconds.clear()

    def doubt(self, residual: int) -> None:
        """A residual was withheld: its disturbances are unknown again."""
        sizes = {
            TORQUE: {SWING: 20.0},
            DEPTH: {OFFSET: 0.5, FORCE: 0.5},
            HEAT: {WARMTH: 20.0, REST: 20.0},
        }[residual]
        for state, size in sizes.items():
            self._filter.p[:, state, state] += size**2

    def gains(self, process_nm: float) -> dict[str, tuple[float, float]]:
        """Gains relative to the model's, each with its standard error.

        ``process_nm`` is the model's torque.
        """
        x, p, sizes = self._filter.x[self._best], self._filter.p[self._best], {}
        rows = {"torque": self._torque / process_nm if process_nm else 0.0 * self._torque}
        for name, coefficient in (
            ("depth", "depth_gain_mm_per_kn_s"),
            ("heat", "thermal_gain_c_per_kw"),
        ):
            rows[name] = np.eye(self.n_states)[COEFFICIENTS.index(coefficient)]
        for name, row in rows.items():
            sizes[name] = 1.0 + float(row @ x), sqrt(max(float(row @ p @ row), 0.0))
        return sizes

    @property
    def disturbances(self) -> tuple[float, float, float]:
        """Torque [N m], force [kN], temperature [degC] that the model does not explain."""
        torque, force, heat = self._filter.x[self._best, [LEVEL, FORCE, WARMTH]]
        return float(torque), float(force), float(heat)
