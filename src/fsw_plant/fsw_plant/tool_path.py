"""Position of the tool on the canister: points of its path, and its motion within a tick."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, NamedTuple

from fsw_control.schema.models import Model, problem
from fsw_control.schema.ranges import Range
from fsw_model import STEP_S
from fsw_plant.config import PlantConfig
from fsw_plant.event_schema import TIME_S


class Waypoint(Model):
    """Position of the tool at a time; it moves linearly in between."""

    at_s: Annotated[float, TIME_S]
    arc_mm: Annotated[float, Range(0.0, 10_000.0, "mm")]
    """distance travelled around the canister"""
    axial_mm: Annotated[float, Range(-200.0, 500.0, "mm")] = 0.0
    """position above the joint line, towards the lid"""


def check_order(path: Sequence[Waypoint]) -> None:
    """For a validator: points must be in order of time, and the tool must not go back.

    Raises
    ------
    pydantic_core.ValidationError
        At the first violation.
    """
    for i in range(1, len(path)):
        if path[i].at_s <= path[i - 1].at_s:
            raise problem("is not later than the point before it", "path", i, "at_s")
        if path[i].arc_mm < path[i - 1].arc_mm:
            raise problem(
                "goes back: the tool travels one way around the canister", "path", i, "arc_mm"
            )


class Motion(NamedTuple):
    """Motion of the tool within a tick: traverse around the canister, height above the joint."""

    traverse_mm_per_s: float
    axial_mm: float


class ToolPath:
    """The path of the tool; it stands before the first and after the last point.

    ``steady`` is its motion if there are no points.
    """

    def __init__(self, points: Sequence[Waypoint], steady: Motion) -> None:
        self._steady = steady if not points else None
        self._at_s = [point.at_s for point in points]
        self._axial_mm = [point.axial_mm for point in points]
        sections = [(a, b, b.at_s - a.at_s) for a, b in pairwise(points)]
        # one number per section of the path: the canister makes new matrices for each speed
        self._speeds = [(b.arc_mm - a.arc_mm) / lasts_s for a, b, lasts_s in sections]
        self._climbs = [(b.axial_mm - a.axial_mm) / lasts_s for a, b, lasts_s in sections]

    @classmethod
    def of(cls, points: Sequence[Waypoint], config: PlantConfig) -> ToolPath:
        """The path of these points; without any, the constant motion of the plant's settings."""
        return cls(
            points, Motion(config["tool.traverse_mm_per_min"] / 60.0, config["tool.axial_mm"])
        )

    def motion(self, time_s: float, standing: bool = False) -> Motion:
        """Motion over the tick that begins at a time; ``standing``: the tool is held there."""
        if self._steady is not None:
            return Motion(0.0, self._steady.axial_mm) if standing else self._steady
        if standing:
            return Motion(0.0, self._height(time_s))
        part = bisect_right(self._at_s, time_s + 0.5 * STEP_S) - 1
        moving = 0 <= part < len(self._speeds)
        return Motion(self._speeds[part] if moving else 0.0, self._height(time_s + STEP_S))

    def _height(self, time_s: float) -> float:
        part = bisect_right(self._at_s, time_s) - 1
        if not 0 <= part < len(self._climbs):
            return self._axial_mm[max(part, 0)]
        return self._climbs[part] * (time_s - self._at_s[part]) + self._axial_mm[part]


class ToolTravel:
    """Tool motion by the programme's time, which lags the plant's after a hold."""

    def __init__(self, points: Sequence[Waypoint], config: PlantConfig) -> None:
        self._config = config
        self._lag_ticks, self._standing = 0, False
        self.take(points)

    def take(self, points: Sequence[Waypoint]) -> None:
        """Follow another path."""
        self._path = ToolPath.of(points, self._config)

    def follow(self, tick: int, time_s: float, standing: bool, age_ticks: int) -> None:
        """See :meth:`fsw_plant.PlantEmulator.follow_programme`."""
        passed = 0 if standing else age_ticks
        self._lag_ticks, self._standing = tick - passed - round(time_s / STEP_S), standing

    @property
    def lag_s(self) -> float:
        """Lag of the programme's time behind the plant's."""
        return self._lag_ticks / 10

    def programme_s(self, tick: int) -> float:
        """Programme time at a tick."""
        return (tick - self._lag_ticks) / 10

    def motion(self, tick: int) -> Motion:
        """Motion of the tool from this tick to the next."""
        return self._path.motion(self.programme_s(tick), self._standing)

    def end_tick(self) -> None:
        """Advance by a tick."""
        self._lag_ticks += self._standing
