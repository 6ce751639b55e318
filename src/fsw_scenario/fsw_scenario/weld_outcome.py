"""How a weld ended or why it was refused, as facts."""

from __future__ import annotations

from typing import NamedTuple

from fsw_control.coded import Fact, Worded

FAILED, REFUSED = "failed", "refused"


class WeldEnd(Worded):
    """Why a weld ended, or never began, and what in it was not as its scenario has it."""

    OVER = "{scenario} is over after {time_s:g} s"
    CANCELLED = "cancelled; the supervisor is in safe_stop ({answer})"
    STOPPED = "safe stop by the supervisor: {why}"
    NO_CONTROLLER = "{absent}; start it, or name another one"
    SILENT = "{missing} for {time_s:g} s; is the graph running, on the same domain?"
    UNANSWERED = "its own goal is not answered for {time_s:g} s"
    OTHER_PLAYER = "another scenario player in the graph for {time_s:g} s"
    # beside them
    UNREQUESTED = "{controller} was in control for {time_s:.1f} s, not asked for"
    BY_HAND = "set-points by hand from {time_s:.1f} s on"
    # refused
    INVALID = "{error}"
    EMPTY = "scenario is empty; give a shipped one, a file, or YAML text"
    UNDER_WAY = "{scenario} is under way ({state}); abort it first"
    OTHER_SCENARIO = "this player has been started for {scenario}"
    TWO_PLAYERS = (
        "another scenario player would get the goal, too; end one, and send it again in 10 s"
    )
    BY_OPEN_LOOP = "{scenario} controls by hand: controllers and plant must be started with it"
    ON_CANISTER = (
        "{scenario} conducts heat in a canister: controllers and plant must be started with it"
    )
    NO_EMULATOR = (
        "{scenario} has disturbances or faults, which need the emulated plant, and none is found; "
        "where it has just been started, send the goal again in a second"
    )


class Outcome(NamedTuple):
    """End of a weld; ``verdict`` is ``done``, ``aborted``, ``failed``, or ``refused`` to begin."""

    verdict: str
    fact: Fact
    others: tuple[Fact, ...] = ()  #: deviations, or the state

    @property
    def words(self) -> str:
        """All of it in words."""
        return "; ".join(fact.words for fact in (self.fact, *self.others))
