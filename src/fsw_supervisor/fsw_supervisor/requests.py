"""Switch requests, which are answered later or at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(slots=True)
class SwitchRequest:
    """A wish to change the active controller.

    Attributes
    ----------
    name : str
        The controller wanted.
    strict : bool
        Refuse unless it is ready now.
    expires_s : float
        Steady time at which a best-effort request gives up.
    last_tick : int
        Likewise as the number of a tick (in lockstep, where the steady clock means nothing).
    who : str
        Who asked.
    accepted : bool
        Whether it was ready once, so that the swap follows at the next tick.
    done, ok : bool
        Whether it is answered, and how.
    message : str
        The answer in words.
    """

    name: str
    strict: bool
    expires_s: float
    last_tick: int
    who: str
    accepted: bool = False
    done: bool = False
    ok: bool = False
    message: str = ""
    _listeners: list[Callable[[SwitchRequest], None]] = field(default_factory=list)

    def answer(self, ok: bool, message: str) -> None:
        """Answer the request; only the first answer counts."""
        if self.done:
            return
        self.done, self.ok, self.message = True, ok, message
        for listener in self._listeners:
            listener(self)

    def when_done(self, listener: Callable[[SwitchRequest], None]) -> None:
        """Call ``listener`` with the request as soon as it is answered (now, if it is)."""
        if self.done:
            listener(self)
        else:
            self._listeners.append(listener)
