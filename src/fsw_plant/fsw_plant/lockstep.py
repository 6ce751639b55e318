"""When the next tick of lockstep may begin."""

from __future__ import annotations

from math import inf

#: time between repetitions of a tick for a supervisor that was started while the tick was
#: unanswered [s]
_REPEAT_S = 0.5


class Lockstep:
    """Waits for the command that answers the present tick, and for a scenario player to have sent what precedes it.

    Times are on the steady clock.
    """

    def __init__(self) -> None:
        self.answered = True  #: whether the present tick has its command
        self.player_present = False  #: whether a player takes part
        self.resent = 0  #: how often the present tick was sent again
        self._unplayed_ns: int | None = None
        self._begun_s = self._sent_s = 0.0
        self._repeat_s = inf

    @property
    def complete(self) -> bool:
        """Whether nothing is waited for any more."""
        return self.answered and not (self.player_present and self._unplayed_ns is not None)

    def begin(self, now_s: float) -> None:
        """A tick begins."""
        self.answered, self.resent, self._repeat_s = False, 0, inf
        self._begun_s = self._sent_s = now_s

    def on_new_writer(self) -> None:
        """Another node publishes commands: it has not received the present tick, nor the answers to it."""
        self._repeat_s, self._sent_s = _REPEAT_S, -inf

    def must_repeat(self, now_s: float, timeout_s: float) -> bool:
        """Whether the present tick is to be sent again: every ``timeout_s``, and for a new writer."""
        if self.answered or now_s - self._sent_s < min(timeout_s, self._repeat_s):
            return False
        self._sent_s = now_s
        self.resent += 1
        return True

    def waited_s(self, now_s: float) -> float:
        """Time since the present tick has begun."""
        return now_s - self._begun_s

    def await_player(self, depth_ns: int | None) -> None:
        """The present tick is sent with a depth sample of this stamp, which the player follows; None: without one."""
        self._unplayed_ns = depth_ns

    def on_player(self, depth_ns: int) -> bool:
        """The player has sent all that belongs before the tick after this depth; returns whether it is the present."""
        self.player_present = True
        if depth_ns != self._unplayed_ns:
            return False
        self._unplayed_ns = None
        return True
