"""A weld programme on topics and services: progress, hold, resume, and the abort's safe stop."""

from __future__ import annotations

from collections.abc import Callable
from math import radians

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.coded import Answer, Fact
from fsw_control.reason import Reason
from fsw_control.reports_ros import OK, WARN, log
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_msgs.msg import SupervisorState, WeldProgress
from fsw_msgs.srv import OperatorRequest, SetMode
from fsw_scenario.running_kpi import WeldEnd
from fsw_scenario.scenario import Scenario
from fsw_scenario.set_points_ros import SetPoints
from fsw_scenario.weld_programme import PhaseMachine, ProgrammeCode, State
from fsw_supervisor.state_machine import Mode

#: ticks between two progress reports
TICKS_PER_REPORT = 10
#: time limit for the delivery of the last message to subscribers
_DELIVERY = Duration(seconds=1.0)


class SafeStop:
    """Requests the safe stop of an aborted weld; ``answer`` is None until there is an answer."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self.answer: Fact | None = None
        self.who = ""  #: the operator who has aborted the weld
        self.controller = ""  #: in control, by the supervisor's last report
        self._asked: Future | None = None
        self._set_mode = node.create_client(SetMode, "fsw/set_mode")
        self._states: Subscription | None = None

    def watch(self, abort: Callable[[], Answer]) -> None:
        """Call ``abort`` on a safe stop from elsewhere; it answers whether a weld was aborted."""

        def on_state(message: SupervisorState) -> None:
            self.controller = message.actual_controller
            if message.actual_mode == Mode.SAFE_STOP and abort().ok:
                why = Reason.of_messages(message.why).words
                self.answer = Fact.of(WeldEnd.STOPPED, why=why)

        self._states = self._node.create_subscription(
            SupervisorState, "fsw/supervisor/state", on_state, LATEST
        )

    def ask(self) -> None:
        """Request repeatedly until the supervisor has answered; call it often."""
        if self.answer is not None:
            return
        if self._asked is not None and self._asked.done():
            answer = self._asked.result()
            if answer is not None and answer.ok:
                self.answer = Fact.of(WeldEnd.CANCELLED, answer=answer.code)
                return
            self._asked = None
        if self._asked is None and self._set_mode.service_is_ready():
            request = convert.mode_request(str(Mode.SAFE_STOP), who=self.who)
            self._asked = self._set_mode.call_async(request)
        elif self._asked is None:
            self._node.get_logger().error(
                "abort: no supervisor to ask for a safe stop; start one", throttle_duration_sec=1.0
            )

    def destroy(self) -> None:
        """Leave the graph."""
        self._node.destroy_client(self._set_mode)
        if self._states is not None:
            self._node.destroy_subscription(self._states)


def serve(node: Node, name: str, ask: Callable[[str], Answer]) -> Service:
    """Create the service ``fsw/weld/NAME``; ``ask`` gets the operator who asks."""

    def on_request(
        request: OperatorRequest.Request, response: OperatorRequest.Response
    ) -> OperatorRequest.Response:
        answer = ask(request.who)
        response.ok, response.code = answer.ok, str(answer.fact.code)
        response.message = answer.fact.words
        log(node, OK if answer.ok else WARN, f"{name}: {response.message}")
        return response

    return node.create_service(OperatorRequest, f"fsw/weld/{name}", on_request)


class ProgrammeServer:
    """Reports the progress of a weld, and serves ``fsw/weld/hold|resume``.

    ``feed_back`` gets every report. With phases they are published on ``fsw/weld_progress``, too;
    a scenario without phases refuses to be held.
    """

    def __init__(
        self,
        node: Node,
        scenario: Scenario,
        machine: PhaseMachine,
        set_points: SetPoints,
        feed_back: Callable[[WeldProgress], object],
    ) -> None:
        self._node, self._scenario, self._machine = node, scenario, machine
        self._set_points, self._course = set_points, set_points.course
        self._feed_back = feed_back
        self._stamp_ns = 0
        self._reported: tuple[object, ...] | None = None
        self._ticks_since_report = 0
        self._publisher: Publisher | None = None
        if scenario.phases:
            self._publisher = node.create_publisher(WeldProgress, "fsw/weld_progress", LATCHED)
        self._services = [
            serve(node, name, ask)
            for name, ask in (("hold", self._hold), ("resume", self._resume))
        ]

    def destroy(self) -> None:
        """Leave the graph after delivery of the last message, the end of the weld."""
        if self._publisher is not None:
            self._publisher.wait_for_all_acked(_DELIVERY)
            self._node.destroy_publisher(self._publisher)
        for service in self._services:
            self._node.destroy_service(service)

    def _hold(self, _: str) -> Answer:
        return self._no_phases() or self._keep(self._machine.hold())

    def abort(self) -> Answer:
        """Abort the weld. The caller requests the safe stop."""
        return self._keep(self._machine.abort())

    def _no_phases(self) -> Answer | None:
        if self._scenario.phases:
            return None
        return Answer.refused(ProgrammeCode.NO_PHASES, scenario=self._scenario.name)

    def _keep(self, answer: Answer) -> Answer:
        """Keep the set-points in force; sending them voids those sent ahead."""
        if answer.ok:
            present = self._set_points.in_force()
            self._course.leave()
            self._set_points.restart(present)
            self.publish(self._stamp_ns)
        return answer

    def _resume(self, _: str) -> Answer:
        """Return to the programme from a hold or from manual set-points."""
        if refused := self._no_phases():
            return refused
        machine = self._machine
        by_hand = machine.state is State.RUNNING and not self._course.followed
        answer = Answer(True, machine.describe()) if by_hand else machine.resume()
        if not answer.ok:
            return answer
        present = self._set_points.in_force()
        way = self._course.resume(present, machine.tick)
        self._set_points.restart(present)
        self.publish(self._stamp_ns)
        return Answer.done(ProgrammeCode.RESUMED, at=answer.fact, way=way.fact)

    def on_tick(self, stamp_ns: int) -> None:
        """Report the progress when due."""
        self._stamp_ns = stamp_ns
        self._ticks_since_report += 1
        if self._state() != self._reported or self._ticks_since_report >= TICKS_PER_REPORT:
            self.publish(stamp_ns)

    def _state(self) -> tuple[object, ...]:
        """Fields whose changes are reported at once."""
        now = self._machine.progress()
        # the way back depends on the set-points in force
        left_for = None if self._course.followed else self._set_points.in_force()
        planned = self._set_points.planned() if self._scenario.phases else None
        return now.state, now.phase, left_for, planned

    def publish(self, stamp_ns: int) -> None:
        """Report the progress."""
        now, planned, way_s = self._machine.progress(), self._set_points.planned(), 0.0
        left = not self._course.followed
        if left and self._scenario.phases:
            present = self._set_points.in_force()
            way_s = self._course.way_back(present, self._machine.tick).duration_s
        self._reported, self._ticks_since_report = self._state(), 0
        message = WeldProgress(
            header=convert.header(stamp_ns),
            state=str(now.state),
            phase=now.phase,
            angle=radians(now.angle_deg),
            length=units.m_from_mm(now.length_mm),
            time_left=now.time_left_s,
            depth=units.m_from_mm(planned.depth_mm),
            temperature=planned.temperature_c,
            left=left,
            way_back=way_s,
        )
        if self._publisher is not None:
            self._publisher.publish(message)
        self._feed_back(message)
