"""Counts messages that a publisher sent and the recorder never saw."""

from __future__ import annotations


class SequenceGaps:
    """Gaps in the publishers' sequence numbers, per topic.

    A gap is counted only while the topic has one publisher, because the numbers of several interleave. A number that
    goes back is a restarted publisher, not a loss.
    """

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._unconfirmed: dict[str, int] = {}
        self.lost: dict[str, int] = {}

    def note(self, topic: str, sequence: int) -> int:
        """Take up a received sequence number; returns how many are missing before it."""
        last = self._last.get(topic)
        self._last[topic] = sequence
        if last is None or sequence <= last + 1:
            return 0
        missing = sequence - last - 1
        self.report(topic, missing)
        self._unconfirmed[topic] = self._unconfirmed.get(topic, 0) + missing
        return missing

    def report(self, topic: str, missing: int) -> None:
        """Count messages that the middleware itself reports as lost."""
        self.lost[topic] = self.lost.get(topic, 0) + missing

    def confirm(self, topic: str) -> None:
        """Take what was counted so far as true: the topic's publishers have been the same all the time."""
        self._unconfirmed.pop(topic, None)

    def forget(self, topic: str) -> None:
        """Start anew because the topic's publishers changed; gaps not confirmed since are no longer counted."""
        self._last.pop(topic, None)
        mistaken = self._unconfirmed.pop(topic, 0)
        if mistaken:
            self.lost[topic] -= mistaken

    @property
    def total(self) -> int:
        """Lost messages of all topics."""
        return sum(self.lost.values())
