"""Known heat along the coming path, by time; which plan is in force at a tick."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from math import isfinite, sqrt
from typing import Generic, TypeVar

from fsw_control.coded import Worded
from fsw_control.schema.ranges import Range
from fsw_control.units import NANOSECONDS

#: largest heat of a plan: more than the spindle's power (chosen)
HEAT_KW = Range(-50.0, 50.0, "kW")
#: share of a plan that a controller uses, which it reports as :data:`SHARE_NAME`
SHARE, SHARE_NAME = Range(0.0, 1.0, ""), "known_heat_share"
#: A day of places 2 mm apart at the fastest traverse; a longer message is no plan (chosen).
_MOST_POINTS = 20_000
#: plans that wait for their tick (chosen)
_MOST_COMING = 8
#: The place reported by the programme and that of the plan may differ by seven seconds of the
#: paper's traverse: reports are a second apart, and some may be under way (chosen).
_PLACE_MM = 10.0

Plan = TypeVar("Plan")


class HeatPlanProblem(Worded):
    """Why a heat plan is refused, or no longer used."""

    LENGTHS = f"its lists differ in length, or have not 2 to {_MOST_POINTS} values"
    NOT_FINITE = "not finite", "a value is not finite"
    ORDER = "its times do not rise, or its places fall"
    VARIANCE = "its variance is negative or falls"
    HEAT = f"its heat is not {HEAT_KW}"
    MODEL = "it has no thermal model, or not one value for each name"
    OVER = "it came after its last time"
    CHANGED = "another profile is in use in this weld"
    PLACE = "the tool is not where the plan has it: the plan is of another path"


@dataclass(frozen=True, slots=True, eq=False)
class HeatPlan:
    """Heat by time, linear in between; before the first time and after the last it is constant.

    Only its changes count; a constant offset belongs to the weld, not to the plan.
    """

    at_s: Sequence[float]  #: rising times on the clock of ``Measurement.time_s``
    heat_kw: Sequence[float]  #: into the copper beyond the spindle's power
    #: variance by which what the plan lacks has changed up to each time, summed from the first
    variance_kw2: Sequence[float]
    #: parameters of the thermal model with which it was found; with another one it is another heat
    model: Mapping[str, float]
    travel_mm: Sequence[float] = ()  #: place of the tool along its path at each time
    angle_deg: Sequence[float] = ()  #: place of the tool about the canister at each time
    type: str = ""  #: of weld
    profile: str = ""  #: SHA-256 of the profile

    @property
    def problem(self) -> HeatPlanProblem | None:
        """The first problem of the values themselves."""
        columns = (self.at_s, self.heat_kw, self.variance_kw2, self.travel_mm, self.angle_deg)
        if len({*map(len, columns)}) > 1 or not 2 <= len(self.at_s) <= _MOST_POINTS:
            return HeatPlanProblem.LENGTHS
        if not all(map(isfinite, chain(*columns, self.model.values()))):
            return HeatPlanProblem.NOT_FINITE
        if not all(begin < end for begin, end in pairwise(self.at_s)) or _falls(self.travel_mm):
            return HeatPlanProblem.ORDER
        if self.variance_kw2[0] < 0.0 or _falls(self.variance_kw2):
            return HeatPlanProblem.VARIANCE
        if not all(HEAT_KW.low <= heat <= HEAT_KW.high for heat in self.heat_kw):
            return HeatPlanProblem.HEAT
        return None if self.model else HeatPlanProblem.MODEL

    def heat(self, time_s: float) -> float:
        """Heat at a time [kW]."""
        return self._at(time_s, self.heat_kw)

    def place(self, time_s: float) -> float:
        """Place of the tool at a time [mm]."""
        return self._at(time_s, self.travel_mm)

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


def _falls(values: Sequence[float]) -> bool:
    return any(after < before for before, after in pairwise(values))


class PlanInForce(Generic[Plan]):
    """The plan in force, of those that others publish; ``present`` until the first.

    A plan is in force from the first tick after its stamp, however early it arrives, so that a
    weld in lockstep does not depend on who is faster.
    """

    def __init__(self, present: Plan) -> None:
        self.present = present
        #: stamps and plans that wait for their tick, in order of receipt
        self.coming: deque[tuple[int, Plan]] = deque(maxlen=_MOST_COMING)

    def receive(self, stamp_ns: int, plan: Plan) -> None:
        """Take a plan that holds after the measurement of that stamp (0: at once)."""
        self.coming.append((stamp_ns, plan))

    def at(self, tick_ns: int) -> Plan:
        """Return the plan in force at a tick: the last received of those with an earlier stamp.

        It replaces all received before it, whatever their stamps.
        """
        while any(stamp_ns < tick_ns for stamp_ns, _ in self.coming):
            self.present = self.coming.popleft()[1]
        return self.present


class ReceivedHeat:
    """The heat plan in force, of those that others publish (:class:`PlanInForce`).

    A weld keeps the profile it began with: its plan may be withdrawn and moved in time, as by a
    hold, but not replaced by one of another profile. As only changes of the heat are used, a plan
    that is refused, withdrawn or dropped leaves the controller with what it has estimated.

    Parameters
    ----------
    refuse : callable
        Gets each refusal.
    """

    def __init__(self, refuse: Callable[[HeatPlanProblem], object]) -> None:
        self._refuse = refuse
        self._profile, self._begin_s, self._end_s = "", 0.0, 0.0
        self._plans: PlanInForce[HeatPlan | None] = PlanInForce(None)

    def restart(self) -> None:
        """After a weld: the next plan may be of any profile."""
        self._profile = ""

    def jump(self) -> None:
        """After a jump of time: drop the plan in force; a waiting plan may be new.

        The next plan may be of any profile.
        """
        self.restart()
        self._plans.present = None

    def receive(self, plan: HeatPlan | None, stamp_ns: int, newest_ns: int | None) -> None:
        """Take a plan, None withdraws; ``newest_ns``: last tick, None before the first."""
        if plan is not None:
            problem = plan.problem or self._untimely(plan, newest_ns)
            if problem:
                self._refuse(problem)
                return
            self._profile = plan.profile
            self._begin_s, self._end_s = plan.at_s[0], plan.at_s[-1]
        self._plans.receive(stamp_ns, plan)

    def _untimely(self, plan: HeatPlan, newest_ns: int | None) -> HeatPlanProblem | None:
        if newest_ns is None:
            return None
        now_s = newest_ns / NANOSECONDS
        if plan.at_s[-1] <= now_s:
            return HeatPlanProblem.OVER
        is_weld_under_way = self._profile and self._begin_s < now_s < self._end_s
        if is_weld_under_way and plan.profile != self._profile:
            return HeatPlanProblem.CHANGED
        return None

    def at(self, tick_ns: int) -> HeatPlan | None:
        """Return the plan in force at a tick."""
        return self._plans.at(tick_ns)

    def follow(self, travelled_mm: float, stamp_ns: int) -> None:
        """Compare with the place that the running programme reports; drop another path's plan."""
        plan, time_s = self._plans.present, stamp_ns / NANOSECONDS
        if plan is None or not plan.at_s[0] <= time_s <= plan.at_s[-1]:
            return
        if not abs(plan.place(time_s) - travelled_mm) <= _PLACE_MM:
            self._plans.present = None
            self._refuse(HeatPlanProblem.PLACE)
