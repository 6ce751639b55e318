"""Edges of the surface, which pass below leading sensors, tool and trailing sensors in turn.

A sensor that rides on the surface, ``lead`` ahead of the tool at x, shows depth + s(x + lead) -
s(x), where s is the height of the surface; one of the machine's position shows depth - s(x). s is
modelled as piecewise constant: each known edge has its height as a state of the filters, whose
share in a channel is 1 once the edge has reached the channel, less 1 once it has reached the tool.

A step of a leading sensor may be an edge or a slip. It is an edge if the next sensor, or all
others when the tool is there, step by as much at the known distance. If a sensor ahead did not
step there, or the next one does not, it is called a slip. But that sensor may have slipped by as
much and so hidden the edge: only the tool decides finally. Height and place are those at the
begin of the step, as a channel that shows an edge may slip before it is decided.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw_control.depth_bank import EDGES, SECOND, Array, DepthBank, averaged
from fsw_control.depth_channels import DepthChannel

Mask = NDArray[np.bool_]
#: how far from where it is expected an edge may reach a sensor: of a jump, of one found by means
TOLERANCE_MM, SLOW_TOLERANCE_MM = 2.0, 6.0
#: log-likelihood ratios from which an edge has reached a channel: a pending one, where a sample
#: counts as no more than its share, and a known one
_CONFIRMED, _SHARE, _ARRIVED = 24.0, 3.0, 8.0
#: within which what another channel shows must agree with an edge's height: share of it, distance
#: [mm], and noise
_ALIKE, _ALIKE_MM, _DEVIATIONS = 0.5, 0.02, 4.0
#: deviation of a jump of all channels [mm], and of a median, in that of a mean
_JUMP_MM, _MEDIAN = 0.005, 1.25
#: ratio of heights up to which a channel that is wrong again shows the same step
_SAME = 3.0
#: steps from this height on are seen by a channel of which the filters are sure enough [mm], and
#: deviations that they must exceed
_SEEN_MM, _SEEN_DEVIATIONS = 0.05, 6.0
#: mean squared innovation over a second, in variances, below which a channel has not moved, and
#: the largest that counts
_STILL, _CLIPPED = 4.0, 16.0
#: samples of which the height of a pending step is the median: the first of a jump, as its channel
#: may slip later; the last of a step found by means, as it may still grow
_SAMPLES = 15
#: samples of which its first height is the mean, about
_BEGUN = 5
#: standard deviation of an edge's height when it is first taken into the filters; larger if found
#: by means before the tool: the filters have forgotten the bias of its channel then [mm]
_HEIGHT_MM, _SLOW_HEIGHT_MM = 0.005, 0.02


@dataclass(slots=True)
class _Edge:
    """An edge at a place of the tool's path, or a step that may be one."""

    place_mm: float
    tolerance_mm: float
    heights_mm: deque[float]  #: as the first channel showed it; of a known one the filters know it
    passed: Mask  #: by channel, and of the tool at last, whether the edge has reached it
    in_bias: Mask  #: by channel, whether its bias has held the edge since the filters began
    score: Array  #: by channel, cumulative sum of log-likelihood ratios that it has
    squares: Array  #: by channel, mean squared innovation over a second, in variances
    #: by channel, samples since the score has risen, and their mean [mm]
    count: Array
    mean_mm: Array
    noise_mm: float  #: of the channel that has stepped
    is_slip: bool = False  #: a pending one, as far as the channels can say
    slot: int = -1  #: state of the filters; -1: not confirmed

    @property
    def height_mm(self) -> float:
        """Height of a pending step."""
        return float(np.median(self.heights_mm))

    @property
    def deviation_mm(self) -> float:
        """Standard deviation of that."""
        return _MEDIAN * self.noise_mm / math.sqrt(len(self.heights_mm))

    def tolerance_of(self, error_mm: Array | float) -> Array:
        """Distance from the height within which a measurement with this deviation agrees."""
        deviation_mm = np.hypot(self.deviation_mm, error_mm)
        allowed_mm = np.maximum(_ALIKE_MM, _DEVIATIONS * deviation_mm)
        return np.asarray(np.minimum(allowed_mm, _ALIKE * abs(self.height_mm)))

    @property
    def is_slow(self) -> bool:
        """Whether it was found by means, not by a jump."""
        return self.tolerance_mm == SLOW_TOLERANCE_MM


class _Wrong(NamedTuple):
    """Where a channel was wrong by a height, with short gaps, and how wrong last [mm]."""

    since_mm: float
    until_mm: float
    height_mm: float


class SurfaceEdges:
    """Known edges near the tool, and steps that may be others."""

    def __init__(self, channels: Mapping[str, DepthChannel]) -> None:
        rows = channels.values()
        #: of each channel and of the tool; one that does not ride on the surface meets no edge
        self._leads = np.array([*(row.lead_mm if row.rides else -math.inf for row in rows), 0.0])
        self._noise = np.array([row.noise_mm for row in rows])
        self.travel_mm, self._moves = math.nan, False
        #: place from which on each channel has watched the surface without a gap
        self._watched_mm = np.full(len(self._noise), math.inf)
        #: by channel, where it was wrong by a height
        self._wrong: list[list[_Wrong]] = [[] for _ in self._noise]
        self._known: list[_Edge] = []
        self._pending: dict[int, _Edge] = {}  #: by the channel that has stepped
        self._known_at_tool = False  #: whether a known edge has reached the tool in this tick

    def move(self, travel_mm: float) -> None:
        """Take the distance that the tool has travelled along its path; NaN: unknown."""
        self._moves = travel_mm > self.travel_mm
        self.travel_mm = travel_mm

    def note_wrong(self, channel: int, height_mm: float) -> None:
        """Note that a channel is wrong by a height at this tick: its step may have begun here.

        Spikes of another height before a step are not its beginning.
        """
        here_mm = self.travel_mm
        near = [span for span in self._wrong[channel] if here_mm - span.until_mm < TOLERANCE_MM]
        heights = [(span, span.height_mm) for span in near]
        same = [span for span, h in heights if height_mm * h > max(height_mm**2, h**2) / _SAME]
        now = _Wrong(same[0].since_mm if same else here_mm, here_mm, height_mm)
        self._wrong[channel] = [*(span for span in near if span not in same), now]

    def suspect(self, channel: int, height_mm: float, usable: Mask, slow: bool) -> bool:
        """Whether a step of a channel may be an edge: no other has watched the place before.

        A jump is kept in any case until the tool is there: the other may have slipped by as much.
        A step found by means is not kept: at the tool, noise would look like a small edge.
        """
        lead = self._leads[channel]
        place_mm = self._wrong[channel][-1].since_mm + lead
        tolerance_mm = SLOW_TOLERANCE_MM if slow else TOLERANCE_MM
        further = self._leads[:-1] > lead
        has_watched = self._watched_mm < place_mm - tolerance_mm
        ahead = usable & further & has_watched
        is_seen = bool(ahead.any())
        if not (self._moves and lead > 0.0 and len(self._known) < EDGES) or (slow and is_seen):
            return False
        count = len(self._noise)
        self._pending[channel] = _Edge(
            place_mm,
            tolerance_mm,
            deque([height_mm] * _BEGUN, _SAMPLES),
            self._leads >= lead,
            further & ~has_watched,
            score=np.zeros(count),
            squares=np.ones(count),
            count=np.zeros(count),
            mean_mm=np.zeros(count),
            noise_mm=float(self._noise[channel]),
            is_slip=is_seen,
        )
        return not is_seen

    def expects(self, channel: int) -> bool:
        """Whether a pending step may now have reached a channel."""
        return any(self._is_near(edge)[channel] for edge in self._pending.values())

    def is_pending(self, channel: int) -> bool:
        """Whether a channel has stepped and the cause is still undecided."""
        return channel in self._pending

    def shown_mm(self, z: Array) -> Array:
        """By channel, the height of a pending step that it may just show as an edge, else 0."""
        heights_mm = np.zeros(len(z))
        for edge in self._pending.values():
            shown = z * np.sign(edge.height_mm) > _ALIKE * abs(edge.height_mm)
            shown &= self._is_near(edge)[:-1] & self._is_alike(z, edge.height_mm)
            heights_mm[shown] = edge.height_mm
        return heights_mm

    def review(
        self, bank: DepthBank, values: Array, usable: Mask, clear: Mask
    ) -> tuple[list[int], list[int]]:
        """The channels whose pending steps are edges after all, and those where they are slips.

        ``clear`` are the usable channels that are no noisier than expected.
        """
        edges: list[int] = []
        slips: list[int] = []
        z = bank.z[0]
        # all channels follow a change of the depth within a tick: only that tick shows it
        jump_mm = math.nan if self._known_at_tool else _jump_mm(z, usable)
        # the best first: another that is not alike stays, and has missed the tool
        for channel, edge in sorted(
            self._pending.items(), key=lambda item: abs(item[1].height_mm - jump_mm)
        ):
            if channel not in self._pending:  # the same edge as another
                continue
            self._observe(edge, channel, z, values, usable, clear)
            apart_mm, is_free = abs(jump_mm - edge.height_mm), len(self._known) < EDGES
            at_tool = self._is_near(edge)[-1] and apart_mm < edge.tolerance_of(_JUMP_MM)
            reached = -1 if at_tool else self._confirming(edge)
            if is_free and reached is not None:
                height_mm = jump_mm if at_tool else edge.height_mm
                edges += self._accept(channel, reached, height_mm, bank)
                continue
            is_over = not self._beyond(edge)[-1] <= edge.tolerance_mm  # also if it is unknown
            is_slip = is_over or self._has_missed(edge, z, clear)
            if is_over or (is_slip and edge.is_slow):
                del self._pending[channel]
            if is_slip and not edge.is_slip:
                edge.is_slip = True
                slips.append(channel)
        return edges, slips

    def _observe(
        self, edge: _Edge, channel: int, z: Array, values: Array, usable: Mask, clear: Mask
    ) -> None:
        """Update a pending step of a channel with the samples of a tick."""
        moved_mm = abs(z[channel] - edge.height_mm)
        # if it is called a slip, the filters have been replaced, which know less of its bias
        is_first = len(edge.heights_mm) < _SAMPLES and not edge.is_slip
        is_first &= bool(moved_mm < _DEVIATIONS * self._noise[channel])
        if (edge.is_slow or is_first) and not math.isnan(values[channel]):
            edge.heights_mm.append(float(z[channel]))
        square = np.where(usable, np.minimum((z / self._noise) ** 2, _CLIPPED), edge.squares)
        edge.squares += (square - edge.squares) * SECOND
        gain = np.minimum(self._gain(z, edge.height_mm), _SHARE)
        gain = np.where(self._is_alike(z, edge.height_mm), gain, -_SHARE)
        near = self._is_near(edge)[:-1] & clear
        edge.score = np.where(near, np.maximum(edge.score + gain, 0.0), 0.0)
        edge.count = np.where(edge.score > 0.0, edge.count + 1.0, 0.0)
        edge.mean_mm += np.where(near, (z - edge.mean_mm) / np.maximum(edge.count, 1.0), 0.0)

    def _confirming(self, edge: _Edge) -> int | None:
        """The channel that a pending step has reached next, by its samples and their mean."""
        error_mm = self._noise / np.sqrt(np.maximum(edge.count, 1.0))
        alike = abs(edge.mean_mm - edge.height_mm) < edge.tolerance_of(error_mm)
        score = np.where(alike, edge.score, 0.0)
        return int(np.argmax(score)) if score.max() >= _CONFIRMED else None

    def drop(self, channel: int) -> None:
        """Forget the pending step of a channel, which is back where it was."""
        self._pending.pop(channel, None)

    def arrive(self, bank: DepthBank, usable: Mask) -> bool:
        """Note what the known edges have reached; returns whether the shares have changed.

        The places are known to within the tolerance; there the samples decide.
        """
        z, changed, self._known_at_tool = bank.z[0], False, False
        self._watch(bank, usable)
        for edge in list(self._known):
            height_mm = bank.edge_mm(edge.slot)
            near, beyond = self._is_near(edge), self._beyond(edge) > edge.tolerance_mm
            gain = np.where(near[:-1] & usable, self._gain(z, height_mm), 0.0)
            edge.score = np.maximum(edge.score + gain, 0.0) * near[:-1]
            at_tool = abs(_jump_mm(z, usable) - height_mm) < _ALIKE * abs(height_mm)
            now = ~edge.passed & (beyond | (near & np.append(edge.score >= _ARRIVED, at_tool)))
            if now.any():
                changed = True
                self._known_at_tool |= bool(now[-1])
                edge.passed |= now
                self._share(edge, bank)
            if edge.passed[np.isfinite(self._leads)].all():
                bank.end_edge(edge.slot)
                self._known.remove(edge)
        return changed

    def _watch(self, bank: DepthBank, usable: Mask) -> None:
        """Note where each channel began to see steps: not while its bias is not known yet."""
        variance = np.diagonal(bank.s[0]) + self._noise**2 * averaged(SECOND)
        sees = usable & (variance * _SEEN_DEVIATIONS**2 < _SEEN_MM**2)
        here_mm = self.travel_mm + self._leads[:-1]
        sees &= self._watched_mm <= here_mm
        self._watched_mm = np.where(sees, self._watched_mm, here_mm)

    def _accept(self, channel: int, reached: int, height_mm: float, bank: DepthBank) -> list[int]:
        """Make a pending step an edge that has also reached another channel, or the tool.

        Returns the channels that have shown it.
        """
        edge = self._pending.pop(channel)
        edge.slot = min(set(range(EDGES)) - {known.slot for known in self._known})
        edge.passed |= self._leads >= self._leads[reached]
        self._known.append(edge)
        deviation_mm = _SLOW_HEIGHT_MM if edge.is_slow and reached >= 0 else _HEIGHT_MM
        bank.begin_edge(edge.slot, height_mm, deviation_mm)
        self._share(edge, bank)
        same = [
            other
            for other, step in self._pending.items()
            if abs(step.place_mm - edge.place_mm) <= edge.tolerance_mm + step.tolerance_mm
            and abs(step.height_mm - edge.height_mm) < edge.tolerance_of(step.deviation_mm)
        ]
        for other in same:
            del self._pending[other]
        return [channel, *same]

    def _beyond(self, edge: _Edge) -> Array:
        """How far each channel, and the tool, is past the place of an edge."""
        return np.asarray(self.travel_mm + self._leads - edge.place_mm)

    def _is_near(self, edge: _Edge) -> Mask:
        """Channels, and the tool, that the edge may reach now."""
        return ~edge.passed & (abs(self._beyond(edge)) <= edge.tolerance_mm)

    def _has_missed(self, edge: _Edge, z: Array, clear: Mask) -> bool:
        """Whether a channel is past the place of an edge without showing it.

        A channel that moved by another height does not count: either may have slipped.
        """
        is_still = (edge.squares < _STILL) & (abs(z) < _ALIKE * abs(edge.height_mm))
        due = clear & is_still & (~edge.passed & (self._leads >= 0.0))[:-1]
        return bool((due & (self._beyond(edge)[:-1] > edge.tolerance_mm)).any())

    def _gain(self, z: Array, height_mm: float) -> Array:
        """Log-likelihood ratio that channels show the edge, of a sample."""
        return np.asarray(height_mm * (z - 0.5 * height_mm) / self._noise**2)

    def _is_alike(self, z: Array, height_mm: float) -> Mask:
        near_mm = np.maximum(_ALIKE * abs(height_mm), _DEVIATIONS * self._noise)
        return np.asarray(abs(z - height_mm) < near_mm)

    @staticmethod
    def _share(edge: _Edge, bank: DepthBank) -> None:
        bank.edge_shares[:, edge.slot] = (edge.passed[:-1] & ~edge.in_bias).astype(float)
        bank.edge_shares[:, edge.slot] -= edge.passed[-1]


def _jump_mm(z: Array, usable: Mask) -> float:
    """Height of an edge that has just reached the tool: all channels shift by it; else noise."""
    return -float(np.median(z[usable])) if usable.any() else math.nan
