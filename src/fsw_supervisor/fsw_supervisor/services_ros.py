"""The services for operators' requests to the leading supervisor."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TypeVar

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.service import Service
from rclpy.task import Future

from fsw_control import messages_ros as convert
from fsw_msgs.srv import ListControllers, OperatorRequest, SetMode, SwitchController
from fsw_supervisor import reports_ros as reports
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.confirmation import Confirmation, Confirmations
from fsw_supervisor.facts import Answer, Code
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import Decision

_Response = TypeVar(
    "_Response", SetMode.Response, SwitchController.Response, OperatorRequest.Response
)
_ON_STANDBY = Answer.refused(Code.ON_STANDBY)


class OperatorServices:
    """Services to switch controllers, list them, set the mode and acknowledge a safe stop.

    ``leads`` is awaited before a request is executed: whether this supervisor leads. A request
    succeeds when the actuator end reports its effect. ``publish`` publishes a request's
    consequences.
    """

    def __init__(
        self,
        node: Node,
        arbiter: Arbiter,
        leads: Callable[[], Awaitable[bool]],
        confirmations: Confirmations,
        publish: Callable[[list[Decision]], None],
    ) -> None:
        self._node, self._arbiter, self._leads, self._publish = node, arbiter, leads, publish
        self._confirmations = confirmations
        # An answer may come ticks later; with a group of their own the services do not block the
        # topics.
        self._group = ReentrantCallbackGroup()
        self._services: list[Service] = []

    def open(self) -> None:
        """Offer the services."""
        if not self._services:
            create = partial(self._node.create_service, callback_group=self._group)
            self._services = [
                create(SwitchController, "fsw/switch_controller", self._on_switch),
                create(ListControllers, "fsw/list_controllers", self._on_list),
                create(SetMode, "fsw/set_mode", self._on_set_mode),
                create(OperatorRequest, "fsw/acknowledge", self._on_acknowledge),
            ]

    def close(self) -> None:
        """Withdraw the services."""
        for service in self._services:
            self._node.destroy_service(service)
        self._services = []

    async def _on_switch(
        self, request: SwitchController.Request, response: SwitchController.Response
    ) -> SwitchController.Response:
        return _respond(response, await self._switch(request))

    async def _switch(self, request: SwitchController.Request) -> Answer:
        best_effort, strictness = request.BEST_EFFORT, request.strictness
        if strictness not in (best_effort, request.STRICT):
            return Answer.refused(Code.UNKNOWN_STRICTNESS, strictness=strictness)
        if not await self._leads():
            return _ON_STANDBY
        now_s, timeout = time.monotonic(), request.timeout
        ask = self._arbiter.operator.ask_switch
        timeout_s = timeout.sec + timeout.nanosec * 1e-9
        switch = ask(request.name, strictness != best_effort, timeout_s, "operator", now_s)
        self._publish([])
        if not switch.done:
            answered: Future = Future(executor=self._node.executor)
            switch.on_done = partial(answered.set_result, True)
            await answered
        answer = switch.reply
        assert answer is not None
        if answer.ok and self._arbiter.machine.active == request.name:
            confirmation = self._confirmations.of_source(request.name, time.monotonic())
            answer = await self._confirmed(confirmation, answer)
        return answer

    def _on_list(
        self, request: ListControllers.Request, response: ListControllers.Response
    ) -> ListControllers.Response:
        response.active = self._arbiter.machine.active
        response.mode = self._arbiter.machine.standing.mode
        records = self._arbiter.registry
        response.controllers = [reports.health(self._arbiter, record) for record in records]
        return response

    async def _on_set_mode(
        self, request: SetMode.Request, response: SetMode.Response
    ) -> SetMode.Response:
        mode, confirmations = request.mode, self._confirmations
        ask = partial(self._arbiter.operator.ask_mode, mode, convert.command(request), "operator")
        confirmation = confirmations.of_stop
        if mode != Mode.SAFE_STOP:
            confirmation = partial(confirmations.of_mode, mode)
        return _respond(response, await self._ask(ask, confirmation))

    async def _on_acknowledge(
        self, request: OperatorRequest.Request, response: OperatorRequest.Response
    ) -> OperatorRequest.Response:
        ask = partial(self._arbiter.operator.acknowledge, "operator")
        return _respond(response, await self._ask(ask, self._confirmations.of_acknowledgement))

    async def _ask(
        self, ask: Callable[[], Answer], confirmation: Callable[[float], Confirmation]
    ) -> Answer:
        """Execute a request and answer when its effect is reported; see ``confirmation``."""
        if not await self._leads():
            return _ON_STANDBY
        answer = ask()
        waiting = confirmation(time.monotonic()) if answer.ok else None
        self._publish([])
        return answer if waiting is None else await self._confirmed(waiting, answer)

    async def _confirmed(self, waiting: Confirmation, answer: Answer) -> Answer:
        if waiting.ok is None:
            known: Future = Future(executor=self._node.executor)
            waiting.on_done = partial(known.set_result, True)
            await known
        if waiting.ok:
            return answer
        if not await self._leads():
            return _ON_STANDBY
        wait_s = self._confirmations.wait_s
        return Answer.refused(Code.UNCONFIRMED, wait_s=wait_s, answer=answer.fact)


def _respond(response: _Response, answer: Answer) -> _Response:
    response.ok, response.code = answer.ok, str(answer.fact.code)
    response.message = answer.fact.words
    return response
