"""Deviations of the executed weld from its scenario, for the result."""

from __future__ import annotations

from collections import Counter

from fsw_control.weld import TICK_S

#: time for a requested controller, or its replacement, to be in control (chosen)
_SWITCH_TICKS = 20


class Deviations:
    """Counts ticks under an unrequested controller and notes manual set-points; makes the text."""

    def __init__(self) -> None:
        self._asked: tuple[int, str] | None = None
        self._others: Counter[str] = Counter()
        self._by_hand_tick: int | None = None

    def ask(self, controller: str, tick: int) -> None:
        """Note a controller requested at a tick."""
        self._asked = tick, controller

    def count(self, controller: str, tick: int, ticks: int) -> None:
        """Note the controller (empty: unknown) in control for some ticks up to this one."""
        if self._asked is None or controller in ("", self._asked[1]):
            return
        late = tick - self._asked[0] - _SWITCH_TICKS
        if late > 0:
            self._others[controller] += min(ticks, late)

    def note_by_hand(self, tick: int) -> None:
        """Note manual set-points in force from a tick on."""
        self._by_hand_tick = tick

    def __str__(self) -> str:
        found = [
            f"; {name} was in control for {n * TICK_S:.1f} s, not asked for"
            for name, n in self._others.items()
        ]
        if self._by_hand_tick is not None:
            found.append(f"; set-points by hand from {self._by_hand_tick * TICK_S:.1f} s on")
        return "".join(found)
