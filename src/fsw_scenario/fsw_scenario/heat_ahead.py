"""The heat of a profile by the time of a weld: where the programme says that the tool will be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fsw_control.heat_plan import HeatPlan
from fsw_model.heat_profile import CORRELATION_MM, CORRELATION_S, HeatProfile
from fsw_scenario.weld_programme import Phase, spans
from fsw_schema.models import InputError


class HeatAhead:
    """Makes the heat plans of a weld.

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

    def plan(self, begin_s: float) -> HeatPlan:
        """The plan of a weld whose programme begins at ``begin_s`` on the measurements' clock."""
        at_s = (self._at_s + begin_s).tolist()
        return HeatPlan(at_s, self._heat_kw, self._variance_kw2, self._model)
