"""Every sequence of sent set-points, steps of clocks and repeats.

An accepted one is in force, a refusal is told.
"""

from __future__ import annotations

from itertools import product

import pytest

from fsw_control.contract import Reference
from fsw_control.references import AHEAD_REAL_NS, ReferenceQueue
from fsw_control.units import NANOSECONDS

#: by letter, how far the stamp is ahead of the measurements [s] (None: 0, at once) and the
#: sender's clock of the receiver's [s]
SENT: dict[str, tuple[float | None, float]] = {
    "at_once": (None, 0.0),
    "coming": (0.25, 0.0),
    "past": (-5.0, 0.0),
    "other_clock": (7200.0, 0.0),
    "sender_fast": (None, 60.0),
    "sender_a_little_fast": (None, 3.0),
    "sender_slow": (None, -60.0),
    "coming_of_a_sender_a_little_slow": (0.25, -3.0),
}
LETTERS = (*SENT, "repeated", "ten_seconds", "clock_back", "clock_forward")


class Listener:
    """One who follows set-points; each is told apart by its depth."""

    def __init__(self, listens_s: float) -> None:
        self.refused: list[str] = []
        self.queue = ReferenceQueue(AHEAD_REAL_NS, self.refused.append)
        self.now_s, self.tick_s = 1e6, 500.0
        self.held: list[Reference] = []
        self._joined_s = self.now_s
        self.queue.join(self._ns(self.now_s))
        self._pass(listens_s)
        self.accepted: list[
            tuple[int, float, Reference]
        ] = []  # place in the order, begin [s], set-point
        self._sent: list[tuple[int, Reference, int]] = []

    @staticmethod
    def _ns(time_s: float) -> int:
        return round(time_s * NANOSECONDS)

    def _pass(self, time_s: float) -> Reference | None:
        self.now_s += time_s
        self.tick_s += time_s
        in_force = self.queue.at(self._ns(self.tick_s))
        self.held += [in_force] if in_force else []
        return in_force

    def step(self, letter: str) -> None:
        if letter in SENT:
            self._send(*SENT[letter])
        elif letter == "repeated" and self._sent:
            self._pass(10.0)  # the middleware repeats what it keeps when a network is back
            stamp_ns, reference, published_ns = self._sent[0]
            self._hear(stamp_ns, reference, published_ns)
        elif letter in ("clock_back", "clock_forward"):
            self.now_s += 3600.0 if letter == "clock_forward" else -3600.0
        self._check(self._pass(10.0 if letter == "ten_seconds" else 0.1))

    def _send(self, ahead_s: float | None, clock_s: float) -> None:
        begins_s = 0.0 if ahead_s is None else self.tick_s + ahead_s
        reference = Reference(2.0 + 0.01 * len(self._sent), 850.0)
        sent = (self._ns(begins_s), reference, self._ns(self.now_s + clock_s))
        before = len(self.refused)
        if self._hear(*sent):
            # What is old, or may be, has its place by its publication, all else by its receipt.
            old = clock_s < -5.0 or sent[2] < self._ns(self._joined_s + 5.0)
            place = (
                sent[2]
                if old
                else max([sent[2], *(accepted[0] + 1 for accepted in self.accepted)])
            )
            self.accepted.append((place, begins_s, reference))
            self._sent.append(sent)
        else:
            repeat = (
                clock_s < -5.0 and self.now_s <= self._joined_s + 5.0
            )  # looks like what is repeated at the start
            assert repeat or len(self.refused) > before, "a refusal is told"

    def _hear(self, stamp_ns: int, reference: Reference, published_ns: int) -> bool:
        if self.now_s < self._joined_s:  # its clock has gone back: it has listened for long
            self._joined_s = self.now_s - 6.0
        return self.queue.receive(stamp_ns, reference, published_ns, self._ns(self.now_s))

    def _check(self, in_force: Reference | None) -> None:
        by_place = sorted(self.accepted, key=lambda accepted: accepted[0])
        begun = [
            reference for _, begins_s, reference in by_place if begins_s <= self.tick_s + 1e-6
        ]
        assert in_force == (begun[-1] if begun else None), (
            "of all that have begun, the one received last holds"
        )
        latest = max((set_points.depth_mm for set_points in begun), default=0.0)
        assert any(set_points.depth_mm >= latest for set_points in self.held) or not begun, (
            "an accepted one comes to hold"
        )


@pytest.mark.slow
@pytest.mark.parametrize("listens_s", [10.0, 0.1])
@pytest.mark.parametrize("first", LETTERS)
def test_every_sequence_of_set_points(first, listens_s):
    for rest in product(LETTERS, repeat=3):
        listener, letters = Listener(listens_s), (first, *rest)
        try:
            for letter in letters:
                listener.step(letter)
        except AssertionError as error:
            raise AssertionError(f"{' '.join(letters)}: {error}") from error
