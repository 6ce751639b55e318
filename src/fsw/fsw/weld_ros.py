"""Sends and cancels goals of the action ``fsw/run_weld``; holds and resumes a programme."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable
from math import degrees, inf
from typing import Any

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient

from fsw.errors import CommandError
from fsw.operator_node import Operator, ask, domain_text, operator
from fsw_control import units
from fsw_msgs.action import RunWeld
from fsw_msgs.srv import OperatorRequest
from fsw_scenario.running_kpi import REFUSED
from fsw_scenario.scenario_file import load
from fsw_scenario.weld_programme import State

_ACTION = "fsw/run_weld"
#: weld time between two lines of feedback if stdout is not a terminal [s]
_LOGGED_EVERY_S = 10.0


def weld(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return {"run": run, "abort": abort_weld}.get(arguments.verb, hold_or_resume)(arguments)


def run(arguments: argparse.Namespace) -> int:
    """Run a scenario and follow it; exit code 1 if the weld was not completed."""
    # errors in it are shown before anything is sent
    scenario = load(arguments.scenario, arguments.set)
    with operator(arguments) as node:
        try:
            outcome = follow(node, RunWeld.Goal(scenario=scenario.text))
        except KeyboardInterrupt:
            raise KeyboardInterrupt("the weld continues; 'fsw.py weld abort' ends it") from None
    kpi = outcome.kpi
    print(f"{outcome.verdict}: {outcome.message}")
    print(f"IAE: {units.mm_from_m(kpi.depth_iae):.4g} mm s, {kpi.temperature_iae:.4g} degC s")
    print(
        f"largest error: {units.mm_from_m(kpi.depth_max_error):.4g} mm, "
        f"{kpi.temperature_max_error:.4g} degC"
    )
    print(f"bag: {outcome.bag or 'none is recorded'}")
    return 0 if outcome.verdict == State.DONE else 1


def hold_or_resume(arguments: argparse.Namespace) -> int:
    """Stop the travel of the programme, or resume it."""
    return ask(arguments, OperatorRequest, f"fsw/weld/{arguments.verb}")


def abort_weld(arguments: argparse.Namespace) -> int:
    """Abort the weld that is under way."""
    with operator(arguments) as node:
        aborted = abort(node)
    if not aborted:
        raise CommandError("no weld is under way that could be aborted")
    print("the weld is aborted; the safe stop is requested")
    return 0


def abort(node: Operator) -> bool:
    """Cancel any goal; returns whether there was one."""
    return bool(
        node.call(
            CancelGoal, f"{_ACTION}/_action/cancel_goal", CancelGoal.Request()
        ).goals_canceling
    )


def follow(node: Operator, goal: Any, over: Callable[[], object] = lambda: False) -> Any:
    """Send a goal and print its feedback; returns the result, None if an abort does not end it.

    The answer to the goal is awaited as long as the player is present: a weld that begins late is
    followed, too. When ``over`` becomes true the weld is aborted, a late one as soon as it begins.
    """
    client = ActionClient(node.node, RunWeld, _ACTION)
    if not node.wait_until(client.server_is_ready):
        full = node.node.resolve_topic_name(_ACTION)
        raise CommandError(
            f"no node offers {full} on {domain_text()}: is the scenario player running there?"
        )
    answer = client.send_goal_async(goal, feedback_callback=FeedbackLines(sys.stdout.isatty()))
    if not node.wait_until(answer.done):
        print("waiting for the scenario player's answer", file=sys.stderr, flush=True)
        node.wait_until(lambda: answer.done() or not client.server_is_ready(), float("inf"))
    if not answer.done():
        raise CommandError("the scenario player has left before it answered")
    result = answer.result().get_result_async()
    node.wait_until(lambda: result.done() or over(), float("inf"))
    if not result.done():
        # without an answer the result does not come either
        with contextlib.suppress(CommandError):
            abort(node)
        node.wait_until(result.done)
    outcome = result.result().result if result.done() else None
    if outcome is not None and outcome.verdict == REFUSED:
        raise CommandError(outcome.message)
    return outcome


class FeedbackLines:
    """Prints the feedback of a weld: all on a terminal, else at changes and every ten seconds."""

    def __init__(self, all_of_it: bool) -> None:
        self._all = all_of_it
        #: state and phase of the last line, and the time left then
        self._at, self._left_s = ("", ""), inf

    def __call__(self, message: Any) -> None:
        """Print a line if one is due."""
        now, kpi = message.feedback.progress, message.feedback.kpi
        at = (now.state, now.phase)
        is_soon = abs(self._left_s - now.time_left) < _LOGGED_EVERY_S
        if not self._all and at == self._at and is_soon:
            return
        self._at, self._left_s = at, now.time_left
        where = (
            f"{now.phase} {degrees(now.angle):.1f} deg, {now.length:.3f} m, " if now.phase else ""
        )
        errors = f"IAE {units.mm_from_m(kpi.depth_iae):.4g} mm s, {kpi.temperature_iae:.4g} degC s"
        print(f"{now.state}: {where}{now.time_left:.1f} s left, {errors}", flush=True)
