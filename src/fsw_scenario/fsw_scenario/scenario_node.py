"""Plays scenarios and weld programmes in the graph: at the start, or as ``fsw/run_weld`` goals.

Without a scenario the player waits for goals. Disturbances and faults of a scenario that is known
at the start are played by the plant itself (its parameter ``scenario``); those of a goal are
requested by its services.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from math import nan
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from fsw_control import units
from fsw_control.coded import Answer, Fact, RefusedError
from fsw_control.diagnostic_names import qualified
from fsw_control.light_node_ros import LightNode
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters_ros import ParameterValues
from fsw_control.schema.models import InputError
from fsw_control.topics_ros import STREAM
from fsw_model.heat_profile import HeatProfile
from fsw_msgs.action import RunWeld
from fsw_msgs.msg import WeldKpi, WeldProgress
from fsw_plant import PlantSchedule
from fsw_scenario.emulator_events_ros import emulator_listens
from fsw_scenario.launcher import ABORTED
from fsw_scenario.parameters import PlayerParameters
from fsw_scenario.running_kpi import FAILED, REFUSED, HeldFor, Outcome, RunningKpi, WeldEnd
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, parse
from fsw_scenario.weld_player_ros import PlayerOptions, WeldPlayer
from fsw_scenario.weld_programme import ProgrammeCode, State
from fsw_scenario.weld_programme_course import HeatAhead
from fsw_scenario.weld_programme_ros import serve

ACTION = "fsw/run_weld"
#: time limit for this node's answer to its own goal, on a stalled machine (chosen)
_OWN_GOAL_S = 60.0
#: time in which a player must see no other one before it begins, so that two that start together
#: see each other; the plant searches for other plants as long (chosen)
ALONE_S = 0.5


class ScenarioNode(LightNode, Node):
    """The player; ``source`` is a scenario that replaces the parameter ``scenario``.

    A scenario given at the start is a goal that the node sends to itself; the process ends with
    it. At most one player begins a weld in a namespace: of two that see each other none does,
    until one of them has left.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the scenario is invalid.
    """

    def __init__(self, source: str | None = None) -> None:
        super().__init__("fsw_scenario")
        self._settings = ParameterValues(self, PlayerParameters)
        text = self._settings["scenario"] if source is None else source
        #: the node's goal to itself
        self._own = (
            RunWeld.Goal(scenario=text, overrides=self._settings["overrides"]) if text else None
        )
        self._start = load(text, self._settings["overrides"]) if text else None
        heat_file = self._settings["heat_file"]
        self._heat = HeatProfile.from_file(heat_file) if heat_file else None
        self.weld: WeldPlayer | None = None
        self._goal: Any = None
        self._over: Future = Future()
        self.ended: Outcome | None = None  #: the own goal
        self.bag = ""  #: that the recorder of this weld writes
        self._recorder = qualified(self.get_namespace(), "fsw_recorder") + ": recording"
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, STREAM)
        self._server = ActionServer(
            self,
            RunWeld,
            ACTION,
            self._execute,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )
        serve(self, "abort", self._abort)
        self._client = None if self._own is None else ActionClient(self, RunWeld, ACTION)
        self._sent: Future | None = None
        self._alone_long = HeldFor(ALONE_S)
        self._began_s = time.monotonic()
        self.create_timer(0.05, self._on_watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        if self._own is None:
            self.get_logger().info(f"waiting for goals of {self.resolve_topic_name(ACTION)}")

    # ---------------------------------------------------------------- the scenario given at start

    def _on_watch(self) -> None:
        if self._client is None:
            return
        alone = self._is_alone()
        settled = self._alone_long(alone, time.monotonic())
        if self.ended is not None:
            self._end_process(self.ended)
        elif self._sent is None and settled and self._client.server_is_ready():
            self._sent = self._client.send_goal_async(self._own)
            self._sent.add_done_callback(self._on_answer)
        elif self.weld is None:
            silence_s = self._settings["silence_timeout_s"]
            if not alone:
                self.get_logger().warning(
                    f"another scenario player runs; this one waits {silence_s:g} s for it to end",
                    once=True,
                )
            patience_s = max(silence_s, _OWN_GOAL_S) if alone else silence_s
            if time.monotonic() - self._began_s > patience_s:
                code = WeldEnd.UNANSWERED if alone else WeldEnd.OTHER_PLAYER
                self.ended = Outcome(FAILED, Fact.of(code, time_s=patience_s))

    def _is_alone(self) -> bool:
        """Whether no other player would get the goal; killed ones persist until a lease ends."""
        return self.count_publishers(f"{self.resolve_topic_name(ACTION)}/_action/status") < 2

    def _on_answer(self, future: Future) -> None:
        handle: Any = future.result()
        handle.get_result_async().add_done_callback(self._on_own_result)

    def _on_own_result(self, future: Future) -> None:
        answer: Any = future.result()
        if answer.result.verdict == REFUSED:
            self.ended = Outcome(FAILED, Fact.of(WeldEnd.INVALID, error=answer.result.message))

    def _end_process(self, outcome: Outcome) -> None:
        """End the process, with an exit code after a failure."""
        if outcome.verdict != State.DONE:
            print(f"scenario: {outcome.words}", file=sys.stderr, flush=True)
            raise SystemExit(ABORTED if outcome.verdict == State.ABORTED else 1)
        self.get_logger().info(outcome.words)
        rclpy.try_shutdown()

    def destroy_node(self) -> None:
        """End; a scenario that was not played to its end is reported."""
        if self.weld is not None or (self._own is not None and self.ended is None):
            print("scenario: stopped before the end of the scenario", file=sys.stderr)
        # rclpy leaves actions to their owner, and a node lives as long as they do
        self._server.destroy()
        if self._client is not None:
            self._client.destroy()
        super().destroy_node()

    # ---------------------------------------------------------------- the action

    def scenario_of(self, goal: Any) -> Scenario:
        """The scenario of a goal; RefusedError or InputError if it cannot be played."""
        if self.weld is not None:
            state = self.weld.machine.describe().words
            raise RefusedError.of(WeldEnd.UNDER_WAY, scenario=self.weld.scenario.name, state=state)
        if self._start is not None:
            if goal != self._own or self.ended is not None:
                raise RefusedError.of(WeldEnd.OTHER_SCENARIO, scenario=self._start.name)
            return self._start
        if not self._is_alone():
            raise RefusedError.of(WeldEnd.TWO_PLAYERS)
        if not goal.scenario.strip():
            raise RefusedError.of(WeldEnd.EMPTY)
        as_text = "\n" in goal.scenario or goal.scenario.lstrip().startswith("{")
        scenario = (parse if as_text else load)(goal.scenario, overrides=list(goal.overrides))
        if scenario.open_loop or scenario.on_canister:
            code = WeldEnd.BY_OPEN_LOOP if scenario.open_loop else WeldEnd.ON_CANISTER
            raise RefusedError.of(code, scenario=scenario.name)
        if PlantSchedule.of(scenario.events).events and not emulator_listens(self):
            raise RefusedError.of(WeldEnd.NO_EMULATOR, scenario=scenario.name)
        return scenario

    def _on_accepted(self, handle: Any) -> None:
        """Begin the weld of a goal, or answer with a reason: a rejection cannot carry one."""
        try:
            scenario = self.scenario_of(handle.request)
            heat = None if self._heat is None else HeatAhead(self._heat, scenario.phases)
        except (InputError, RefusedError) as error:
            why = getattr(error, "fact", None) or Fact.of(WeldEnd.INVALID, error=error)
            self.get_logger().error(f"goal refused: {why.words}")
            handle.execute(lambda refused: _refuse(refused, why))
            return
        options = PlayerOptions(
            self._settings["wait_for_controllers"],
            self._settings["silence_timeout_s"],
            self._start is not None,
            heat,
        )
        if scenario.plant and self._start is None:
            self.get_logger().warning(
                f"the plant is running and keeps its parameters; "
                f"those of {scenario.name} are not applied: "
                + ", ".join(f"{name}={value}" for name, value in scenario.plant.items())
            )
        self._goal, self._over = handle, Future()
        self.weld = WeldPlayer(self, scenario, options, self._on_progress, self._over.set_result)
        handle.execute()

    def _abort(self, who: str = "") -> Answer:
        return self.weld.abort(who) if self.weld else Answer.refused(ProgrammeCode.NO_WELD)

    def _on_cancel(self, _: Any) -> CancelResponse:
        answer = self._abort()
        if not answer.ok:
            self.get_logger().warning(f"cancel: {answer.fact.words}")
            return CancelResponse.REJECT
        self.get_logger().info(f"cancel: {answer.fact.words}")
        return CancelResponse.ACCEPT

    def _on_progress(self, progress: WeldProgress) -> None:
        if self.weld is not None and self._goal is not None:
            self._goal.publish_feedback(
                RunWeld.Feedback(progress=progress, kpi=_kpi(self.weld.kpi))
            )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Note the bag written by the weld's recorder."""
        for status in message.status:
            if status.name == self._recorder:
                self.bag = next(
                    (pair.value for pair in status.values if pair.key == "bag"), self.bag
                )

    async def _execute(self, handle: Any) -> Any:
        weld = self.weld
        assert weld is not None
        outcome = await self._over
        self.weld = self._goal = None
        if self._start is not None:  # known here, whenever the result of the own goal arrives
            self.ended = outcome
        if outcome.verdict == State.DONE:
            handle.succeed()
        elif outcome.verdict == State.ABORTED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        weld.destroy()
        if self._start is None:
            self.get_logger().info(f"{outcome.verdict}: {outcome.words}")
        by_hand_s = weld.deviations.by_hand_from_s
        return RunWeld.Result(
            verdict=str(outcome.verdict),
            code=str(outcome.fact.code),
            message=outcome.words,
            unrequested=[*weld.deviations.others_s],
            unrequested_time=[*weld.deviations.others_s.values()],
            by_hand_from=nan if by_hand_s is None else by_hand_s,
            bag=self.bag,
            kpi=_kpi(weld.kpi),
        )


def _refuse(handle: Any, why: Fact) -> Any:
    handle.abort()
    return RunWeld.Result(verdict=REFUSED, code=str(why.code), message=why.words, by_hand_from=nan)


def _kpi(kpi: RunningKpi) -> WeldKpi:
    return WeldKpi(
        depth_iae=units.m_from_mm(kpi.depth_iae),
        temperature_iae=kpi.temperature_iae,
        depth_max_error=units.m_from_mm(kpi.depth_max_error),
        temperature_max_error=kpi.temperature_max_error,
    )


def main(args: Sequence[str] | None = None) -> int:
    """Play a scenario; ``args`` as ``sys.argv``, with an optional scenario before ``--ros-args``.

    Returns
    -------
    int
        0 if the scenario was played to its end, or stopped before (which is reported); 1 if it
        cannot continue, 2 if an argument is invalid, 3 if the programme was aborted.
    """
    parameters = PlayerParameters
    return run(
        ScenarioNode, args, NodeArguments("fsw_scenario", __doc__ or "", parameters, "[SCENARIO]")
    )


if __name__ == "__main__":
    sys.exit(main())
