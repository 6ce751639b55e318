"""Publishes a bag into the graph, including its clock."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosbag2_interfaces.srv import (
    Burst,
    GetRate,
    IsPaused,
    Pause,
    PlayNext,
    Resume,
    Seek,
    SetRate,
    Stop,
    TogglePaused,
)
from rosgraph_msgs.msg import Clock as ClockMessage

from fsw_control.light_node_ros import LightNode
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters_ros import ParameterValues
from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.definitions import interface_hash, message_class
from fsw_recorder.errors import BagError
from fsw_recorder.parameters import ReplayParameters
from fsw_recorder.player import Player
from fsw_recorder.qos_ros import profile_of
from fsw_recorder.services_ros import serve
from fsw_recorder.topic import TopicSelection, replayed_qos
from fsw_recorder.weld_clock import on_weld_clock

_PERIOD_S = 0.002
#: longest pause of this process that is made up for at once
_STALL_NS = 50_000_000
#: time limit for the delivery of the last messages
_DELIVERY_S = 2.0


class ReplayNode(LightNode, Node):  # type: ignore[misc]
    """Node that plays a bag; see :class:`ReplayParameters`.

    Services as rosbag2's player: ``~/pause``, ``~/resume``, ``~/toggle_paused``, ``~/is_paused``,
    ``~/get_rate``, ``~/set_rate``, ``~/play_next``, ``~/burst``, ``~/seek``, ``~/stop``.

    Raises
    ------
    BagError
        If the bag cannot be read or has nothing to play.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("fsw_replay", **arguments)
        values = ParameterValues(self, ReplayParameters).values
        if not values["bag"]:
            raise BagError(
                "no bag given; give its path as an argument, or set the parameter 'bag'"
            )
        rules = {name: values[name] for name in ("topics", "regex", "exclude", "exclude_regex")}
        selection = TopicSelection(**rules, include_hidden=True)
        self._exit_at_end: bool = values["exit_at_end"]
        self._reader = BagReader(Path(values["bag"]).expanduser())
        for problem in self._reader.problems:
            self.get_logger().warning(problem)
        topics = self._reader.topics()
        recorded_clock = "/clock" in topics
        own_clock = values["clock"] == "bag_time" or (
            values["clock"] == "auto" and not recorded_clock
        )
        if values["clock"] == "recorded" and not recorded_clock:
            raise BagError(f"{values['bag']}: clock is 'recorded' but the bag has no /clock")
        names = {name for name in topics if selection.takes(name)}
        if own_clock or values["clock"] == "none":
            names.discard("/clock")
        elif recorded_clock:
            names.add("/clock")
        self.player = Player(
            self._reader if values["pace"] == "received" else on_weld_clock(self._reader),
            time.monotonic_ns(),
            names,
            rate=values["rate"],
            start_offset_s=values["start_offset"],
            duration_s=values["duration"],
            loop=values["loop"],
            paused=values["start_paused"],
        )
        self._published = 0
        self._publishers_by_topic = self._make_publishers()
        self._clock_publisher = (
            self.create_publisher(ClockMessage, "/clock", 1) if own_clock else None
        )
        self._clock_period_ns = round(1e9 / values["clock_frequency"])
        self._last_clock_ns = self._last_tick_ns = 0
        self._wait_for: list[str] = [name for name in values["wait_for"] if name]
        if absent := sorted({*self._wait_for} - {*self._publishers_by_topic}):
            raise BagError(
                f"{values['bag']}: wait_for names {', '.join(absent)}, which are not played from "
                f"it; it plays {', '.join(sorted(self._publishers_by_topic))}"
            )
        now = time.monotonic()
        self._settled_at = now + values["wait_settle"]
        self._waits_until = now + max(values["wait_timeout"], values["wait_settle"])
        self._playing = False
        self._make_services()
        self.create_timer(_PERIOD_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _make_publishers(self) -> dict[str, Any]:
        publishers: dict[str, Any] = {}
        for topic in self.player.topics:
            try:
                if topic.encoding != "cdr":
                    raise BagError(f"its encoding '{topic.encoding}' is not CDR")
                kind = message_class(topic.type_name)
                if topic.type_hash and interface_hash(topic.type_name) not in (
                    "",
                    topic.type_hash,
                ):
                    raise BagError(
                        f"{topic.type_name} was another version when the bag was recorded"
                    )
            except BagError as error:
                self.get_logger().warning(f"{topic.name} is not played: {error}")
                continue
            publishers[topic.name] = self.create_publisher(
                kind, topic.name, profile_of(replayed_qos(topic.qos))
            )
        if not publishers:
            raise BagError(
                f"{self._reader.path}: nothing to play: "
                "none of its topics' types is installed here"
            )
        return publishers

    # ------------------------------------------------------------------ playing

    def _tick(self) -> None:
        now_ns = time.monotonic_ns()
        if not self._playing:
            if not self._subscribers_ready():
                return
            self._playing = True
            for record in self.player.latched_before_start():
                self._publish(record)
            paused = self.player.is_paused
            self.player.seek(self.player.start_ns, now_ns)
            self._last_tick_ns = now_ns
            self.get_logger().info(
                f"playing {self._reader.path}" + (" (paused)" if paused else "")
            )
        self.player.hold_back(max(now_ns - self._last_tick_ns - _STALL_NS, 0))
        self._last_tick_ns = now_ns
        for record in self.player.take_due(now_ns):
            self._publish(record)
        if now_ns - self._last_clock_ns >= self._clock_period_ns:
            self._publish_clock(self.player.bag_time_ns(now_ns))
            self._last_clock_ns = now_ns
        if self.player.finished and self._exit_at_end:
            self.get_logger().info(f"played {self._published} messages")
            for publisher in self._publishers_by_topic.values():
                publisher.wait_for_all_acked(Duration(seconds=_DELIVERY_S))
            rclpy.try_shutdown()

    def _subscribers_ready(self) -> bool:
        now = time.monotonic()
        if now < self._settled_at:
            return False
        missing = [
            name
            for name, publisher in self._publishers_by_topic.items()
            if publisher.get_subscription_count()
            < max(self.count_subscribers(publisher.topic_name), self._wait_for.count(name))
        ]
        if missing and now < self._waits_until:
            return False
        if missing:
            self.get_logger().warning(
                f"playing although no subscriber has matched on {', '.join(missing)}"
            )
        return True

    def _publish(self, record: BagRecord) -> None:
        publisher = self._publishers_by_topic.get(record.topic)
        if publisher is not None:
            self._publish_clock(record.log_time_ns)
            publisher.publish(record.data)
            self._published += 1

    def _publish_clock(self, time_ns: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(ClockMessage(clock=Time(nanoseconds=time_ns).to_msg()))

    # ------------------------------------------------------------------ services

    def _make_services(self) -> None:
        player, now = self.player, time.monotonic_ns

        def stop(_: Any) -> None:
            player.pause(now())
            player.finished = True

        def seek(request: Any) -> dict[str, Any]:
            return {"success": player.seek(request.time.sec * 10**9 + request.time.nanosec, now())}

        def toggle(_: Any) -> None:
            (player.resume if player.is_paused else player.pause)(now())

        serve(self, Pause, "~/pause", lambda _: player.pause(now()))
        serve(self, Resume, "~/resume", lambda _: player.resume(now()))
        serve(self, TogglePaused, "~/toggle_paused", toggle)
        serve(self, IsPaused, "~/is_paused", lambda _: {"paused": player.is_paused})
        serve(self, GetRate, "~/get_rate", lambda _: {"rate": player.rate})
        serve(
            self,
            SetRate,
            "~/set_rate",
            lambda request: {"success": player.set_rate(request.rate, now())},
        )
        serve(self, PlayNext, "~/play_next", lambda _: {"success": self._step() == 1})
        serve(
            self,
            Burst,
            "~/burst",
            lambda request: {"actually_burst": self._step(request.num_messages)},
        )
        serve(self, Seek, "~/seek", seek)
        serve(self, Stop, "~/stop", stop)

    def _step(self, most: int = 1) -> int:
        """Publish the next messages while paused; ``most`` 0 means all."""
        count = 0
        while self._playing and (most == 0 or count < most):
            record = self.player.step(time.monotonic_ns())
            if record is None:
                break
            self._publish(record)
            count += 1
        return count

    def destroy_node(self) -> None:
        """Close the bag and leave the graph."""
        self._reader.close()
        super().destroy_node()


def main(args: Sequence[str] | None = None) -> int:
    """Play a bag: ``run_replay.py BAG [--ros-args ...]``."""

    def make(*bag: str) -> ReplayNode:
        return ReplayNode(
            parameter_overrides=[Parameter("bag", Parameter.Type.STRING, path) for path in bag]
        )

    arguments = NodeArguments("fsw_replay", __doc__ or "", ReplayParameters, "BAG")
    return run(make, args, arguments)


if __name__ == "__main__":
    sys.exit(main())
