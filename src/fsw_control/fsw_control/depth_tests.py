"""Which depth channels agree: tests of each channel against the others, and of its noise.

Depth is common to all channels, so their innovations must agree apart from noise. What is left of
them without the common part has a chi-square distribution. If that is too large for all channels,
but small without one of them, that one is wrong (Chow and Willsky, "Analytical redundancy and the
design of robust failure detection systems", IEEE TAC 29:7, 1984). The test is applied to single
samples (spike, slip) and to means over a second (small slips, drift). Drift too slow for both is
compared with the channel's own prior.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw_control.depth_bank import FIVE_SECONDS, SECOND, THREE_SECONDS, Array, DepthBank, averaged
from fsw_control.depth_channels import ChannelHealth, DepthChannel, DepthFusionSettings
from fsw_control.depth_edges import SurfaceEdges
from fsw_control.validity import Frozen
from fsw_control.weld import TICK_S

Mask = NDArray[np.bool_]
#: parity chi-square of channels that disagree; by chance once in 1e7 samples of four channels
DISAGREE = 35.0
#: and of those that agree once the wrong one is left out; next best at least so much larger
AGREE, MARGIN = 16.0, 15.0
#: squared distances from the witness, in variances, that speak for and against a channel
NEAR, FAR = 9.0, 25.0
#: squared distance of a channel from its prior, in variances, from which it counts as drifting
OFF_PRIOR = 16.0
#: samples for which a channel that seems to drift is watched, and of the means at both ends
WATCHED, ENDS = 150, 30
#: movement within that time below which it has stepped and not drifted, and the largest such step
#: that is no fault: the surface is not even, and a bias may change [mm]
STILL_MM, STEP_MM = 0.012, 0.06
#: distance of a slipped channel from where it was below which it is back [mm]
BACK_MM = 0.02
#: range of spikes in a row, in their mean, below which they are a slip
ALIKE = 0.5
#: a rival for that must be below this share of it
RIVAL = 0.5
#: squared noise in that of the settings from which a channel counts as dusty, until it is back
DUSTY, CLEAN = 6.0, 2.5
#: largest squared noise that counts, so that single spikes are not dust
CLIPPED = 16.0
#: share of missing samples from which a channel counts as interrupted
INTERRUPTED = 0.3
#: weight of no channel, so that nothing is divided by 0 [1/mm2]
_TINY = 1e-12
#: of a tick, in the means of what is left of the innovations
_WEIGHTS = np.array([SECOND, FIVE_SECONDS])[:, None, None]


class Judgement(NamedTuple):
    """The channels at a tick."""

    used: Mask
    health: list[ChannelHealth]
    isolated: tuple[int, ...]  #: that have just been found wrong for good
    spread_mm: float = 0.0  #: half the distance of channels of which one is wrong, unknown which
    common: float = 0.0  #: squared innovation of all, in its variances
    common_mm: float = 0.0  #: and itself


def parity(z: Array, inverse: Array, taken: Array) -> tuple[Array, Array, Array]:
    """Chi-square of innovations without their common part, that part, and its weight."""
    weighted = (inverse @ (z * taken)[..., None])[..., 0]
    weights = ((inverse @ taken[..., None])[..., 0] * taken).sum(-1) + _TINY
    common = (weighted * taken).sum(-1) / weights
    return (z * taken * weighted).sum(-1) - common**2 * weights, common, weights


class DriftWatch:
    """Watches channels that seem to drift: a small step that stands is a change of the bias."""

    def __init__(self) -> None:
        #: by channel, its distance from the others before, and since then
        self._distances: dict[int, tuple[float, list[float]]] = {}

    def __contains__(self, channel: int) -> bool:
        return channel in self._distances

    def begin(self, channel: int, before_mm: float) -> None:
        """Watch a channel that was this far from the others."""
        self._distances[channel] = before_mm, []

    def end(self, channel: int) -> None:
        """Watch a channel no longer."""
        self._distances.pop(channel, None)

    def verdicts(self, own_mm: Array, known: Mask) -> dict[int, float | None]:
        """Steps of channels that were watched for long enough; None: it drifts.

        ``own_mm`` is how far each channel is from the others; ``known``, whether it was sampled.
        """
        steps: dict[int, float | None] = {}
        for i, (before_mm, distances) in self._distances.items():
            if known[i]:
                distances.append(float(own_mm[i]))
            if len(distances) >= WATCHED:
                first_mm, last_mm = np.mean(distances[:ENDS]), np.mean(distances[-ENDS:])
                step_mm = float(abs(last_mm - before_mm))
                is_still = abs(last_mm - first_mm) < STILL_MM and step_mm < STEP_MM
                steps[i] = step_mm if is_still else None
        return steps


class ChannelTests:
    """Tests of all channels of a weld, tick by tick."""

    def __init__(
        self,
        settings: DepthFusionSettings,
        channels: Mapping[str, DepthChannel],
        edges: SurfaceEdges,
    ) -> None:
        self._settings, self._rows, self._edges = settings, tuple(channels.values()), edges
        count = len(self._rows)
        self._noise = np.array([row.noise_mm**2 for row in self._rows])
        self.latched = [ChannelHealth.GOOD] * count  #: why a channel is out for good
        self._frozen = [Frozen() for _ in self._rows]
        #: spikes in a row
        self._spikes = [deque[float](maxlen=settings.confirm_samples) for _ in self._rows]
        #: over a second, and over five; by filter and channel, without the common part
        self._means = np.zeros((2, count + 1, count))
        self._off = np.zeros(count)  #: from the prior, over three seconds
        self._before = np.zeros(count)  #: the same, ahead of a slip
        self._watch = DriftWatch()
        self._roughness, self._absent = np.ones(count), np.zeros(count)
        self._last = np.full(count, np.nan)
        self._dusty = np.zeros(count, bool)
        self._agreed = [0] * count  #: ticks for which an excluded channel has agreed again
        self._unclear = 0  #: ticks for which channels have disagreed without a verdict
        self._never_moved: set[int] = set()  #: channels that are stuck since the start
        self._purged: list[int] = []  #: channels found wrong in this tick that the filters used
        self._quiet = 0  #: ticks until the slow tests are judged again

    def screen(self, samples_mm: list[float]) -> tuple[Array, list[ChannelHealth]]:
        """Samples (NaN: not usable) and health of each channel by itself."""
        values, health = np.array(samples_mm), list(self.latched)
        pairs = zip(self._frozen, self._rows, strict=True)
        noisy = any(frozen.is_noisy(row.noise_mm) for frozen, row in pairs)
        for i, (value, row) in enumerate(zip(samples_mm, self._rows, strict=True)):
            absent = value != value
            self._absent[i] += (absent - self._absent[i]) * THREE_SECONDS
            if absent:
                flaw = ChannelHealth.MISSING
            elif self._is_stuck(i, value, noisy):
                flaw = ChannelHealth.STUCK
            elif not row.minimum_mm <= value <= row.maximum_mm:
                flaw = ChannelHealth.OUT_OF_RANGE
            else:
                continue
            values[i] = np.nan
            if not health[i] or health[i] is ChannelHealth.STEPPED:  # not a verdict yet
                health[i] = flaw
        return values, health

    def _is_stuck(self, channel: int, value: float, noisy: bool) -> bool:
        """Whether a channel has stopped, or has never moved while another was ``noisy``."""
        frozen, samples = self._frozen[channel], self._settings.stuck_samples
        if frozen.update(value, samples, self._rows[channel].noise_mm):
            return True
        if not frozen.has_never_moved(samples):
            self._never_moved.discard(channel)
            return False
        if noisy and channel not in self._never_moved:
            self._never_moved.add(channel)
            self._purged.append(channel)
        return channel in self._never_moved

    def meet_edges(self, bank: DepthBank, values: Array, health: list[ChannelHealth]) -> bool:
        """Update the edges by the samples, before the channels are judged.

        Returns whether the innovations are no longer those of this tick.
        """
        usable = ~np.isnan(values) & _sound(health)
        changed = self._edges.arrive(bank, usable)
        clear = usable & ~(self._dusty | (self._absent > INTERRUPTED))
        edges, slips = self._edges.review(bank, values, usable, clear)
        shown_mm = np.where(usable, self._edges.shown_mm(bank.z[0]), 0.0)
        values -= shown_mm  # so that the channel still has its say on the others
        changed |= bool(shown_mm.any())
        for i in edges:  # the filters know it now
            self.latched[i] = ChannelHealth.GOOD
            if not np.isnan(values[i]):
                health[i] = ChannelHealth.GOOD
            self._off[i] = self._before[i]
            self._watch.end(i)
            self._means[:] = 0.0
        for i in slips:
            if i not in self._watch:  # else decided there
                self.latched[i] = health[i] = ChannelHealth.SLIP
                self._purged.append(i)
        self._look(bank, health, ~np.isnan(values))
        return changed or bool(edges)

    def _look(self, bank: DepthBank, health: list[ChannelHealth], sampled: Mask) -> None:
        """Decide whether channels that seemed to drift do, or have made a small step.

        Such a step is a change of the bias: the filters then find it like that after touch-off.
        """
        own_mm = np.diagonal(bank.z[1:])
        for i, step_mm in self._watch.verdicts(own_mm, sampled).items():
            if self._edges.is_pending(i):
                continue
            self._watch.end(i)
            if step_mm is None:
                self.latched[i] = health[i] = ChannelHealth.DRIFT
                self._purged.append(i)
            else:
                self.latched[i] = health[i] = ChannelHealth.GOOD
                bank.doubt(i, step_mm if step_mm > STILL_MM else 0.0)
                self._means[:] = 0.0

    def judge(
        self,
        bank: DepthBank,
        values: Array,
        health: list[ChannelHealth],
        witness: tuple[float, float],
    ) -> Judgement:
        """Decide which channels the bank may use; its innovations are those of this tick.

        ``values`` are the samples after :meth:`screen`. ``witness`` is the change of the depth
        against its prediction according to the torque, and its variance.
        """
        present = _sound(health)
        self._listen(bank.z[0], present, health)
        usable = _sound(health)
        tested = min(len(bank.z), len(self._rows) + 1)  # none without a pair
        z = bank.z[:tested]
        inverses, taken = bank.weigh(usable)
        inverses, taken = inverses[:, :tested], taken[:tested]
        # innovations are white: means over longer than the filters need to follow are, too
        means = self._means[:, :tested]
        chi, common, weights = parity(
            np.stack((z, *means)),
            np.stack((*inverses, inverses[0] / averaged(FIVE_SECONDS))),
            taken,
        )
        wrong, spread = _wrong(chi[0], usable, bank, witness)
        if wrong is None:
            wrong = self._still_wrong(usable, bank, witness)
            spread = 0.0 if wrong else spread
        wrong = wrong or ()  # without a verdict all stay in use; the deviation shows it
        isolated = self._confirm(wrong, usable, bank, health)
        isolated += tuple(sorted(set(self._purged)))
        self._purged.clear()
        used = usable.copy()
        used[list(wrong)] = False
        if not wrong:  # else the common part is wrong, too
            apart = z - common[0][:, None]
            means += np.where(used, (apart - means) * _WEIGHTS, 0.0)
        self._follow_priors(bank, used, ~np.isnan(values))
        if self._quiet:
            self._quiet -= 1
        elif not wrong and not spread:
            drifting, spread = self._slow(chi[1:], used, bank, health)
            isolated += drifting
        self._suspect(spread, used, health)
        used &= _sound(self.latched)
        self._readmit(~np.isnan(values))
        squared = 0.0 if wrong or isolated or spread else float(common[0, 0] ** 2 * weights[0, 0])
        return Judgement(used, health, isolated, spread, squared, float(common[0, 0]))

    def trust(self, left_out: int, bank: DepthBank) -> None:
        """Compare with the filter that left out a channel, from now on."""
        if len(bank.z) > 1:
            self._means[:], self._off = 0.0, bank.z[left_out + 1].copy()
        self._quiet = round(1.0 / SECOND)

    def restart(self) -> None:
        """Compare with filters that have begun again, from now on."""
        self._means[:] = self._off[:] = 0.0
        self._quiet = round(1.0 / SECOND)

    def _listen(self, z: Array, present: Mask, health: list[ChannelHealth]) -> None:
        """Noise of each channel by its changes from tick to tick, and its interruptions."""
        change = np.where(present, z - self._last, np.nan)
        self._last = np.where(present, z, np.nan)
        rough = np.minimum(change**2 / (2.0 * self._noise), CLIPPED)
        self._roughness += np.where(
            np.isnan(rough), 0.0, (rough - self._roughness) * THREE_SECONDS
        )
        self._dusty = np.where(self._dusty, self._roughness > CLEAN, self._roughness > DUSTY)
        for i in _indices(self._dusty | (self._absent > INTERRUPTED)):
            if health[i] is ChannelHealth.GOOD:
                health[i] = ChannelHealth.DUST

    def _still_wrong(
        self, usable: Mask, bank: DepthBank, witness: tuple[float, float]
    ) -> tuple[int, ...] | None:
        """Channels that were wrong in the tick before, and those that contradict the rest.

        Used if the usable channels alone do not decide; None: undecided as well.
        """
        before = usable & np.array([len(spikes) > 0 for spikes in self._spikes])
        if not before.any():
            return None
        rest = usable & ~before
        inverses, taken = bank.weigh(rest)
        tested = len(self._rows) + 1
        chi = parity(bank.z[:tested], inverses[0, :tested], taken[:tested])[0]
        more, _ = _wrong(chi, rest, bank, witness)
        return None if more is None else (*_indices(before), *more)

    def _confirm(
        self, wrong: tuple[int, ...], usable: Mask, bank: DepthBank, health: list[ChannelHealth]
    ) -> tuple[int, ...]:
        """Mark spikes; those that last and resemble each other are a slip, or show an edge."""
        for i, spikes in enumerate(self._spikes):
            if i not in wrong:
                spikes.clear()
        slipped = []
        for i in wrong:
            health[i] = ChannelHealth.SPIKE
            spikes = self._spikes[i]
            spikes.append(float(bank.z[0, i]))
            self._edges.note_wrong(i, spikes[-1])
            alike = max(spikes) - min(spikes) < ALIKE * abs(sum(spikes)) / len(spikes)
            if len(spikes) == self._settings.confirm_samples and alike:
                slipped.append(i)
        return self._latch(slipped, ChannelHealth.SLIP, usable, health)

    def _suspect(self, spread: float, used: Mask, health: list[ChannelHealth]) -> None:
        """Mark channels that disagree for several samples, unknown which is wrong."""
        self._unclear = self._unclear + 1 if spread else 0
        if self._unclear >= self._settings.confirm_samples:
            for i in _indices(used):
                health[i] = ChannelHealth.SUSPECT

    def _latch(
        self,
        channels: Sequence[int],
        flaw: ChannelHealth,
        usable: Mask,
        health: list[ChannelHealth],
    ) -> tuple[int, ...]:
        """Exclude channels; returns those without which the filters continue.

        A jump that may be an edge is not in the filters yet: they need no replacement.
        """
        isolated, slow = [], flaw is ChannelHealth.STEPPED
        for i in channels:
            height_mm = float(self._means[0, 0, i] if slow else np.mean(self._spikes[i]))
            self._edges.note_wrong(i, height_mm)
            if self._edges.expects(i):  # decided there
                continue
            self._spikes[i].clear()
            self._agreed[i], self._before[i] = 0, self._off[i]
            if slow:
                self._watch.begin(i, self._off[i])
            drifts = flaw is ChannelHealth.DRIFT
            stepped = not drifts and self._edges.suspect(i, height_mm, usable, slow)
            health[i] = self.latched[i] = ChannelHealth.STEPPED if stepped else flaw
            if not (slow or stepped):
                isolated.append(i)
        return tuple(isolated)

    def _follow_priors(self, bank: DepthBank, used: Mask, sampled: Mask) -> None:
        """Distance of each channel from its prior and the others."""
        own = np.diagonal(bank.z[1:]) if len(bank.z) > 1 else bank.z[0]
        latched = np.array([bool(flaw) for flaw in self.latched])
        known = used | (latched & sampled)
        self._off += np.where(known, (own - self._off) * THREE_SECONDS, 0.0)

    def _slow(
        self, chi: Array, used: Mask, bank: DepthBank, health: list[ChannelHealth]
    ) -> tuple[tuple[int, ...], float]:
        """Channels that have just been found to drift; those that seem to are watched."""
        count = np.count_nonzero(used)
        if count < 2:
            return (), 0.0
        drifting: int | None = None
        flaw = ChannelHealth.STEPPED
        if chi[0, 0] > DISAGREE:
            drifting = _odd(chi[0], used) if count > 2 else None
            if drifting is None:
                return (), _spread(self._means[0, 0][used])
        elif count > 2 and chi[1, 0] > DISAGREE:
            drifting = _odd(chi[1], used)
        elif count > 2 and ChannelHealth.STEPPED not in self.latched:  # is in the other filters
            variance = np.diagonal(np.diagonal(bank.s[1:], axis1=1, axis2=2))
            squared = np.where(
                used, self._off**2 / (variance + self._noise * averaged(THREE_SECONDS)), 0.0
            )
            second, best = np.partition(squared, -2)[-2:]
            if best > OFF_PRIOR and second < RIVAL * best:
                drifting, flaw = int(np.argmax(squared)), ChannelHealth.DRIFT
        if drifting is None:
            return (), 0.0
        return self._latch((drifting,), flaw, used, health), 0.0

    def _readmit(self, sampled: Mask) -> None:
        """Use a slipped channel again that has been back where it was for long enough."""
        ticks = round(self._settings.readmit_s / TICK_S)
        for i, flaw in enumerate(self.latched):
            if flaw in (ChannelHealth.SLIP, ChannelHealth.STEPPED) and i not in self._watch:
                moved_mm = abs(self._off[i] - self._before[i])
                is_back = moved_mm < BACK_MM and sampled[i]
                self._agreed[i] = self._agreed[i] + 1 if is_back else 0
                if self._agreed[i] > ticks:
                    self.latched[i] = ChannelHealth.GOOD
                    self._edges.drop(i)


def _wrong(
    chi: Array, usable: Mask, bank: DepthBank, witness: tuple[float, float]
) -> tuple[tuple[int, ...] | None, float]:
    """Channels that contradict the others; None: some do, unknown which."""
    count = np.count_nonzero(usable)
    if count == 0 or (chi[0] <= DISAGREE and count > 1):
        return (), 0.0
    if count > 2:
        wrong = _odd(chi, usable)
        if wrong is not None:
            return (wrong,), 0.0
    # too few channels for a majority: the torque, or that depth does not jump
    z, shift = bank.z[0], witness[0]
    distance = (z - shift) ** 2 / (np.diagonal(bank.s[0]) + bank.noise + witness[1])
    far = usable & (distance > FAR)
    if not far.any():
        return ((), 0.0) if count == 1 else (None, _spread(z[usable]))
    if count > 1 and not (far | (distance < NEAR))[usable].all():
        return None, _spread(z[usable])
    if count > 1 and far[usable].all():
        return None, _spread(z[usable])
    return _indices(far), 0.0


def _odd(chi: Array, usable: Mask) -> int | None:
    """The only channel without which the others agree."""
    without = np.where(usable, chi[1:], np.inf)
    best, second = np.partition(without, 1)[:2]
    if best <= AGREE and second - best > MARGIN:
        return int(np.argmin(without))
    return None


def _sound(health: Sequence[ChannelHealth]) -> Mask:
    return np.array([not flaw for flaw in health])


def _spread(z: Array) -> float:
    return 0.5 * float(z.max() - z.min())


def _indices(mask: Mask) -> tuple[int, ...]:
    return tuple(np.flatnonzero(mask).tolist())
