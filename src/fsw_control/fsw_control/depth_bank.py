"""A bank of Kalman filters for the depth: with all channels, without each, without each pair.

The states are depth, its rate, thermal growth per power that has soaked in, of each channel the
error of its deflection and its bias, and the heights of edges of the surface. If a channel turns
out to be wrong, the filters that never used it replace all others, so that neither this fault
nor another one found later stays in the estimates. (Multiple models: Bar-Shalom, Li,
Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 11.6.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from fsw_control.depth_channels import DepthChannel, DepthFusionSettings
from fsw_control.weld import TICK_S

Array = NDArray[np.float64]
DEPTH, RATE, GROWTH, FIRST = range(4)
#: edges of the surface that may be near the tool at a time (``depth_edges.py``)
EDGES = 2
#: weights of a tick in means over 1 s, 3 s and 5 s
SECOND, THREE_SECONDS, FIVE_SECONDS = TICK_S / 1.0, TICK_S / 3.0, TICK_S / 5.0
#: lengths of ticks for which the steps are kept
_MOST_STEPS = 100
#: variance of the depth before the first sample [mm2]
_START_MM2 = 1.0


def averaged(weight: float) -> float:
    """Variance of an exponential mean of white noise, in that of a sample."""
    return weight / (2.0 - weight)


class DepthBank:
    """Filters by index: 0 uses all channels, i + 1 all but channel i, the last all but two.

    With two channels no pair can be left out; with a single channel only filter 0 exists.

    ``x`` and ``p`` are their states and covariances.
    """

    def __init__(
        self, settings: DepthFusionSettings, channels: Mapping[str, DepthChannel]
    ) -> None:
        rows = tuple(channels.values())
        self.settings, self.count = settings, len(rows)
        self.noise = np.array([row.noise_mm**2 for row in rows])
        self.prior = np.array([row.bias_deviation_mm**2 for row in rows])
        self._wander = np.array([2.0 * row.wander_mm**2 / row.wander_s for row in rows])
        self.most_left_out = min(2, self.count - 1)  #: channels that a filter is without
        #: by filter, the channels that it leaves out
        sizes = range(self.most_left_out + 1)
        some = chain.from_iterable(combinations(range(self.count), size) for size in sizes)
        self._left_out = list(map(frozenset, some))
        filters = len(self._left_out)
        size = FIRST + 2 * self.count + EDGES
        deflection = np.array([row.deflection_deviation_mm_per_kn**2 for row in rows])
        self._deflections = np.arange(FIRST, FIRST + self.count)
        self._biases = self._deflections + self.count
        self._edges = np.arange(size - EDGES, size)
        self.edge_shares = np.zeros((self.count, EDGES))  #: of each edge in each channel
        growth = settings.growth_deviation_mm_per_kw**2
        start = [_START_MM2, settings.rate_mm_per_s**2, growth, *deflection, *self.prior]
        #: means and variances of the states as they are without any sample; edges and wander too
        self._mean, self._variance = np.zeros(size), np.array(start + [0.0] * EDGES)
        self._mean[GROWTH] = settings.growth_mm_per_kw
        self.x, self.p = np.zeros((filters, size)), np.zeros((filters, size, size))
        self._h = np.zeros((self.count, size))
        self._h[:, DEPTH] = 1.0
        self._shares = np.array([row.growth_share for row in rows])
        self.soaked_kw = 0.0  #: power since the calibration, through the lag of the growth
        self._diagonal = np.arange(self.count)
        self._h[self._diagonal, self._biases] = 1.0
        #: by filter and channel, 1 where the filter uses it
        self.takes = np.array(
            [[float(i not in some) for i in range(self.count)] for some in self._left_out]
        )
        self._steps: dict[float, tuple[Array, Array]] = {}
        self._masks: dict[bytes, tuple[Array, Array, Array]] = {}
        self._weighed: bytes | None = None  #: channels for which ``_inverse`` is made
        self._inverse: Array = np.empty(0)

    def start(self, depth_mm: float) -> None:
        """Begin at a depth, which samples correct; known edges remain, and what has soaked in.

        This also removes faults of several channels, which every filter has used in part.
        """
        edges, variances = self.x[0, self._edges], np.diagonal(self.p[0])[self._edges].copy()
        self.x[:], self.p[:] = self._mean, np.diag(self._variance)
        self.x[:, DEPTH], self.x[:, self._edges] = depth_mm, edges
        self.p[:, self._edges, self._edges] = variances

    def predict(self, elapsed_s: float, power_kw: float) -> None:
        """Advance all filters; the power soaks in, if it is known."""
        settings, key = self.settings, round(elapsed_s, 3)
        step = self._steps.get(key)
        if step is None:
            if len(self._steps) > _MOST_STEPS:
                self._steps.clear()
            step = self._steps[key] = self._step(key)
        f, q = step
        self.x = self.x @ f.T
        self.p = f @ self.p @ f.T
        self.p += q
        self._variance[self._biases] += self._wander * elapsed_s
        if math.isfinite(power_kw):
            beyond = power_kw - settings.calibration_power_kw - self.soaked_kw
            self.soaked_kw += beyond * (1.0 - math.exp(-elapsed_s / settings.growth_s))

    def _step(self, elapsed_s: float) -> tuple[Array, Array]:
        settings, size = self.settings, self.x.shape[1]
        kept = math.exp(-elapsed_s / settings.rate_s)
        f = np.eye(size)
        f[DEPTH, RATE], f[RATE, RATE] = settings.rate_s * (1.0 - kept), kept
        q = np.zeros(size)
        q[RATE] = settings.rate_mm_per_s**2 * (1.0 - kept**2)
        q[self._biases] = self._wander * elapsed_s
        return f, np.diag(q)

    def innovate(self, values_mm: Array, pushed_kn: float) -> None:
        """Compare with the samples; NaN marks a missing one, with innovation 0.

        Sets ``z`` (filters, channels), the innovations, and ``s``, their covariances without
        noise.
        """
        self._h[self._diagonal, self._deflections] = pushed_kn
        self._h[:, GROWTH] = self._shares * self.soaked_kw
        self._h[:, self._edges] = self.edge_shares
        self._weighed = None
        self._ph = self.p @ self._h.T
        self.s = self._h @ self._ph
        self.z = values_mm - self.x @ self._h.T
        self.z[np.isnan(self.z)] = 0.0

    def weigh(self, used: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Inverse covariances of the innovations, of samples and of means over a second.

        Returns
        -------
        inverses : (2, filters, channels, channels) array
            1 and 0 in rows and columns of channels that a filter does not use.
        taken : (filters, channels) array
            1 where a filter uses a channel, else 0.
        """
        key = used.tobytes()
        if key not in self._masks:
            taken = self.takes * used
            noise = np.stack((self.noise, self.noise * averaged(SECOND)))[:, None]
            added = (taken * noise + (1.0 - taken))[..., None] * np.eye(self.count)
            self._masks[key] = taken, taken[:, :, None] * taken[:, None, :], added
        taken, both, added = self._masks[key]
        if self._weighed != key:
            self._weighed = key
            self._inverse = np.asarray(np.linalg.inv(self.s * both + added), np.float64)
        return self._inverse, taken

    def correct(self, used: NDArray[np.bool_]) -> None:
        """Correct all filters by the channels in use, each without the one it leaves out."""
        inverses, taken = self.weigh(used)
        ph = self._ph * taken[:, None, :]
        gain = ph @ inverses[0]
        self.x += (gain @ self.z[:, :, None])[:, :, 0]
        self.p -= gain @ ph.transpose(0, 2, 1)
        self.p += self.p.transpose(0, 2, 1)  # rounding must not make it asymmetric
        self.p *= 0.5

    def loosen(self, variance_mm2: float) -> None:
        """Let the depth move by more than its rate explains, if all channels show it."""
        self.p[:, DEPTH, DEPTH] += variance_mm2
        self._ph[:, DEPTH] += variance_mm2
        self._weighed = None
        self.s += variance_mm2

    def edge_mm(self, slot: int) -> float:
        """Height of an edge."""
        return float(self.x[0, self._edges[slot]])

    def begin_edge(self, slot: int, height_mm: float, deviation_mm: float) -> None:
        """Add an edge of about this height."""
        self._clear_edge(slot)
        state = self._edges[slot]
        self.x[:, state], self.p[:, state, state] = height_mm, deviation_mm**2

    def end_edge(self, slot: int) -> None:
        """Remove an edge that has passed; its remainder in a channel becomes bias."""
        fold, state = np.eye(self.x.shape[1]), self._edges[slot]
        shares = fold[self._biases, state] = self.edge_shares[:, slot]
        self._mean[self._biases] += shares * self.x[0, state]
        self._variance[self._biases] += shares**2 * self.p[0, state, state]
        self.x, self.p = self.x @ fold.T, fold @ self.p @ fold.T
        self._clear_edge(slot)

    def _clear_edge(self, slot: int) -> None:
        state = self._edges[slot]
        self.x[:, state] = self.p[:, state] = self.p[:, :, state] = 0.0
        self.edge_shares[:, slot] = 0.0

    def doubt(self, channel: int, step_mm: float) -> None:
        """Let the bias of a channel be uncertain as after touch-off: it has changed.

        To the filters without the channel it is still the prior, and the step.
        """
        state = self._biases[channel]
        uses = self.takes[:, channel] > 0.0
        self.p[:, state, state] += np.where(uses, self.prior[channel], step_mm**2)

    def trust(self, left_out: int) -> None:
        """Continue with the filters that leave out a channel; they replace the others.

        No filter leaves out three: the filter that has used the third takes over and knows it by
        its prior only.
        """
        if len(self.x) == 1:
            return
        sources = []
        for some in self._left_out:
            without = some | {left_out}
            if without not in self._left_out:
                without = frozenset({left_out, min(some)} if len(some) > 1 else {left_out})
            sources.append(self._left_out.index(without))
        self.x, self.p = self.x[sources], self.p[sources]
        for row, (some, source) in enumerate(zip(self._left_out, sources, strict=True)):
            for channel in some - self._left_out[source]:
                state = self._biases[channel]
                self.p[row, state, state] += self.prior[channel]
