"""A start in mid-weld: what the estimator lacks then, and when it knows it.

At its start the estimator takes the process for settled: the power of the last dead time is that
of the first sample, and the heat is what keeps the temperature. In mid-weld a power on its way to
warm the copper would be booked as heat of the other sign for half a minute. So heat and copper
are left open, again once the power of a whole dead time has been seen, as before that the heat
has to explain what this power does; and nothing is proposed until the heat is nearly as well known
as at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_nmpc.library import Library, State

#: standard deviations that leave heat and copper open (chosen)
_HEAT_KW, _COPPER_C = 3.0, 2.0
#: times the deviation at rest at which the heat counts as known (chosen)
_NEARLY = 2.0
#: longest time from a known power to a known heat; usually it takes two seconds (chosen)
_LONGEST_S = 10.0


class Rejoining:
    """Follows an estimator from its start in mid-weld until its heat is known.

    Parameters
    ----------
    dead_time_s : float
        Of the power.
    at_rest : sequence of float
        Standard deviations, by state, with which the estimator starts at rest.
    """

    def __init__(self, dead_time_s: float, at_rest: Any) -> None:
        self._dead_time_s = dead_time_s
        self._at_rest = {state: at_rest[int(state)] for state in State}
        self._estimated: tuple[Any, ...] = ()
        self._seen_s: float | None = None

    def follow(self, library: Library, dt_s: float) -> bool:
        """Take the state after a step; returns whether the heat is known."""
        estimator = library.state.estimator
        if not estimator.started:
            self._seen_s = None
            return False
        if self._seen_s is None:
            self._estimated = tuple(k for k in State if estimator.p[int(k)][int(k)] > 0.0)
            self._open(estimator, {State.HEAT: _HEAT_KW, State.COPPER: _COPPER_C})
            self._seen_s = 0.0
            return False
        before_s, self._seen_s = self._seen_s, self._seen_s + dt_s
        if before_s < self._dead_time_s <= self._seen_s:
            copper_c = self._at_rest[State.COPPER]
            self._open(estimator, {State.HEAT: _HEAT_KW, State.COPPER: copper_c})
        return self._seen_s >= self._dead_time_s and (
            estimator.p[int(State.HEAT)][int(State.HEAT)]
            <= (_NEARLY * self._at_rest[State.HEAT]) ** 2
            or self._seen_s > self._dead_time_s + _LONGEST_S
        )

    def _open(self, estimator: Any, deviations: Mapping[Any, float]) -> None:
        """Give states new variances without covariances, where they are estimated."""
        for state, deviation in deviations.items():
            if state in self._estimated:
                for other in range(len(State)):
                    estimator.p[int(state)][other] = estimator.p[other][int(state)] = 0.0
                estimator.p[int(state)][int(state)] = deviation**2
