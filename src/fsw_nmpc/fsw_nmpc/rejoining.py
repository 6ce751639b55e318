"""A start in mid-weld: what the estimator lacks then, and when it knows it.

At its start the estimator takes the process for settled: the power of the last dead time is that
of the first sample, and the heat is what keeps the temperature. In mid-weld a power on its way to
warm the copper would be booked as heat of the other sign for half a minute. So heat and copper
are left open, again once the power of a whole dead time has been seen, as before that the heat
has to explain what this power does; and nothing is proposed until the heat is nearly as well known
as at rest.
"""

from __future__ import annotations

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
    heat_kw, copper_c : float
        Standard deviations of heat and copper with which the estimator starts at rest.
    """

    def __init__(self, dead_time_s: float, heat_kw: float, copper_c: float) -> None:
        self._dead_time_s, self._heat_kw, self._copper_c = dead_time_s, heat_kw, copper_c
        self._seen_s: float | None = None

    def follow(self, library: Library, dt_s: float) -> bool:
        """Take the state after a step; returns whether the heat is known."""
        estimator = library.state.estimator
        if not estimator.started:
            self._seen_s = None
            return False
        if self._seen_s is None:
            _open(estimator, _HEAT_KW, _COPPER_C)
            self._seen_s = 0.0
            return False
        before_s, self._seen_s = self._seen_s, self._seen_s + dt_s
        if before_s < self._dead_time_s <= self._seen_s:
            _open(estimator, _HEAT_KW, self._copper_c)
        if self._seen_s < self._dead_time_s:
            return False
        is_known = estimator.p[int(State.HEAT)][int(State.HEAT)] <= (_NEARLY * self._heat_kw) ** 2
        return is_known or self._seen_s > self._dead_time_s + _LONGEST_S


def _open(estimator: object, heat_kw: float, copper_c: float) -> None:
    """Give heat and copper new variances without covariances, where they are estimated."""
    p = estimator.p  # type: ignore[attr-defined]  # a struct of the library
    for state, deviation in ((int(State.HEAT), heat_kw), (int(State.COPPER), copper_c)):
        if p[state][state] > 0.0:
            for other in range(len(p)):
                p[state][other] = p[other][state] = 0.0
            p[state][state] = deviation**2
