"""Whether a proposal may be applied: refused, never repaired."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose

from fsw_control.command_check import Flaw, refusal
from fsw_control.contract import Command, Limits


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
    if proposal.source != name:
        words = f"proposal names the source {proposal.source[:40]!r} instead of {name!r}"
        return Verdict(False, command, words, content=True)
    if not proposal.healthy:
        return Verdict(False, command, proposal.reason or "the controller says it is unhealthy, without a reason")
    refused = refusal(command, limits, previous, limits)
    if refused is not None:
        return Verdict(False, command, refused.words, content=True, jump=refused.flaw is Flaw.JUMP)
    return Verdict(True, command)


def same(one: Command, other: Command) -> bool:
    """Whether two commands differ by no more than the rounding of the unit conversion."""
    return isclose(one.force_kn, other.force_kn, rel_tol=1e-9) and isclose(one.speed_rpm, other.speed_rpm, rel_tol=1e-9)
