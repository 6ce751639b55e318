"""Carries out operators' requests by services, each with a time-out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from fsw_control import messages_ros as convert
from fsw_control.contract import SAFE_STOP
from fsw_hmi.answers import DONE, REFUSED, Answer, Code
from fsw_hmi.requests import (
    AcknowledgeStop,
    Action,
    ChangeMode,
    Programme,
    SafeStop,
    SetReference,
    Switch,
)
from fsw_hmi.weld_view import Awake
from fsw_msgs import srv

#: a safe stop that is not answered is asked for again, and longer than a person waits for the
#: answer: a supervisor that is being started again must get it
_REPEAT_S, _REPEAT_FOR_S = 0.5, 60.0


@dataclass(eq=False, slots=True)
class _Call:
    """A pending request to a service."""

    client: Client
    offered_by: str
    request: Any
    answer: Callable[[Answer], object]
    begun_s: float
    patience_s: float
    repeat: bool
    asked_s: float = 0.0
    future: Any = None  # rclpy.task.Future
    is_answered: bool = False
    refused: bool = False  #: the service has answered, but not with success


class Orders:
    """Carries out actions; call :meth:`look` often.

    An answer that came while this process stood still waits to be read: ``awake`` knows how long
    that was.
    """

    def __init__(self, node: Node, awake: Awake) -> None:
        self._calls: list[_Call] = []
        self._awake = awake
        self._set_reference = node.create_client(srv.SetReference, "fsw/set_reference")
        self._switch = node.create_client(srv.SwitchController, "fsw/switch_controller")
        self._set_mode = node.create_client(srv.SetMode, "fsw/set_mode")
        self._acknowledge = node.create_client(srv.OperatorRequest, "fsw/acknowledge")
        self._weld = {
            verb: node.create_client(srv.OperatorRequest, f"fsw/weld/{verb}")
            for verb in ("hold", "resume", "abort")
        }

    # ---------------------------------------------------------------- services

    def carry_out(
        self, action: Action, who: str, answer: Callable[[Answer], object], timeout_s: float
    ) -> None:
        """Begin an action of the graph's services for an operator.

        ``answer`` gets what became of it; twice for a safe stop that is answered late.
        """
        client, offered_by, request = self._request(action, who)
        repeat = isinstance(request, srv.SetMode.Request) and request.mode == SAFE_STOP
        wait_s = action.wait_s if isinstance(action, Switch) else 0.0
        patience_s = timeout_s + wait_s
        call = _Call(client, offered_by, request, answer, time.monotonic(), patience_s, repeat)
        self._calls.append(call)
        self.look()

    def _request(self, action: Action, who: str) -> tuple[Client, str, Any]:
        """Service of an action, the node that offers it, and the request."""
        match action:
            case SafeStop():
                return self._set_mode, "supervisor", convert.mode_request(SAFE_STOP, who=who)
            case ChangeMode():
                return self._set_mode, "supervisor", convert.mode_request(**dict(action), who=who)
            case AcknowledgeStop():
                return self._acknowledge, "supervisor", srv.OperatorRequest.Request(who=who)
            case Switch():
                request = convert.switch_request(**dict(action), who=who)
                return self._switch, "supervisor", request
            case SetReference():
                request = convert.set_reference_request(**dict(action))
                return self._set_reference, "supervisor", request
            case Programme():
                request = srv.OperatorRequest.Request(who=who)
                return self._weld[action.action], "programme", request
        raise TypeError(f"{action!r} is not for the graph")

    def look(self) -> None:
        """Send requests whose service has appeared, and time out the others."""
        now_s = time.monotonic()
        for call in [*self._calls]:
            if self._awake.age_s(call.begun_s, now_s) >= call.patience_s:
                service = call.offered_by
                if call.repeat and not call.is_answered:
                    call.is_answered = True
                    call.begun_s, call.patience_s = now_s, _REPEAT_FOR_S
                    code = Code.UNCONFIRMED if call.refused else Code.ASKED_AGAIN
                    call.answer(code.timed_out(service=service, wait_s=_REPEAT_FOR_S))
                else:
                    code = Code.SILENT if call.asked_s else Code.NO_SERVICE
                    self._end(call, code.timed_out(service=service))
            elif call.asked_s == 0.0 or (call.repeat and now_s >= call.asked_s + _REPEAT_S):
                if call.client.service_is_ready():
                    self._ask(call, now_s)
                elif not call.repeat:
                    self._end(call, Code.NO_SERVICE.refused(service=call.offered_by))

    def _ask(self, call: _Call, now_s: float) -> None:
        self._drop(call)
        call.asked_s = now_s
        call.future = future = call.client.call_async(call.request)
        future.add_done_callback(lambda done: self._on_response(call, done))

    def _on_response(self, call: _Call, future: Future) -> None:
        if future is not call.future or future.cancelled():
            return
        error, call.future = future.exception(), None
        if error is not None:
            self._end(call, Code.NOT_ASKED.refused(service=call.offered_by, error=error))
            return
        answer = _answer(future.result())
        if call.repeat and answer.outcome != DONE:
            call.refused = True
            return  # it is asked for again until its effect is confirmed
        self._end(call, answer)

    def _end(self, call: _Call, answer: Answer) -> None:
        if call in self._calls:
            self._calls.remove(call)
            self._drop(call)
            call.answer(answer)

    def _drop(self, call: _Call) -> None:
        """Drop a pending request."""
        if call.future is not None:
            future, call.future = call.future, None
            call.client.remove_pending_request(future)


def _answer(response: Any) -> Answer:
    """Answer of a service."""
    outcome, code = DONE if response.ok else REFUSED, response.code or Code.SERVICE
    return Answer(outcome, str(code), str(response.message))
