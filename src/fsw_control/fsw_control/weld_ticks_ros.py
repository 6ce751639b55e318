"""Joins the topics of a weld into ticks, with the command in force, for nodes that use ticks."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from fsw_control import messages_ros as convert
from fsw_control.applied import AppliedCommand, AppliedCommands
from fsw_control.contract import Command
from fsw_control.message_synchronizer import MessageSynchronizer, SampleSet
from fsw_msgs.msg import WeldCommand


class WeldTicks:
    """Joins the messages of a node's subscriptions; ``consume`` gets the completed ticks.

    Parameters
    ----------
    node : Node
        Logs ignored commands.
    consume : callable
        Called after every sample and command, also with no ticks.
    initial : Command
        Counts as applied until the first command.
    period_s : float
    await_drives : bool
        As for :class:`~fsw_control.message_synchronizer.MessageSynchronizer`.
    """

    def __init__(
        self,
        node: Node,
        consume: Callable[[list[SampleSet]], None],
        initial: Command,
        period_s: float = 0.1,
        await_drives: bool = False,
    ) -> None:
        self._node, self._consume = node, consume
        self.synchronizer = MessageSynchronizer(await_drives)
        self.applied = AppliedCommands(initial, period_s)

    def on_drives(self, stamp_ns: int, acting: Command) -> None:
        """For :func:`~fsw_control.topics_ros.subscribe_drives`."""
        self._consume(self.synchronizer.add_drives(stamp_ns, acting))

    def on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        """For :func:`~fsw_control.topics_ros.subscribe_sensors`."""
        self._consume(self.synchronizer.add(sensor, stamp_ns, value, time.monotonic()))

    def on_command(self, message: WeldCommand) -> None:
        """For the subscription of ``fsw/command``."""
        header, command = message.header, convert.command(message)
        stamp_ns = convert.stamp_ns(header.stamp)
        seen = AppliedCommand(
            stamp_ns, command, message.source, message.leader, message.healthy, message.term
        )
        if self.applied.add(seen, self.synchronizer.stamps.newest_ns, time.monotonic()):
            self._consume(self.synchronizer.add_command(stamp_ns))
        elif self.applied.complaint:
            text = f"a command of {message.source[:40]!r} is ignored: {self.applied.complaint}"
            self._node.get_logger().warning(text, throttle_duration_sec=1.0)

    def expire(self, patience_s: float) -> None:
        """Stop waiting for a tick whose first sample came ``patience_s`` ago."""
        self._consume(self.synchronizer.expire(time.monotonic(), patience_s))
