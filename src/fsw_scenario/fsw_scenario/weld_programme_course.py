"""What a programme sends: set-points as planned, or left and back by a ramp, and heat plans."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fsw_control.coded import Fact
from fsw_control.contract import Reference
from fsw_control.heat_plan import HeatPlan
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.schema.models import InputError
from fsw_control.weld import TICK_S
from fsw_model.heat_profile import CORRELATION_MM, CORRELATION_S, HeatProfile
from fsw_scenario.weld_programme import Phase, ProgrammeCode, spans

#: a return ramp begins this many ticks later, so that none of its steps is late
_LEAD_TICKS = 5


class WayBack(NamedTuple):
    """The ramp from the set-points in force to the programme."""

    #: its start, and where it meets the programme
    start: Reference
    goal: Reference
    duration_s: float
    changes: dict[int, Reference]  #: by tick of the programme

    @property
    def fact(self) -> Fact:
        """What it is, for the answer to a request."""
        if self.start == self.goal and not self.changes:
            return Fact.of(ProgrammeCode.FOLLOWED)
        return Fact.of(
            ProgrammeCode.WAY_BACK,
            start_mm=self.start.depth_mm,
            start_c=self.start.temperature_c,
            goal_mm=self.goal.depth_mm,
            goal_c=self.goal.temperature_c,
            duration_s=self.duration_s,
        )


class Course:
    """Sends a programme's set-points, given as its changes by tick, in order, from tick 0 on.

    While it is *followed*, its set-points are sent as planned. A hold, or manual set-points,
    *leave* it: the set-points then in force stay. A resume ramps back to the programme at the
    permitted rates while its time continues, so that no part of it is skipped and there are no
    jumps other than the programme's own, and that of the temperature after a dwell that ended
    early.
    """

    def __init__(self, programme: Mapping[int, Reference]) -> None:
        self._programme = dict(programme)
        self._ticks = list(programme)
        #: set-points still to be sent, in order of ticks; the caller takes them from the left
        self.coming: deque[tuple[int, Reference]] = deque(self._programme.items())
        self.followed = True  #: the programme, or the ramp back to it, is being sent

    def programme_at(self, tick: int) -> Reference:
        """The programme's set-points at a tick."""
        return self._programme[self._ticks[max(bisect_right(self._ticks, tick) - 1, 0)]]

    def leave(self) -> None:
        """Stop sending until :meth:`resume`."""
        self.coming.clear()
        self.followed = False

    def way_back(self, in_force: Reference, tick: int, warm: bool = False) -> WayBack:
        """The ramp from the set-points in force to the programme, at a tick of it.

        ``warm``: the dwell has ended because its temperature is reached. The set-point of the
        temperature then returns in one step, as a ramp from below would cool the copper first.
        """
        changes: dict[int, Reference] = {}
        present, now = in_force, tick
        if in_force != self.programme_at(tick):
            now += _LEAD_TICKS
            while present != self.programme_at(now):
                now += 1
                goal = self.programme_at(now)
                if warm:
                    present = replace(present, temperature_c=goal.temperature_c)
                present = _toward(present, goal)
                changes[now] = present
        return WayBack(in_force, present, (now - tick) * TICK_S, changes)

    def resume(self, in_force: Reference, tick: int, warm: bool = False) -> WayBack:
        """Return to the programme; the caller first sends ``in_force``, voiding foreign ones."""
        way = self.way_back(in_force, tick, warm)
        met = max(way.changes, default=tick)
        self.coming = deque(way.changes.items())
        self.coming.extend((when, point) for when, point in self._programme.items() if when > met)
        self.followed = True
        return way


def _toward(present: Reference, goal: Reference) -> Reference:
    """One tick nearer at the permitted rates."""
    return Reference(
        _nearer(present.depth_mm, goal.depth_mm, WELD_RATE_DEPTH_MM_PER_S * TICK_S),
        _nearer(present.temperature_c, goal.temperature_c, WELD_RATE_TEMPERATURE_C_PER_S * TICK_S),
    )


def _nearer(value: float, aim: float, step: float) -> float:
    return aim if abs(aim - value) <= step else value + (step if aim > value else -step)


class HeatAhead:
    """Makes the heat plans of a weld: a profile by the time at which the tool will be there.

    Raises
    ------
    InputError
        If the programme has no phases, so that it is not known where the tool is.
    """

    def __init__(self, profile: HeatProfile, phases: Sequence[Phase]) -> None:
        if not phases:
            raise InputError("a heat profile needs a programme with phases: heat goes by the path")
        ends_s = [0.0, *(end_s for _, _, end_s in spans(phases))]
        places_mm = np.cumsum([0.0, *(phase.length_mm for phase in phases)])
        travel_mm = np.array(profile.travel_mm)
        # what the tool passes while it moves, and where it begins and ends to move
        passed_mm = np.unique(np.concatenate([places_mm, travel_mm[travel_mm <= places_mm[-1]]]))
        moving = np.flatnonzero(np.diff(places_mm) > 0.0)
        times = [np.array(ends_s)]
        for part in moving:
            inside = passed_mm[(passed_mm > places_mm[part]) & (passed_mm < places_mm[part + 1])]
            times.append(np.interp(inside, places_mm[part : part + 2], ends_s[part : part + 2]))
        self._at_s = np.unique(np.concatenate(times))
        travelled_mm = np.interp(self._at_s, ends_s, places_mm)
        turns_deg = [phases[0].from_deg, *(phase.to_deg for phase in phases)]
        self._places = travelled_mm.tolist(), np.interp(self._at_s, ends_s, turns_deg).tolist()
        self._heat_kw = np.interp(travelled_mm, travel_mm, profile.heat_kw).tolist()
        deviation_kw = np.interp(travelled_mm, travel_mm, profile.deviation_kw)
        # what it lacks is a process of this deviation that forgets over the correlation length;
        # where the tool stands, over the time in which it would travel as far
        forgotten = np.maximum(
            np.diff(travelled_mm) / CORRELATION_MM, np.diff(self._at_s) / CORRELATION_S
        )
        variance_kw2 = np.cumsum(2.0 * forgotten * deviation_kw[1:] ** 2)
        self._variance_kw2 = [0.0, *variance_kw2.tolist()]
        self._model = profile.model.model_dump()
        self._of = profile.type, profile.sha256

    def plan(self, begin_s: float) -> HeatPlan:
        """The plan of a weld whose programme begins at ``begin_s`` on the measurements' clock."""
        at_s = (self._at_s + begin_s).tolist()
        return HeatPlan(
            at_s, self._heat_kw, self._variance_kw2, self._model, *self._places, *self._of
        )
