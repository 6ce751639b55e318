"""How a weld ended or why it was refused, as facts."""

from __future__ import annotations

from typing import NamedTuple

from fsw_control.coded import Fact, Worded

FAILED, REFUSED = "failed", "refused"


class WeldEnd(Worded):
    """Why a weld ended, or never began, and what in it was not as its scenario has it."""

    OVER = "over", "{scenario} is over after {time_s:g} s"
    CANCELLED = "cancelled", "cancelled; the supervisor is in safe_stop ({answer})"
    STOPPED = "stopped", "safe stop by the supervisor: {why}"
    NO_CONTROLLER = "no_controller", "{absent}; start it, or name another one"
    SILENT = "silent", "{missing} for {time_s:g} s; is the graph running, on the same domain?"
    UNANSWERED = "unanswered", "its own goal is not answered for {time_s:g} s"
    OTHER_PLAYER = "other_player", "another scenario player in the graph for {time_s:g} s"
    # beside them
    UNREQUESTED = "unrequested", "{controller} was in control for {time_s:.1f} s, not asked for"
    BY_HAND = "by_hand", "set-points by hand from {time_s:.1f} s on"
    # refused
    INVALID = "invalid", "{error}"
    EMPTY = "empty", "scenario is empty; give a shipped one, a file, or YAML text"
    UNDER_WAY = "under_way", "{scenario} is under way ({state}); abort it first"
    OTHER_SCENARIO = "other_scenario", "this player has been started for {scenario}"
    TWO_PLAYERS = (
        "two_players",
        "another scenario player would get the goal, too; end one, and send it again in 10 s",
    )
    BY_OPEN_LOOP = (
        "by_open_loop",
        "{scenario} controls by hand: controllers and plant must be started with it",
    )
    ON_CANISTER = (
        "on_canister",
        "{scenario} conducts heat in a canister: controllers and plant must be started with it",
    )
    NO_EMULATOR = (
        "no_emulator",
        "{scenario} has disturbances or faults, which need the emulated plant, and none is found; "
        "where it has just been started, send the goal again in a second",
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
