"""The state machine: mode, active controller, target, and the log of how they came about."""

from __future__ import annotations

from collections import deque

from fsw_supervisor.events import Event, EventLog, Level
from fsw_supervisor.modes import Mode, Trigger, next_mode
from fsw_supervisor.settings import ArbiterSettings

_LONG_AGO = -(10**9)


class Machine:
    """State of the arbiter as an operator sees it; changes only by the table in ``modes.py`` and by swaps.

    Attributes
    ----------
    settings : ArbiterSettings
        May be replaced at any time.
    mode, target_mode : Mode
        Actual mode and the one that is wanted.
    active, target : str
        Controller whose proposals are applied (empty unless in auto) and the one that is wanted.
    reason, requested_by : str
        Why the present state was entered and who asked for it.
    since_ns : int
        Stamp of the tick at which it was entered.
    transitions : int
        Changes of mode or controller since the start.
    revision : int
        Changes whenever something that an operator sees has changed.
    tick : int
        Number of the present tick.
    slewing : int
        Ticks left in which the transition limits hold after a swap.
    """

    def __init__(self, settings: ArbiterSettings) -> None:
        self.settings = settings
        self.mode = Mode.START
        self.target_mode = Mode.AUTO
        self.active = ""
        self.target = settings.controller
        self.reason = "starting: waiting for measurements"
        self.requested_by = "start"
        self.since_ns = 0
        self.transitions = 0
        self.revision = 0
        self.tick = 0
        self.slewing = 0
        self.events = EventLog()
        self._stamp_ns = 0
        self._mode_tick = 0
        self._automatic: deque[int] = deque(maxlen=100)
        self._asked_tick = _LONG_AGO

    def advance(self, stamp_ns: int) -> None:
        """Go on to the next tick."""
        self.tick += 1
        self._stamp_ns = stamp_ns

    @property
    def ticks_in_mode(self) -> int:
        """Ticks since the mode was entered."""
        return self.tick - self._mode_tick

    @property
    def ticks_since_asked(self) -> int:
        """Ticks since the operator's last swap."""
        return self.tick - self._asked_tick

    def storming(self) -> bool:
        """Whether there were too many automatic swaps lately."""
        window = self.settings.ticks(self.settings.storm_window_s)
        recent = sum(1 for tick in self._automatic if self.tick - tick < window)
        return recent >= self.settings.storm_swaps > 0

    def fire(self, trigger: Trigger, reason: str, who: str, controller: str = "") -> bool:
        """Make the transition that the table has for ``trigger``; False when it has none.

        ``controller`` becomes the active one where the transition leads to auto.
        """
        target = next_mode(self.mode, trigger)
        if target is None:
            return False
        before, self.mode = self.mode, target
        self._mode_tick = self.tick
        self.active = controller if target is Mode.AUTO else ""
        self.slewing = self.settings.transition_ticks if target is Mode.AUTO else 0
        if trigger is Trigger.CONTROLLER_BACK:
            self._automatic.append(self.tick)
        self._note(reason, who, f"{before} -> {target}" + (f" ({controller})" if self.active else ""))
        return True

    def swap(self, name: str, reason: str, who: str, automatic: bool) -> None:
        """Make ``name`` the active controller; only in auto."""
        before, self.active = self.active, name
        self.slewing = self.settings.transition_ticks
        if automatic:
            self._automatic.append(self.tick)
        else:
            self._asked_tick = self.tick
        self._note(reason, who, f"{before} -> {name}")

    def mirror(self, source: str) -> None:
        """Be in the mode in which a command of ``source`` is sent: off duty the one on duty is copied."""
        mode = next((mode for mode in (Mode.MANUAL, Mode.HOLD, Mode.SAFE_STOP) if mode == source), Mode.AUTO)
        active = source if mode is Mode.AUTO else ""
        if (mode, active) != (self.mode, self.active):
            self.mode, self.active = mode, active
            self._mode_tick = self.tick
            self.reason = f"as the supervisor on duty: {source}"

    def explain(self, reason: str) -> None:
        """Say why the present state lasts."""
        if reason != self.reason:
            self.reason = reason
            self.revision += 1

    def note_takeover(self, reason: str) -> None:
        """Record that this machine is on duty from now on, in the state that it has."""
        self.slewing = self.settings.transition_ticks
        self._note(f"{reason} ({self.reason})", "takeover", f"on duty in {self.mode}")

    def log(self, level: Level, who: str, text: str) -> None:
        """Record an event."""
        self.revision += 1
        self.events.add(Event(self._stamp_ns, level, who, text))

    def _note(self, reason: str, who: str, text: str) -> None:
        self.reason, self.requested_by, self.since_ns = reason, who, self._stamp_ns
        self.transitions += 1
        self.log(Level.ERROR if self.mode is Mode.SAFE_STOP else Level.INFO, who, f"{text}: {reason}")
