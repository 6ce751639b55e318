"""Whether this supervisor leads: callbacks of requests wait until that is certain."""

from __future__ import annotations

import time

from rclpy.node import Node
from rclpy.task import Future

from fsw_supervisor.failover import Failover, Role


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
