"""Which commands the plant accepts."""

from __future__ import annotations

from fsw_control import Command
from fsw_control.command_check import Flaw, refusal
from fsw_plant.config import PlantConfig

#: Why a command can be refused.
REASONS = ("not_finite", "out_of_range", "unhealthy", "source", "repeated", "too_old", "future")


class CommandGate:
    """Checks commands and counts what it refuses.

    Attributes
    ----------
    sources : tuple of str
        Whose commands are accepted; empty: all.
    refused : dict of str to int
        How many commands were refused for each of ``REASONS``.
    last_refusal : str
        The last refusal in words.
    last_stamp_ns : int or None
        Stamp of the last measurement that was answered.
    """

    def __init__(self, config: PlantConfig) -> None:
        self.config = config
        self.sources: tuple[str, ...] = tuple(config["commands.sources"])
        self.refused = dict.fromkeys(REASONS, 0)
        self.last_refusal = ""
        self.last_stamp_ns: int | None = None

    def check(self, command: Command, stamp_ns: int, source: str, healthy: bool, measured_ns: int | None) -> str:
        """Why a command is refused (one of ``REASONS``), empty if it is accepted.

        The arguments are those of ``PlantEmulator.apply``, and the stamp of the plant's last measurement, None before
        the first.
        """
        reason, words = self._refusal(command, stamp_ns, source, healthy, measured_ns)
        if reason:
            self.refused[reason] += 1
            self.last_refusal = f"{reason}: {words}"
        else:
            self.last_stamp_ns = stamp_ns
        return reason

    def _refusal(
        self, command: Command, stamp_ns: int, source: str, healthy: bool, measured_ns: int | None
    ) -> tuple[str, str]:
        if self.sources and source not in self.sources:
            return "source", f"source {source!r} is none of {', '.join(sorted(self.sources))}"
        wrong = refusal(command, self.config.limits)
        if not healthy and (wrong is None or wrong.flaw is not Flaw.NOT_FINITE):
            return "unhealthy", f"{source!r} marked it as not to be applied"
        if wrong is not None:
            return wrong
        if measured_ns is None or stamp_ns > measured_ns:
            return "future", f"it answers {stamp_ns * 1e-9:.1f} s, which has not been measured yet"
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns:
            return "repeated", f"{stamp_ns * 1e-9:.1f} s or a later measurement has been answered already"
        if measured_ns > stamp_ns and measured_ns - stamp_ns > round(self.config["commands.max_age_s"] * 1e9):
            return "too_old", f"it answers a measurement {(measured_ns - stamp_ns) * 1e-9:.1f} s old"
        return "", ""

    def total(self) -> int:
        """Commands refused, for whatever reason."""
        return sum(self.refused.values()) if self.last_refusal else 0
