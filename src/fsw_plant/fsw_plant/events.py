"""Scheduled disturbances and sensor faults."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, nan, pi, sin, sqrt
from random import Random
from typing import NamedTuple

import numpy as np

#: channels of disturbances added to outputs; the others act within the process step
OUTPUT_CHANNELS = ("depth", "temperature")
#: ticks between two spikes
SPIKE_TICKS = 10
#: tolerance when comparing a tick's time with an event's
EPSILON_S = 1e-9
#: lag by which a level is approached, as a share of the mean time between changes
LAG = 0.2


class RandomLevels:
    """A continuous process of mean 0 and, once it is stationary, of standard deviation 1.

    Levels of a Laplace distribution are held for exponentially distributed times of mean
    ``mean_s`` and approached with a first-order lag of :data:`LAG` times that. Both tails are
    heavier than a Gauss-Markov process has, as those of published weld temperatures are (chosen).
    The lag leaves 1 / (1 + LAG) of the levels' variance; a Laplace distribution's is 2 scale^2.
    """

    def __init__(self, seed: Sequence[int], mean_s: float) -> None:
        self._draws, self._mean_s = np.random.default_rng(seed), mean_s
        self._scale = sqrt(0.5 * (1.0 + LAG))
        self._value = self._level = self._at_s = self._until_s = 0.0

    def at(self, since_s: float) -> float:
        """Value at a time since the start; times must not decrease."""
        while since_s >= self._until_s:
            self._follow(self._until_s)
            self._level = float(self._draws.laplace(0.0, self._scale))
            self._until_s += float(self._draws.exponential(self._mean_s))
        self._follow(since_s)
        return self._value

    def _follow(self, until_s: float) -> None:
        left = exp(-max(until_s - self._at_s, 0.0) / (LAG * self._mean_s))
        self._value = self._level + left * (self._value - self._level)
        self._at_s = until_s


@dataclass
class PlantEvent:
    """A disturbance of a channel or a fault of a sensor."""

    target: str  #: channel or sensor; each slot has at most one event at a time
    #: shape of a disturbance or kind of a fault; ``none`` ends the active one
    kind: str
    amount: float = 0.0  #: amplitude or magnitude, in the unit of the target
    duration_s: float = 0.0  #: see the kinds
    at_s: float = 0.0  #: it starts with the first tick that is not earlier

    def __str__(self) -> str:
        return f"{self.target}:{self.kind}"

    @property
    def slot(self) -> str:
        """Where it acts, as a key."""
        return self.target

    def over(self, time_s: float) -> bool:
        """Whether its duration is over."""
        return self.duration_s > 0.0 and time_s - self.at_s > self.duration_s - EPSILON_S


@dataclass
class Disturbance(PlantEvent):
    """A shape over time, added to an output or an input.

    ``step``: the amplitude; ``ramp``: rises to the amplitude over ``duration_s`` and stays;
    ``pulse``: the amplitude for ``duration_s``; ``sine``: with ``period_s``, and ``random``: with
    the amplitude as standard deviation and ``period_s`` as mean time between changes, both for
    ``duration_s`` or, if that is 0, until cleared. ``random`` acts beside the other shapes.
    """

    period_s: float = 0.0
    _levels: RandomLevels | None = field(default=None, init=False, repr=False, compare=False)

    def begin(self, seed: Sequence[int]) -> None:
        """Seed ``random``, which is 0 until then."""
        if self.kind == "random":
            self._levels = RandomLevels(seed, self.period_s)

    def value(self, time_s: float) -> float:
        """Value at a time, in the channel's unit."""
        since = time_s - self.at_s
        if since < -EPSILON_S or self.kind == "none" or self.over(time_s):
            return 0.0
        if self.kind == "ramp":
            return self.amount * min(since / self.duration_s, 1.0)
        if self.kind == "sine":
            return self.amount * sin(2.0 * pi * since / self.period_s)
        if self.kind == "random":
            return self.amount * self._levels.at(since) if self._levels else 0.0
        return self.amount

    @property
    def slot(self) -> str:
        """Where it acts: a channel has one disturbance, and one more that is random."""
        return f"{self.target} random" if self.kind == "random" else self.target

    def over(self, time_s: float) -> bool:
        """Whether its duration is over; a step or ramp stays."""
        return self.kind in ("pulse", "sine", "random") and super().over(time_s)


class Sample(NamedTuple):
    """A sensor's sample: the stamp of its tick and the value in the sensor's unit."""

    stamp_ns: int
    value: float


@dataclass
class Fault(PlantEvent):
    """Effect of a fault on a sample, for ``duration_s`` or, if that is 0, until cleared.

    ``freeze``: the value stays, the stamp advances; ``dropout``: nothing is sent; ``nan``: NaN is
    sent; ``spike``: the magnitude is added to one sample, and with a duration to one sample per
    second; ``bias``: the magnitude is added; ``drift``: magnitude per second is added; ``delay``:
    samples arrive ``magnitude`` seconds late, with their original stamp (those under way at the
    end of the fault are lost); ``duplicate``: each is sent twice; ``dust``: noise with the
    magnitude as standard deviation is added, and half of the samples, at random, are not sent.
    """

    _held: float | None = field(default=None, repr=False)
    _ticks: int = field(default=0, repr=False)
    _under_way: deque[tuple[float, Sample]] = field(default_factory=deque, repr=False)

    def __post_init__(self) -> None:
        self._random = Random(self.target)

    def over(self, time_s: float) -> bool:
        """Whether its duration is over; a spike without duration ends after one sample."""
        if self.kind == "spike" and self.duration_s == 0.0:
            return self._ticks > 0
        return super().over(time_s)

    def pass_on(self, sample: Sample, time_s: float, last: float | None) -> tuple[Sample, ...]:
        """Samples sent instead of ``sample``; ``last`` is the value at the previous tick."""
        tick, self._ticks = self._ticks, self._ticks + 1
        stamp_ns, value = sample
        if self.kind == "dropout":
            return ()
        if self.kind == "duplicate":
            return (sample, sample)
        if self.kind == "delay":
            self._under_way.append((time_s + self.amount, sample))
            arrived: list[Sample] = []
            while self._under_way and self._under_way[0][0] <= time_s + EPSILON_S:
                arrived.append(self._under_way.popleft()[1])
            return tuple(arrived)
        if self.kind == "nan":
            value = nan
        elif self.kind == "freeze":
            if self._held is None:
                self._held = value if last is None else last
            value = self._held
        elif self.kind == "bias" or (self.kind == "spike" and tick % SPIKE_TICKS == 0):
            value += self.amount
        elif self.kind == "dust":
            if self._random.random() < 0.5:
                return ()
            value += self._random.gauss(0.0, abs(self.amount))
        elif self.kind == "drift":
            value += self.amount * (time_s - self.at_s)
        return (Sample(stamp_ns, value),)
