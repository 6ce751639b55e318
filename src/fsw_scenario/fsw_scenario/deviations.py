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

    @property
    def others_s(self) -> dict[str, float]:
        """How long controllers that were not asked for were in control, by name."""
        return {name: ticks * TICK_S for name, ticks in self._others.items()}

    @property
    def by_hand_from_s(self) -> float | None:
        """Since when set-points by hand are in force."""
        return None if self._by_hand_tick is None else self._by_hand_tick * TICK_S

    def __str__(self) -> str:
        found = [
            f"; {name} was in control for {time_s:.1f} s, not asked for"
            for name, time_s in self.others_s.items()
        ]
        if self.by_hand_from_s is not None:
            found.append(f"; set-points by hand from {self.by_hand_from_s:.1f} s on")
        return "".join(found)
