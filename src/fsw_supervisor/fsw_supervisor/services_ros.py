"""The services for operators' requests to the leading supervisor."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

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
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import Decision


class Leadership:
    """Answers whether this supervisor leads.

    After a stall, requests may be handled before the messages that report another supervisor's
    takeover. A deposed leader must not accept them: nobody would follow it. Requests therefore
    wait for the next report or timer.
    """

    def __init__(self, node: Node, failover: Failover) -> None:
        self._node, self._failover = node, failover
        self._waiting: list[Future] = []

    async def certain(self) -> bool:
        """Wait, after a stall, until it is certain; return whether this supervisor leads."""
        while not self._failover.is_certain(time.monotonic()):
            known: Future = Future(executor=self._node.executor)
            self._waiting.append(known)
            await known
        return self._failover.role is Role.ACTIVE

    def look(self) -> None:
        """Resume waiting requests once it is certain; call it after every call of the failover."""
        if self._waiting and self._failover.is_certain(time.monotonic()):
            waiting, self._waiting = self._waiting, []
            for known in waiting:
                known.set_result(True)


_ON_STANDBY = Answer.refused(Code.ON_STANDBY)
#: characters of an operator's name that are recorded
_LONGEST_NAME = 100


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
                create(SwitchController, "fsw/switch_controller", _served(self._switch)),
                create(ListControllers, "fsw/list_controllers", self._on_list),
                create(SetMode, "fsw/set_mode", _served(self._set_mode)),
                create(OperatorRequest, "fsw/acknowledge", _served(self._acknowledge)),
            ]

    def close(self) -> None:
        """Withdraw the services."""
        for service in self._services:
            self._node.destroy_service(service)
        self._services = []

    async def _switch(self, request: SwitchController.Request) -> Answer:
        best_effort, strictness = request.BEST_EFFORT, request.strictness
        if strictness not in (best_effort, request.STRICT):
            return Answer.refused(Code.UNKNOWN_STRICTNESS, strictness=strictness)
        if not await self._leads():
            return _ON_STANDBY
        now_s, timeout = time.monotonic(), request.timeout
        ask = self._arbiter.operator.ask_switch
        timeout_s = timeout.sec + timeout.nanosec * 1e-9
        switch = ask(request.name, strictness != best_effort, timeout_s, _who(request), now_s)
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

    async def _set_mode(self, request: SetMode.Request) -> Answer:
        mode, confirmations = request.mode, self._confirmations
        ask = partial(
            self._arbiter.operator.ask_mode, mode, convert.command(request), _who(request)
        )
        confirmation = confirmations.of_stop
        if mode != Mode.SAFE_STOP:
            confirmation = partial(confirmations.of_mode, mode)
        return await self._ask(ask, confirmation)

    async def _acknowledge(self, request: OperatorRequest.Request) -> Answer:
        ask = partial(self._arbiter.operator.acknowledge, _who(request))
        return await self._ask(ask, self._confirmations.of_acknowledgement)

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


def _who(request: Any) -> str:
    """Origin of a request, for the record: a text of one line."""
    shown = "".join(letter if letter.isprintable() else " " for letter in request.who)
    return " ".join(shown.split())[:_LONGEST_NAME] or "operator"


def _served(answer: Callable[[Any], Awaitable[Answer]]) -> Callable[[Any, Any], Awaitable[Any]]:
    """Callback of a service that gives this answer."""

    async def serve(request: Any, response: Any) -> Any:
        ok, fact = await answer(request)
        response.ok, response.code, response.message = ok, str(fact.code), fact.words
        return response

    return serve
