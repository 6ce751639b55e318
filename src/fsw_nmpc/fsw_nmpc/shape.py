"""The way back to a set-point after a jump, at a speed and an acceleration that the handles can follow.

A set-point that jumps, or an output disturbance that does, leaves the output away from its set-point by the whole jump
at once. A corridor that asks for more than the handles can do makes the optimiser trade one output for the other; a
first-order corridor always does so at its beginning. Here the jump is worked off with limited acceleration, speed and
deceleration, beginning when the dead time lets anything happen at all. What changes slowly (a ramp, a slow sine, the
noise of an estimate) is no jump and is followed at once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fsw_model import STEP_S

Vector = NDArray[np.float64]
_TAIL_STEP_S = 0.5
_LONGEST_GAP = 10


@dataclass(frozen=True, slots=True)
class Shape:
    """How a jump is worked off, in the output's unit and s.

    Attributes
    ----------
    acceleration : float
        Largest change of the speed, per s^2.
    slow_speed, time_s : float
        The speed is at most ``slow_speed + jump / time_s``: larger jumps are taken faster.
    top_speed : float
        And never more than this.
    ramp_speed, pass_speed : float
        A set-point and a disturbance that change no faster than this do not jump.
    haste : float
        Factor on the speed (but not beyond ``top_speed``) when it is the disturbance that jumps.
    delay_s : float
        Nothing can be done for so long.
    """

    acceleration: float
    slow_speed: float
    time_s: float
    top_speed: float
    ramp_speed: float
    pass_speed: float
    haste: float = 1.0
    delay_s: float = 0.0

    def speed_for(self, jump: float, haste: float = 1.0) -> float:
        """Largest speed at which a jump is worked off."""
        return min(haste * (self.slow_speed + abs(jump) / self.time_s), self.top_speed)

    def advance(self, distance: float, speed: float, top_speed: float, dt_s: float) -> tuple[float, float]:
        """Distance from the set-point and its speed after ``dt_s``, with a speed of at most ``top_speed``."""
        size = abs(distance)
        wanted = min(sqrt(2.0 * self.acceleration * size), top_speed, size / max(dt_s, 2.0 * STEP_S))
        change = (-wanted if distance > 0.0 else wanted) - speed
        largest = self.acceleration * dt_s
        speed += min(max(change, -largest), largest)
        distance += dt_s * speed
        if abs(distance) < 1e-3 * self.pass_speed and abs(speed) < self.pass_speed:
            return 0.0, 0.0
        return distance, speed


class ShapedPath:
    """Distance of one output's corridor from its set-point, now and over the horizon.

    Parameters
    ----------
    time_s : (n,) array
        Output points of the horizon, every 0.1 s at its beginning.
    shape : Shape
    """

    def __init__(self, time_s: Vector, shape: Shape) -> None:
        self._time_s = time_s.tolist()
        self._shape = shape
        self._rest = np.zeros(len(time_s))
        self._waiting: deque[float] = deque([0.0] * round(shape.delay_s / STEP_S))
        self._speed = self._error = self._top_speed = 0.0
        self._before: tuple[float, float] | None = None

    @property
    def is_started(self) -> bool:
        """Whether a set-point has been seen."""
        return self._before is not None

    @property
    def distance(self) -> float:
        """From the set-point, now."""
        return self._error + sum(self._waiting)

    def forget(self, distance: float) -> None:
        """Begin anew, at rest and so far from the set-point."""
        self._error, self._speed, self._before = distance, 0.0, None
        self._top_speed = self._shape.speed_for(distance)
        for i in range(len(self._waiting)):
            self._waiting[i] = 0.0

    def follow(self, other: ShapedPath) -> None:
        """Go on from another path's present state."""
        self.forget(0.0)
        self._error, self._speed, self._before = other._error, other._speed, other._before
        n = min(len(self._waiting), len(other._waiting))
        if n:
            for i, jump in enumerate(list(other._waiting)[-n:]):
                self._waiting[i - n] = jump
        self._error += other.distance - self.distance
        self._top_speed = max(self._shape.speed_for(self._error), min(other._top_speed, self._shape.top_speed))

    def step(self, set_point: float, disturbance: float, dt_s: float) -> Vector:
        """Advance by ``dt_s`` to the present set-point and disturbance; distance over the horizon (n,)."""
        if self._before is None:
            self._before = set_point, disturbance
        else:
            for _ in range(min(max(round(dt_s / STEP_S) - 1, 0), _LONGEST_GAP)):
                self._take(0.0)
            disturbed, wanted = disturbance - self._before[1], set_point - self._before[0]
            self._before = set_point, disturbance
            jump = _beyond(disturbed, self._shape.pass_speed * dt_s) - _beyond(wanted, self._shape.ramp_speed * dt_s)
            self._take(jump)
            if jump:
                haste = self._shape.haste if abs(disturbed) > abs(wanted) else 1.0
                self._top_speed = max(self._top_speed, self._shape.speed_for(self.distance, haste))
        if self._error == 0.0 and self._speed == 0.0 and not any(self._waiting):
            return self._rest
        return self._ahead()

    def _take(self, jump: float) -> None:
        """One tick with a jump at its end."""
        self._error, self._speed = self._shape.advance(self._error, self._speed, self._top_speed, STEP_S)
        self._waiting.append(jump)
        self._error += self._waiting.popleft()
        if self._error == 0.0 and self._speed == 0.0 and not any(self._waiting):
            self._top_speed = 0.0

    def _ahead(self) -> Vector:
        advance, top_speed, waiting = self._shape.advance, self._top_speed, list(self._waiting)
        distance, speed, pending = self._error, self._speed, sum(waiting)
        path: list[float] = []
        now_s = 0.0
        for i, time_s in enumerate(self._time_s):
            while now_s < time_s - 1e-9 and (distance != 0.0 or speed != 0.0):
                dt_s = min(time_s - now_s, STEP_S if time_s - now_s < 1.5 * STEP_S else _TAIL_STEP_S)
                distance, speed = advance(distance, speed, top_speed, dt_s)
                now_s += dt_s
            now_s = time_s
            if i < len(waiting):
                distance += waiting[i]
                pending -= waiting[i]
            path.append(distance + pending)
        return np.array(path)


def _beyond(change: float, passed: float) -> float:
    """Part of a change that is more than what may pass."""
    return change - min(max(change, -passed), passed)
