"""When the next tick of lockstep may begin.

Lockstep makes a weld in simulated time independent of the machine's speed: time advances only when
the command for the present tick has arrived and the player has sent everything that precedes the
next one. Every wait has an end: a lost tick is sent again, a vanished player is not awaited.
"""

from __future__ import annotations

from math import inf

#: period of resending a tick, for a supervisor that was started while the tick was unanswered [s]
_REPEAT_S = 0.5


class Lockstep:
    """Waits for the answer to the present tick, and for the player's preceding messages.

    Times are on the steady clock.
    """

    def __init__(self) -> None:
        self.answered = True  #: the present tick has its command
        self.player_present = False  #: a player takes part
        self.resent = 0  #: number of repetitions of the present tick
        self._unplayed_ns: int | None = None
        self._begun_s = self._sent_s = 0.0
        self._repeat_s = inf

    @property
    def complete(self) -> bool:
        """Whether nothing is awaited any more."""
        return self.answered and not (self.player_present and self._unplayed_ns is not None)

    def begin(self, now_s: float) -> None:
        """Begin a tick."""
        self.answered, self.resent, self._repeat_s = False, 0, inf
        self._begun_s = self._sent_s = now_s

    def on_new_writer(self) -> None:
        """Note a new publisher of commands, which has seen neither the tick nor its answers."""
        self._repeat_s, self._sent_s = _REPEAT_S, -inf

    def must_repeat(self, now_s: float, timeout_s: float) -> bool:
        """Whether to resend the present tick: every ``timeout_s``, and for a new publisher."""
        if self.answered or now_s - self._sent_s < min(timeout_s, self._repeat_s):
            return False
        self._sent_s = now_s
        self.resent += 1
        return True

    def waited_s(self, now_s: float) -> float:
        """Time since the start of the present tick."""
        return now_s - self._begun_s

    def await_player(self, depth_ns: int | None) -> None:
        """Note the stamp of the tick's depth sample, which a player follows; None without one."""
        self._unplayed_ns = depth_ns

    def on_player(self, depth_ns: int) -> bool:
        """Note that the player has sent all before the tick after this depth; True if current."""
        self.player_present = True
        if depth_ns != self._unplayed_ns:
            return False
        self._unplayed_ns = None
        return True
