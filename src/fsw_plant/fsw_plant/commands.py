"""Which commands the plant obeys."""

from __future__ import annotations

from dataclasses import dataclass

from fsw_control import Command
from fsw_control.command_check import Flaw, refusal

#: Why a command can be refused.
REASONS = ("not_finite", "out_of_range", "unhealthy", "source", "repeated", "too_old", "future")


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """Bounds and rates of the drives, see ``plant.yaml``."""

    force_min_kn: float
    force_max_kn: float
    speed_min_rpm: float
    speed_max_rpm: float
    force_rate_kn_per_s: float
    speed_rate_rpm_per_s: float


class CommandGate:
    """Checks commands and counts what it refuses.

    Attributes
    ----------
    refused : dict of str to int
        How many commands were refused for each of ``REASONS``.
    last_refusal : str
        The last refusal in words.
    """

    def __init__(self, limits: LimitsConfig, max_age_s: float, sources: tuple[str, ...]) -> None:
        self.refused = dict.fromkeys(REASONS, 0)
        self.last_refusal = ""
        self.last_stamp_ns: int | None = None
        self.configure(limits, max_age_s, sources)

    def configure(self, limits: LimitsConfig, max_age_s: float, sources: tuple[str, ...]) -> None:
        """Change what is allowed; no sources: any."""
        self.limits = limits
        self.sources = frozenset(sources)
        self._max_age_ns = round(max_age_s * 1e9)

    def check(
        self, command: Command, stamp_ns: int, source: str, healthy: bool, measured_ns: int | None
    ) -> Command | str:
        """Check one command.

        Parameters
        ----------
        command : Command
            The command.
        stamp_ns : int
            Stamp of the measurement that it answers.
        source : str
            Who computed it.
        healthy : bool
            Whether its sender says that it may be applied.
        measured_ns : int or None
            Stamp of the plant's last measurement; None before the first.

        Returns
        -------
        Command or str
            The command to apply, or why it is refused (one of ``REASONS``).
        """
        limits, force, speed = self.limits, command.force_kn, command.speed_rpm
        if self.sources and source not in self.sources:
            return self._refuse("source", f"source {source!r} is none of {', '.join(sorted(self.sources))}")
        refused = refusal(command, limits)
        if refused is not None and refused.flaw is Flaw.NOT_FINITE:
            return self._refuse(refused.flaw, refused.words)
        if not healthy:
            return self._refuse("unhealthy", f"{source!r} marked it as not to be applied")
        if refused is not None:
            return self._refuse(refused.flaw, refused.words)
        if measured_ns is None or stamp_ns > measured_ns:
            return self._refuse("future", f"it answers {stamp_ns * 1e-9:.1f} s, which has not been measured yet")
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns:
            return self._refuse("repeated", f"{stamp_ns * 1e-9:.1f} s or a later measurement has been answered already")
        if measured_ns - stamp_ns > self._max_age_ns:
            return self._refuse("too_old", f"it answers a measurement {(measured_ns - stamp_ns) * 1e-9:.1f} s old")
        self.last_stamp_ns = stamp_ns
        force_kn = min(max(force, limits.force_min_kn), limits.force_max_kn)
        speed_rpm = min(max(speed, limits.speed_min_rpm), limits.speed_max_rpm)
        return command if force == force_kn and speed == speed_rpm else Command(force_kn, speed_rpm)

    def _refuse(self, reason: str, words: str) -> str:
        self.refused[reason] += 1
        self.last_refusal = f"{reason}: {words}"
        return reason

    def total(self) -> int:
        """Commands refused, for whatever reason."""
        return sum(self.refused.values())
