"""Known heat along the coming path, by time, for a controller that looks ahead."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt


@dataclass(frozen=True, slots=True, eq=False)
class HeatPlan:
    """Heat by time, linear in between; before the first time and after the last it is constant.

    Only its changes are meant: what is off by a constant belongs to the weld, not to the plan.
    """

    at_s: Sequence[float]  #: rising times on the clock of ``Measurement.time_s``
    heat_kw: Sequence[float]  #: into the copper beyond the spindle's power
    #: variance by which what the plan lacks has changed up to each time, summed from the first
    variance_kw2: Sequence[float]
    #: parameters of the thermal model with which it was found; with another one it is another heat
    model: Mapping[str, float]

    def heat(self, time_s: float) -> float:
        """Heat at a time [kW]."""
        return self._at(time_s, self.heat_kw)

    def deviation(self, begin_s: float, end_s: float) -> float:
        """Standard deviation of the change between two times that the plan lacks [kW]."""
        begin, end = (self._at(time_s, self.variance_kw2) for time_s in (begin_s, end_s))
        return sqrt(max(end - begin, 0.0))

    def _at(self, time_s: float, values: Sequence[float]) -> float:
        after = bisect_right(self.at_s, time_s)
        if after in (0, len(self.at_s)):
            return values[min(after, len(values) - 1)]
        begin_s, end_s = self.at_s[after - 1 : after + 1]
        share = (time_s - begin_s) / (end_s - begin_s)
        return values[after - 1] + share * (values[after] - values[after - 1])
