"""The programme of a weld on topics and services: progress; hold, resume and abort."""

from __future__ import annotations

from collections.abc import Callable
from math import nan, radians

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.topics_ros import LATEST
from fsw_experiment.weld_programme import PhaseMachine, State
from fsw_msgs.msg import SupervisorState, WeldProgress
from fsw_msgs.srv import SetMode

_TICKS_PER_REPORT = 10
SAFE_STOP = "safe_stop"


class ProgrammeServer:
    """Publishes ``fsw/weld_progress``, serves ``fsw/weld/hold|resume|abort`` and asks the supervisor for a safe stop.

    A safe stop that comes from elsewhere aborts the programme as well.

    Parameters
    ----------
    node : Node
    machine : PhaseMachine
    on_hold, on_resume : callable
        Called after the transition; ``on_hold`` also when the weld is aborted.

    Attributes
    ----------
    stopped : str
        The supervisor's answer, once an aborted weld is in the safe state.
    """

    def __init__(
        self, node: Node, machine: PhaseMachine, on_hold: Callable[[], object], on_resume: Callable[[], object]
    ) -> None:
        self._node, self.machine, self._on_hold = node, machine, on_hold
        self.stopped = ""
        self._asked: Future | None = None
        self._stamp_ns = 0
        self._told: tuple[State, str] | None = None
        self._told_tick = 0
        self._publisher = node.create_publisher(WeldProgress, "fsw/weld_progress", LATEST)
        self._set_mode = node.create_client(SetMode, "fsw/set_mode")
        for name, ask, then in (
            ("hold", machine.hold, on_hold),
            ("resume", machine.resume, on_resume),
            ("abort", machine.abort, on_hold),  # the node asks for the safe stop at its next turn
        ):
            self._serve(name, ask, then)
        node.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_supervisor, LATEST)

    def _serve(self, name: str, ask: Callable[[], tuple[bool, str]], then: Callable[[], object]) -> None:
        def on_request(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = ask()
            if response.success:
                self._node.get_logger().info(f"{name}: {response.message}")
                then()
                self.publish(self._stamp_ns)
            else:
                self._node.get_logger().warning(f"{name}: {response.message}")
            return response

        self._node.create_service(Trigger, f"fsw/weld/{name}", on_request)

    def _on_supervisor(self, message: SupervisorState) -> None:
        if message.actual_mode == SAFE_STOP and self.machine.abort()[0]:
            self._on_hold()
            self.stopped = f"safe stop by the supervisor: {message.reason}"

    def ask_safe_stop(self) -> None:
        """Ask the supervisor for the safe stop, again and again until it has answered; only for an aborted weld."""
        if self.machine.state is not State.ABORTED or self.stopped:
            return
        if self._asked is not None and self._asked.done():
            answer = self._asked.result()
            if answer is not None and answer.ok:
                self.stopped = str(answer.message)
                return
            self._asked = None
        if self._asked is None and self._set_mode.service_is_ready():
            self._asked = self._set_mode.call_async(SetMode.Request(mode=SAFE_STOP, axial_force=nan, spindle_speed=nan))
        elif self._asked is None:
            self._node.get_logger().error(
                "abort: no supervisor to ask for a safe stop; start one", throttle_duration_sec=1.0
            )

    def on_tick(self, stamp_ns: int) -> None:
        """Report where due."""
        self._stamp_ns = stamp_ns
        self._told_tick += 1
        now = self.machine.progress()
        if (now.state, now.phase) != self._told or self._told_tick >= _TICKS_PER_REPORT:
            self.publish(stamp_ns)

    def publish(self, stamp_ns: int) -> None:
        """Report the progress."""
        now = self.machine.progress()
        self._told, self._told_tick = (now.state, now.phase), 0
        self._publisher.publish(
            WeldProgress(
                header=convert.header(stamp_ns),
                state=str(now.state),
                phase=now.phase,
                angle=radians(now.angle_deg),
                length=units.m_from_mm(now.length_mm),
                time_left=now.time_left_s,
            )
        )
