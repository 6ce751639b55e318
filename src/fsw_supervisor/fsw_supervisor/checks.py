"""Whether a proposal may be applied: refused, never repaired."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose, isfinite

from fsw_control.contract import Command, Limits

#: largest excess over a limit that is rounding of the unit conversion and not a violation [kN, rpm]
ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class ProposalInput:
    """A proposal as it came in.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the measurement that it answers.
    source : str
        Who claims to have computed it.
    command : Command
        The proposed handles.
    healthy : bool
        The controller's own opinion.
    reason : str
        Its reason, in words.
    """

    stamp_ns: int
    source: str
    command: Command
    healthy: bool = True
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of the check; ``reason`` is empty when ``ok``.

    ``content`` tells a refusal for the content of the message from the controller's own unhealthy flag, ``jump`` one
    for the distance from the command before.
    """

    ok: bool
    command: Command
    reason: str = ""
    content: bool = False
    jump: bool = False


def check(name: str, proposal: ProposalInput, previous: Command | None, limits: Limits) -> Verdict:
    """Check one proposal.

    Parameters
    ----------
    name : str
        Name of the controller whose topic carried it.
    proposal : ProposalInput
        What it proposes.
    previous : Command or None
        Command applied in the tick before; None: unknown, the rate is not checked.
    limits : Limits
        Bounds and largest change per tick.

    Returns
    -------
    Verdict
        Good, or refused with the first reason found.
    """
    command = proposal.command

    def refuse(reason: str, jump: bool = False) -> Verdict:
        return Verdict(False, command, reason, content=True, jump=jump)

    if proposal.source != name:
        return refuse(f"proposal names the source {proposal.source[:40]!r} instead of {name!r}")
    if not proposal.healthy:
        return Verdict(False, command, proposal.reason or "the controller says it is unhealthy, without a reason")
    if not (isfinite(command.force_kn) and isfinite(command.speed_rpm)):
        return refuse(f"not finite: force {command.force_kn} kN, speed {command.speed_rpm} rpm")
    if not limits.force_min_kn - ROUNDING <= command.force_kn <= limits.force_max_kn + ROUNDING:
        return refuse(
            f"force {command.force_kn:.3f} kN is outside {limits.force_min_kn:g} to {limits.force_max_kn:g} kN"
        )
    if not limits.speed_min_rpm - ROUNDING <= command.speed_rpm <= limits.speed_max_rpm + ROUNDING:
        return refuse(
            f"speed {command.speed_rpm:.3f} rpm is outside {limits.speed_min_rpm:g} to {limits.speed_max_rpm:g} rpm"
        )
    if previous is not None:
        force_step = abs(command.force_kn - previous.force_kn)
        speed_step = abs(command.speed_rpm - previous.speed_rpm)
        if force_step > limits.force_step_kn + ROUNDING:
            text = f"force would jump by {force_step:.3f} kN, more than {limits.force_step_kn:g} kN per tick"
            return refuse(text, jump=True)
        if speed_step > limits.speed_step_rpm + ROUNDING:
            text = f"speed would jump by {speed_step:.3f} rpm, more than {limits.speed_step_rpm:g} rpm per tick"
            return refuse(text, jump=True)
    return Verdict(True, command)


def same(one: Command, other: Command) -> bool:
    """Whether two commands differ by no more than the rounding of the unit conversion."""
    return isclose(one.force_kn, other.force_kn, rel_tol=1e-9) and isclose(one.speed_rpm, other.speed_rpm, rel_tol=1e-9)
