"""Latency of one controller: measurement to proposal."""

from __future__ import annotations

from collections import deque
from math import ceil, fsum, sqrt


class LatencyStatistics:
    """Statistics over the last proposals.

    Parameters
    ----------
    window : int
        Number of latencies kept.
    """

    def __init__(self, window: int = 300) -> None:
        self._values: deque[float] = deque(maxlen=window)

    def __len__(self) -> int:
        return len(self._values)

    def add(self, latency_s: float) -> None:
        """Add one latency [s]."""
        self._values.append(latency_s)

    @property
    def mean_s(self) -> float:
        """Mean latency [s], 0 before the first."""
        return fsum(self._values) / len(self._values) if self._values else 0.0

    @property
    def max_s(self) -> float:
        """Largest latency [s] of the window."""
        return max(self._values, default=0.0)

    @property
    def jitter_s(self) -> float:
        """Standard deviation of the latency [s]."""
        if len(self._values) < 2:
            return 0.0
        mean = self.mean_s
        return sqrt(fsum((value - mean) ** 2 for value in self._values) / len(self._values))

    def quantile_s(self, fraction: float) -> float:
        """Latency [s] that ``fraction`` (0 to 1) of the window stays at or below."""
        if not self._values:
            return 0.0
        ordered = sorted(self._values)
        return ordered[max(0, ceil(fraction * len(ordered)) - 1)]
