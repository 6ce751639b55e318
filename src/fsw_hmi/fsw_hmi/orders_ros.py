"""Carries out what a person asked for: services and set-points, each with an answer in time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import Any

from builtin_interfaces.msg import Duration
from rclpy.client import Client
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.contract import Reference
from fsw_control.references import ReferenceQueue
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_hmi import set_points
from fsw_hmi.control_room import DONE, REFUSED, TIMED_OUT
from fsw_hmi.requests import Action, ChangeMode, Disturb, Fail, Programme, SafeStop, SetReference, Switch
from fsw_msgs.msg import WeldReference, WeldReferencePlan
from fsw_msgs.srv import SetDisturbance, SetFault, SetMode, SwitchController

SAFE_STOP = "safe_stop"
#: a safe stop that is not answered is asked for again
_REPEAT_S = 0.5

Answer = Callable[[str, str], None]


@dataclass(eq=False, slots=True)
class _Call:
    """A request to a service that is under way."""

    client: Client
    offered_by: str
    request: Any
    answer: Answer
    due_s: float
    repeat: bool
    asked_s: float = 0.0
    future: Future | None = None


class Orders:
    """Carries out actions; :meth:`look` is to be called often.

    The publishers of set-points do not exist before the first use: an operator's page that only looks is no source of
    set-points.

    Parameters
    ----------
    node : Node
    references : ReferenceQueue
        Set-points that are known.
    """

    def __init__(self, node: Node, references: ReferenceQueue) -> None:
        self._node, self._references = node, references
        self._calls: list[_Call] = []
        self._set_points: Publisher | None = None
        self._plans: Publisher | None = None
        self._switch = node.create_client(SwitchController, "fsw/switch_controller")
        self._set_mode = node.create_client(SetMode, "fsw/set_mode")
        self._weld = {verb: node.create_client(Trigger, f"fsw/weld/{verb}") for verb in ("hold", "resume", "abort")}
        self._disturb = node.create_client(SetDisturbance, "fsw/plant/set_disturbance")
        self._fail = node.create_client(SetFault, "fsw/plant/set_fault")

    @property
    def emulator(self) -> bool:
        """Whether the plant is the emulator."""
        return self._disturb.service_is_ready()

    # ---------------------------------------------------------------- services

    def carry_out(self, action: Action, answer: Answer, timeout_s: float) -> None:
        """Begin an action of the graph's services; ``answer`` gets outcome and words, once."""
        if isinstance(action, SafeStop):
            self._ask_mode(SAFE_STOP, None, None, answer, timeout_s)
        elif isinstance(action, ChangeMode):
            self._ask_mode(action.mode, action.force_kn, action.speed_rpm, answer, timeout_s)
        elif isinstance(action, Switch):
            seconds = int(action.wait_s)
            request = SwitchController.Request(
                name=action.controller,
                strictness=SwitchController.Request.BEST_EFFORT,
                timeout=Duration(sec=seconds, nanosec=round((action.wait_s - seconds) * 1e9)),
            )
            self._call(self._switch, "supervisor", request, answer, timeout_s + action.wait_s)
        elif isinstance(action, Programme):
            self._call(self._weld[action.verb], "programme", Trigger.Request(), answer, timeout_s)
        elif isinstance(action, Disturb):
            self._call(self._disturb, "emulated plant", _disturbance(action), answer, timeout_s)
        elif isinstance(action, Fail):
            self._call(self._fail, "emulated plant", _fault(action), answer, timeout_s)
        else:
            raise TypeError(f"{action!r} is not for the graph")

    def _ask_mode(
        self, mode: str, force_kn: float | None, speed_rpm: float | None, answer: Answer, timeout_s: float
    ) -> None:
        request = SetMode.Request(
            mode=mode,
            axial_force=nan if force_kn is None else units.n_from_kn(force_kn),
            spindle_speed=nan if speed_rpm is None else units.rad_s_from_rpm(speed_rpm),
        )
        self._call(self._set_mode, "supervisor", request, answer, timeout_s, repeat=mode == SAFE_STOP)

    def _call(
        self, client: Client, offered_by: str, request: Any, answer: Answer, timeout_s: float, repeat: bool = False
    ) -> None:
        self._calls.append(_Call(client, offered_by, request, answer, time.monotonic() + timeout_s, repeat))
        self.look()

    def look(self) -> None:
        """Ask where nobody could be asked yet, and give up what takes too long."""
        now_s = time.monotonic()
        for call in [*self._calls]:
            if now_s >= call.due_s:
                asked = f"the {call.offered_by} did not answer in time"
                self._end(call, TIMED_OUT, asked if call.asked_s else f"there is no {call.offered_by} to ask")
            elif call.asked_s == 0.0 or (call.repeat and now_s >= call.asked_s + _REPEAT_S):
                if call.client.service_is_ready():
                    self._ask(call, now_s)
                elif not call.repeat:
                    self._end(call, REFUSED, f"there is no {call.offered_by} to ask")

    def _ask(self, call: _Call, now_s: float) -> None:
        self._drop(call)
        call.asked_s = now_s
        call.future = future = call.client.call_async(call.request)
        future.add_done_callback(lambda done: self._on_response(call, done))

    def _on_response(self, call: _Call, future: Future) -> None:
        if call.future is not future or future.cancelled():
            return
        error, call.future = future.exception(), None
        if error is not None:
            self._end(call, REFUSED, f"the {call.offered_by} could not be asked: {error}")
            return
        response = future.result()
        ok = response.success if isinstance(response, Trigger.Response) else response.ok
        self._end(call, DONE if ok else REFUSED, str(response.message).removeprefix("refused: "))

    def _end(self, call: _Call, outcome: str, message: str) -> None:
        if call in self._calls:
            self._calls.remove(call)
            self._drop(call)
            call.answer(outcome, message)

    def _drop(self, call: _Call) -> None:
        """Forget a question that nobody waits for any longer."""
        if call.future is not None:
            future, call.future = call.future, None
            call.client.remove_pending_request(future)

    # ---------------------------------------------------------------- set-points

    def send_set_points(self, action: SetReference, tick_ns: int) -> tuple[str, str]:
        """Send set-points, ``tick_ns`` being the newest tick; returns outcome and words.

        The first one holds at once and voids what was sent ahead before, here or elsewhere.
        """
        node, goal = self._node, Reference(action.depth_mm, action.temperature_c)
        if not self._controllers_listen():
            return REFUSED, "no controller listens to set-points"
        start = self._references.at(tick_ns)
        if action.ramp and start is None:
            return REFUSED, "no set-points are in force that a ramp could begin at: send them without a ramp"
        if self._set_points is None or self._plans is None:
            self._set_points = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
            self._plans = node.create_publisher(WeldReferencePlan, "fsw/reference_plan", LATEST)
        if not action.ramp or start is None or start == goal:
            self._plans.publish(convert.reference_plan_message([], tick_ns))
            self._set_points.publish(convert.reference_message(goal, 0))
            return DONE, f"set-points {goal.depth_mm:g} mm, {goal.temperature_c:g} degC sent"
        self._plans.publish(convert.reference_plan_message(set_points.stair(start, goal, tick_ns), tick_ns))
        self._set_points.publish(convert.reference_message(start, 0))
        for stamp_ns, one in set_points.ramp(start, goal, tick_ns):
            self._set_points.publish(convert.reference_message(one, stamp_ns))
        return DONE, f"ramp over {set_points.duration_s(start, goal):.1f} s sent"

    def _controllers_listen(self) -> bool:
        """Whether anybody but this node does."""
        topic = self._node.resolve_topic_name("fsw/reference")
        own = (self._node.get_namespace(), self._node.get_name())
        infos = self._node.get_subscriptions_info_by_topic(topic)
        return any((info.node_namespace, info.node_name) != own for info in infos)


def _disturbance(action: Disturb) -> SetDisturbance.Request:
    to_wire = {"depth": units.m_from_mm, "axial_force": units.n_from_kn, "spindle_speed": units.rad_s_from_rpm}
    return SetDisturbance.Request(
        channel=action.channel,
        shape=action.shape,
        amplitude=to_wire.get(action.channel, float)(action.amplitude),
        duration=action.duration_s,
        period=action.period_s,
    )


def _fault(action: Fail) -> SetFault.Request:
    in_metres = action.sensor == "depth" and action.kind != "delay"
    magnitude = units.m_from_mm(action.magnitude) if in_metres else action.magnitude
    return SetFault.Request(sensor=action.sensor, kind=action.kind, magnitude=magnitude, duration=action.duration_s)
