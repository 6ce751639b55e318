"""The node that hosts a controller."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import nan
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.coded import Fact, RefusedError, Worded, several
from fsw_control.command_gate import answer
from fsw_control.common_parameters import ControllerParameters, hosted
from fsw_control.contract import Command, Controller, Proposal, Reference
from fsw_control.deadline_timer_ros import DeadlineTimer
from fsw_control.heat_plan import SHARE_NAME, HeatPlanProblem, PlanInForce, ReceivedHeat
from fsw_control.light_node_ros import LightNode
from fsw_control.message_synchronizer import SampleSet
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters import ParameterModel
from fsw_control.parameters_ros import ParameterValues, state_contents
from fsw_control.ramps import ReferencePlan
from fsw_control.ranges import attainable_of, out_of_reach
from fsw_control.reason import Reason
from fsw_control.references_ros import StatedReference, reference_queue, subscribe_references
from fsw_control.reports_ros import ERROR, OK, WARN, DiagnosticsPublisher, Report, told
from fsw_control.topics_ros import LATEST, SENT, STREAM, display_publisher, subscribe_sensors
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_control.weld_ticks_ros import WeldTicks
from fsw_msgs.msg import (
    ControllerStatus,
    DriveFeedback,
    HeatPlan,
    Prediction,
    WeldCommand,
    WeldProgress,
    WeldReferencePlan,
)

#: makes the controller from its parameters (empty if it has none)
Make = Callable[[dict[str, Any]], Controller]

#: share of the lockstep patience that remains for samples already missing at the previous tick
_KNOWN_LOST_SHARE = 0.2


class Note(Worded):
    """Diagnostics of the controller."""

    PROPOSING = "proposing"
    REASON = "{reason.words}"
    NO_MEASUREMENT = "no measurement received yet"
    STOPPED = "measurements have stopped"
    SENSOR = "{sensor}: {flaw}"
    OUT_OF_REACH = "set-point out of reach: {reach.words}"


class ControllerNode(LightNode, Node):  # type: ignore[misc]  # rclpy has no types everywhere
    """Steps a controller at every tick; publishes proposals, status, diagnostics and prediction.

    A tick is consumed when it is complete or when its deadline has passed. Time is that of the
    measurements: in simulated time nothing but data drives the node, apart from the deadline.

    Parameters
    ----------
    name : str
        Name of the controller, in topics and as the source of its proposals. The node is called
        ``fsw_<name>``.
    make : callable
        Makes the controller from its parameters.
    parameters : class, optional
        Model of the controller's own parameters (:mod:`fsw_control.parameters`). At runtime they
        are passed to the controller's ``check(values)`` and then to its ``configure(values)``, if
        it has these methods; ``use_logger(logger)`` gets the node's logger. ``rejoin()`` is called
        before the first step, and after a jump of time, if the actuators have been commanded
        before: what acted in the last seconds is unknown.
    """

    def __init__(self, name: str, make: Make, parameters: ParameterModel = None) -> None:
        super().__init__(f"fsw_{name}")
        self._settings = ParameterValues(self, ControllerParameters)
        self._own = ParameterValues(self, parameters)
        self.controller = make(self._own.values)
        if hasattr(self.controller, "use_logger"):
            self.controller.use_logger(self.get_logger())
        self._controller_name = name
        initial = Command(self._settings["initial_force"], self._settings["initial_speed"])
        self.controller.reset(initial)
        self._deviations = getattr(self.controller, "plan_deviations", None)
        self.references = reference_queue(self, self._on_bad_reference)
        self._plans = PlanInForce(ReferencePlan())
        self._heat = ReceivedHeat(self._on_bad_heat)
        self._heat_state, self._heat_share = "", nan
        self._guard = SensorGuard(sensor_limits(self._settings.values))
        self._last_ns: int | None = None
        self._last_proposal: Proposal | None = None
        self._lockstep = bool(self.get_parameter("use_sim_time").value)
        period_s = self._settings["period"]
        self._ticks = WeldTicks(self, self._consume, initial, period_s, self._lockstep)
        self.applied, self._synchronizer = self._ticks.applied, self._ticks.synchronizer
        self._health: tuple[bool, Reason] | None = None
        self._replaced: tuple[Reference | None, Reference | None] = None, None
        self._steps = 0
        self._unhealthy_steps = 0
        self.refused_references = 0
        self._last_refused_reference: Fact | None = None
        self._step_time_s = 0.0
        self._longest_step_s = 0.0
        self._stream_of_ticks = False
        self._commands_act: bool | None = None  # by the drives' last report; None before the first
        self._open_parameters()
        self._open_topics()

    def _open_parameters(self) -> None:
        self._settings.on_change(lambda values: self._guard.configure(sensor_limits(values)))
        state_contents(self, self._own)
        if hasattr(self.controller, "check"):
            self._own.add_check(self.controller.check)
        if hasattr(self.controller, "configure"):
            self._own.on_change(self.controller.configure)

    def _open_topics(self) -> None:
        topics = f"fsw/{self._controller_name}"
        self._proposals = self.create_publisher(WeldCommand, f"{topics}/proposal", SENT)
        self._statuses = self.create_publisher(ControllerStatus, f"{topics}/status", SENT)
        self._predictions = display_publisher(self, Prediction, f"{topics}/prediction")
        self._diagnostics = DiagnosticsPublisher(self)
        self._followed = StatedReference(self, f"{topics}/reference")
        self._deadline = DeadlineTimer(self, self._on_deadline)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._on_heartbeat, clock=steady)
        # Before the set-points, so that a peer that has discovered the subscription to those can
        # rely on this one, too.
        self.create_subscription(WeldReferencePlan, "fsw/reference_plan", self._on_plan, LATEST)
        self.create_subscription(HeatPlan, "fsw/heat_plan", self._on_heat_plan, LATEST)
        self.create_subscription(WeldProgress, "fsw/weld_progress", self._on_progress, LATEST)
        subscribe_references(self, self.references)
        self.create_subscription(WeldCommand, "fsw/command", self._ticks.on_command, STREAM)
        self.create_subscription(DriveFeedback, "fsw/drives", self._on_drives, STREAM)
        subscribe_sensors(self, self._ticks.on_sample)

    def _on_bad_reference(self, refusal: Fact) -> None:
        self.refused_references += 1
        self._last_refused_reference = refusal
        self.get_logger().error(refusal.words, throttle_duration_sec=1.0)

    def _on_plan(self, message: WeldReferencePlan) -> None:
        try:
            plan = ReferencePlan(convert.reference_plan(message))
        except RefusedError as error:
            self._on_bad_reference(error.fact)
        else:
            self._plans.receive(convert.stamp_ns(message.header.stamp), plan)

    def _on_drives(self, message: DriveFeedback) -> None:
        is_first = self._commands_act is None
        self._commands_act = convert.actuator_state(message).answered_ns > 0
        if is_first:
            self._rejoin()
        self._ticks.on_drives(convert.stamp_ns(message.header.stamp), convert.command(message))

    def _rejoin(self) -> None:
        """Before a step without history: call the controller's ``rejoin`` in mid-weld."""
        if self._commands_act and hasattr(self.controller, "rejoin"):
            self.controller.rejoin()

    def _on_heat_plan(self, message: HeatPlan) -> None:
        self._heat_state = message.type
        stamp_ns = convert.stamp_ns(message.header.stamp)
        self._heat.receive(convert.heat_plan(message), stamp_ns, self._last_ns)

    def _on_bad_heat(self, problem: HeatPlanProblem) -> None:
        self._heat_state = f"refused: {problem.words}"
        self.get_logger().error(f"heat plan {self._heat_state}", throttle_duration_sec=1.0)

    def _on_progress(self, message: WeldProgress) -> None:
        if message.state == "running":
            stamp_ns = convert.stamp_ns(message.header.stamp)
            self._heat.follow(units.mm_from_m(message.length), stamp_ns)
        elif message.state != "held":
            self._heat.restart()

    def _on_deadline(self) -> None:
        self._ticks.expire(self._patience_s())

    def _patience_s(self) -> float:
        if not self._lockstep:
            return float(self._settings["deadline"])
        # Lockstep waits long for samples that may still come, and shorter at every tick for
        # samples that are known to be lost.
        known_lost = self._synchronizer.lacking <= self._synchronizer.missed
        share = _KNOWN_LOST_SHARE if known_lost else 1.0
        return float(self._settings["lockstep_deadline"]) * share

    def _consume(self, ticks: list[SampleSet]) -> None:
        for tick in ticks:
            self._tick(tick)
        if self._lockstep and self._synchronizer.take_repeated():
            self._repeat()
        begun_s = self._synchronizer.begun_s
        self._deadline.set(begun_s + self._patience_s() if begun_s is not None else None)

    def _repeat(self) -> None:
        """Answer a tick that the plant repeats after a supervisor's restart or a lost answer."""
        if self._last_ns is not None and self._last_proposal is not None:
            self._publish(self._last_ns, self._last_proposal)

    def _tick(self, tick: SampleSet) -> None:
        if tick.restarted:
            self._guard.reset()
            self.applied.restart()
            self.controller.reset(self.applied.latest.command)
            self._rejoin()
            self._last_ns = None
            self._heat.jump()
            self.get_logger().warning("the measurements' time has jumped: the controller restarts")
        dt_s = self._settings["period"]
        if self._last_ns is not None:
            dt_s = (tick.stamp_ns - self._last_ns) / 1e9
        self._last_ns = tick.stamp_ns
        measurement = self._guard.measure(tick.stamp_ns * 1e-9, tick.values, tick.drives)
        reference, plan = self.references.at(tick.stamp_ns), self._plans.at(tick.stamp_ns)
        if reference is not None and (coming := plan.after(tick.stamp_ns, reference)):
            reference = replace(reference, coming=coming)
        if reference is not None and (heat := self._heat.at(tick.stamp_ns)):
            reference = replace(reference, heat=heat)
        begin = time.perf_counter()
        applied = self.applied.before(tick.stamp_ns)
        proposal = answer(self.controller, measurement, reference, applied, dt_s)
        elapsed_s = time.perf_counter() - begin
        self._last_proposal = proposal
        self._publish(tick.stamp_ns, proposal)
        self._replaced = reference, attainable_of(proposal.diagnosis.disturbances)
        self._followed.update(tick.stamp_ns, reference, self.references.issued_ns)
        self._heat_share = proposal.diagnosis.disturbances.get(SHARE_NAME, nan)
        self._steps += 1
        self._stream_of_ticks = True
        self._step_time_s += elapsed_s
        self._longest_step_s = max(self._longest_step_s, elapsed_s)
        self._unhealthy_steps += not proposal.healthy
        self._note_health(proposal)

    def _publish(self, time_ns: int, proposal: Proposal) -> None:
        name, command, healthy = self._controller_name, proposal.command, proposal.healthy
        message = convert.command_message(command, time_ns, name, healthy, proposal.reason)
        self._proposals.publish(message)
        try:
            tolerated, source = self.controller.tolerated_sensors, self.applied.latest.source
            self._statuses.publish(
                convert.status_message(proposal, time_ns, name, source, tolerated)
            )
            if (plan := proposal.diagnosis.plan) is not None:
                deviations = self._deviations(plan.time_s) if self._deviations else ((), ())
                self._predictions.publish(convert.prediction_message(plan, time_ns, deviations))
        except (TypeError, ValueError, AssertionError, AttributeError, IndexError) as error:
            # A user's controller may put anything into its diagnosis; its proposal is already out.
            text = f"diagnostics cannot be published: {error}"
            self.get_logger().error(text, throttle_duration_sec=1.0)

    def _note_health(self, proposal: Proposal) -> None:
        health = (proposal.healthy, Reason.of(proposal.reason))
        if health == self._health:
            return
        if not proposal.healthy:
            self.get_logger().warning(f"unhealthy: {health[1].words}", throttle_duration_sec=0.5)
        elif self._health is not None and not self._health[0]:
            self.get_logger().info("healthy again")
        self._health = health
        self._publish_diagnostics()

    def _on_heartbeat(self) -> None:
        self._publish_diagnostics()
        self._stream_of_ticks = False

    def _publish_diagnostics(self) -> None:
        healthy, why = self._health or (False, Reason())
        facts = [Fact.of(Note.REASON, reason=why)] if why else []
        if self._health is None:
            facts = [Fact.of(Note.NO_MEASUREMENT)]
        if self._steps and not self._stream_of_ticks and not self._lockstep:
            healthy, facts = False, [Fact.of(Note.STOPPED)]
        flaws = [(sensor, flaw) for sensor, flaw in self._guard.reasons.items() if flaw]
        faults = [Fact.of(Note.SENSOR, sensor=sensor, flaw=flaw) for sensor, flaw in flaws]
        requested, attainable = self._replaced
        out = out_of_reach(requested, attainable) if requested and attainable else None
        level = OK if healthy and not faults and not out else WARN
        if not healthy and self._steps:
            level = ERROR
        values: dict[str, object] = {
            "steps": self._steps,
            "unhealthy steps": self._unhealthy_steps,
            "mean step time [ms]": f"{1e3 * self._step_time_s / max(self._steps, 1):.4f}",
            "longest step time [ms]": f"{1e3 * self._longest_step_s:.4f}",
            "applied from": self.applied.latest.source,
            "commands ignored": self.applied.ignored,
            "set-points refused": self.refused_references,
            **told("last refused set-points", self._last_refused_reference),
            "jumps of time": self._synchronizer.stamps.jumps,
            "heat plan": self._heat_state,
            "share of known heat in use": f"{self._heat_share:.2f}",
        }
        for sensor, counts in self._synchronizer.counts.items():
            values |= {f"{sensor} {key}": count for key, count in counts.items()}
            values[f"{sensor} state"] = self._guard.reasons[sensor] or "good"
        facts = facts or faults or [Fact.of(Note.OUT_OF_REACH, reach=out)] * bool(out)
        summary = several(facts) or Fact.of(Note.PROPOSING)
        part = f"controller {self._controller_name}"
        self._diagnostics.publish([Report(part, level, summary, values)])


def run_controller(
    make: Callable[..., Controller],
    name: str | None = None,
    parameters: ParameterModel = None,
    args: Sequence[str] | None = None,
) -> int:
    """Run a controller as a node until it is stopped; returns the exit code.

    Parameters
    ----------
    make : callable
        The controller's class, or a function that makes one, with its parameters (if it has any)
        as the argument.
    name, parameters : optional
        As for :class:`ControllerNode`; by default the class attributes ``name`` and
        ``parameters``.
    args : sequence of str, optional
        Command line, ``sys.argv`` by default.
    """
    controller_name = name if name is not None else getattr(make, "name", None)
    if not isinstance(controller_name, str):
        text = "give name=..., or a controller class with a class attribute 'name'"
        raise TypeError(f"run_controller: {text}")
    source = parameters if parameters is not None else getattr(make, "parameters", None)
    made = make if source is not None else lambda _: make()
    about = f"Runs the controller {controller_name} as a node."
    arguments = NodeArguments(f"fsw_{controller_name}", about, hosted(source))
    return run(lambda: ControllerNode(controller_name, made, source), args, arguments)
