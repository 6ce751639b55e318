"""Records the topics of the graph to a rosbag2 MCAP bag."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.logging import get_logger
from rclpy.task import Future
from rosbag2_interfaces.srv import IsPaused, Pause, Resume, SplitBagfile
from rosbags.interfaces import Qos

from fsw_control.coded import Fact
from fsw_control.managed_node_ros import ManagedNode
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters_ros import ParameterValues
from fsw_control.reports_ros import ERROR, OK, WARN, DiagnosticsPublisher, Report
from fsw_control.schema.files import free_sibling
from fsw_recorder import after_recording
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_writer import BagWriter, WriterOptions, taken
from fsw_recorder.definitions import interface_definition, interface_hash, message_class
from fsw_recorder.errors import BagError
from fsw_recorder.parameter_snapshot_ros import ParameterSnapshots
from fsw_recorder.parameters import RecorderParameters
from fsw_recorder.qos_ros import offered_by
from fsw_recorder.recording import (
    Note,
    custom_entries,
    media_type,
    output_folder,
    read_attachment,
    versions_text,
)
from fsw_recorder.services_ros import serve
from fsw_recorder.signature import load_private
from fsw_recorder.topic import RecordedTopic, TopicSelection, is_latched, is_reliable
from fsw_recorder.topic_subscription_ros import TopicSubscription

_REPORT_PERIOD_S = 1.0
#: polling period [s]; the queues hold far more than arrives meanwhile
_POLL_PERIOD_S = 0.01


def reported_state(
    lacks: bool, is_paused: bool, awaited: Sequence[str], error: object | None
) -> tuple[bytes, Fact]:
    """Level and fact of the report; what keeps it from writing comes before what the bag lacks."""
    if error is not None:
        return ERROR, Fact.of(Note.FAILED, error=str(error))
    if awaited:
        return WARN, Fact.of(Note.AWAITED, topics=tuple(awaited))
    note = Note.PAUSED if is_paused else Note.INCOMPLETE if lacks else Note.RECORDING
    return WARN if lacks else OK, Fact.of(note)


class RecorderNode(ManagedNode):
    """Node that records while it is active; see :class:`RecorderParameters`.

    Services as in rosbag2's recorder: ``~/pause``, ``~/resume``, ``~/is_paused`` and
    ``~/split_bagfile``. Each activation makes a bag, which is complete once the node is
    deactivated; later ones get a number, unless their name is free.

    Raises
    ------
    BagError
        If the bag cannot be created, or an attachment cannot be read.
    InputError
        If the key that signs the manifest cannot be used.
    """

    writer: BagWriter

    def __init__(self, **arguments: Any) -> None:
        super().__init__("fsw_recorder", **arguments)
        self._values = ParameterValues(self, RecorderParameters).values
        self._recorded = False  #: whether a bag was made
        self.failed = False  #: whether a bag is incomplete
        if self._values["autostart"]:
            self.start()

    def configure(self) -> None:
        """Check selection, attachments and the bag's folder."""
        values = self._values
        rules = {
            field.name: values[field.name]
            for field in fields(TopicSelection)
            if field.name != "namespace"
        }
        self._selection = TopicSelection(**rules, namespace=self.get_namespace())
        self._depth: int = values["queue_depth"]
        self._on_finished: list[str] = list(values["on_finished"])
        after_recording.check(self._on_finished)
        if values["signing_key"]:
            load_private(Path(values["signing_key"]).expanduser())
        folder = self._planned()[0]
        if os.path.lexists(folder):
            raise taken(folder)
        self._diagnostics = DiagnosticsPublisher(self)

    def activate(self) -> None:
        """Make the bag, and subscribe to the topics present."""
        self.subscriptions_by_topic: dict[str, TopicSubscription] = {}
        self._left_out: dict[str, str] = {}
        self._other_welds: set[str] = set()
        self._failure_logged = False
        #: topics without a publisher yet, which delay the recording of the others
        self._awaited = [self.resolve_topic_name(name) for name in self._values["wait_for_topics"]]
        self.writer = self._make_writer()
        try:
            self._begin()
        except BaseException:  # including Ctrl-C in the middle of it
            self._finish()
            raise

    def _begin(self) -> None:
        values = self._values
        self._make_services()
        self._snapshots = None
        if values["collect_parameters"]:
            self._snapshots = ParameterSnapshots(
                self, self._attach_parameters, self._selection.takes_node
            )
        steady = Clock(
            clock_type=ClockType.STEADY_TIME
        )  # also runs while simulated time stands still
        self.create_timer(values["discovery_period"], self._discover, clock=steady)
        self.create_timer(_REPORT_PERIOD_S, self._report, clock=steady)
        self.create_timer(_POLL_PERIOD_S, self._poll, clock=steady)
        self._discover()
        self.get_logger().info(f"recording to {self.writer.folder}")

    def deactivate(self) -> None:
        """Finish the bag."""
        self._finish()

    def _planned(self) -> tuple[Path, WriterOptions, dict[str, str], list[tuple[str, bytes]]]:
        """Folder, options, custom data and attachments of the bag that the parameters request."""
        values = self._values
        attachments = [("versions.json", versions_text())]
        if values["scenario"]:
            attachments.append(("scenario.yaml", read_attachment(values["scenario"])))
        attachments += [
            (path.rsplit("/", 1)[-1], read_attachment(path)) for path in values["attach"]
        ]
        custom = custom_entries(values["custom_data"])
        options = WriterOptions(
            **{field.name: values[field.name] for field in fields(WriterOptions)}
        )
        requested = folder = output_folder(values["output"], datetime.now())
        if values["number_if_taken"] or not values["output"] or self._recorded:
            folder = free_sibling(requested)
        if folder != requested:
            custom["continues"] = requested.name
        return folder, options, custom, attachments

    def _make_writer(self) -> BagWriter:
        folder, options, custom, attachments = self._planned()
        if "continues" in custom:
            requested = folder.with_name(custom["continues"])
            self.get_logger().warning(
                f"{requested} exists already and is left unchanged: recording continues beside it"
            )
        writer = BagWriter(folder, options, custom)
        writer.is_paused = self._values["start_paused"]
        for name, data in attachments:
            writer.attach(name, media_type(name), data)
        self._recorded = True
        return writer

    def _make_services(self) -> None:
        writer = self.writer

        def set_paused(is_paused: bool) -> None:
            writer.is_paused = is_paused
            self.get_logger().info("paused" if is_paused else "resumed")

        async def split(_: Any, response: Any) -> Any:
            done = Future()
            writer.split().add_done_callback(done.set_result)
            await done
            return response

        serve(self, Pause, "~/pause", lambda _: set_paused(True))
        serve(self, Resume, "~/resume", lambda _: set_paused(False))
        serve(self, IsPaused, "~/is_paused", lambda _: {"paused": writer.is_paused})
        # a group of its own: a callback that awaits blocks its group
        self.create_service(
            SplitBagfile, "~/split_bagfile", split, callback_group=ReentrantCallbackGroup()
        )

    # ------------------------------------------------------------------ topics

    def _discover(self) -> None:
        if self.writer.error is not None:
            self._failure_logged = True  # logged here, so that it is on /rosout
            self.get_logger().fatal(str(self.writer.error))
            self._report()
            raise SystemExit(1)
        topics = dict(self.get_topic_names_and_types())
        if self._awaited and all(
            self.get_publishers_info_by_topic(name) for name in self._awaited
        ):
            self._awaited = []
        for name, types in topics.items():
            if self._awaited and name not in self._awaited:
                continue
            if name in self._left_out or not self._selection.takes(name):
                self._log_other_weld(name)
                continue
            offers = tuple(
                offered_by(info.qos_profile) for info in self.get_publishers_info_by_topic(name)
            )
            known = self.subscriptions_by_topic.get(name)
            if known is None and offers:
                self._subscribe(name, types, offers)
            elif known is not None:
                for weaker in known.update(offers):
                    offered = "reliable" if is_reliable(weaker) else "best effort"
                    offered += ", transient local" if is_latched(weaker) else ", volatile"
                    self.get_logger().info(
                        f"subscribed to {name} again, for a publisher that is only {offered}"
                    )

    def _log_other_weld(self, name: str) -> None:
        """Report once for each other weld that it is not recorded."""
        weld = self._selection.other_weld(name)
        if weld and weld not in self._other_welds:
            self._other_welds.add(weld)
            self.get_logger().info(
                f"the weld in namespace {weld} is not recorded here; a recorder in it does that"
            )

    def _subscribe(self, name: str, types: Sequence[str], offers: tuple[Qos, ...]) -> None:
        type_name = types[0]
        try:
            if len(types) != 1:
                raise BagError(f"publishers disagree about its type: {', '.join(types)}")
            kind = message_class(type_name)
        except BagError as error:
            self._left_out[name] = str(error)
            self.get_logger().warning(f"{name} is not recorded: {error}")
            return
        topic = RecordedTopic(
            name, type_name, interface_definition(type_name), interface_hash(type_name), offers
        )
        self.writer.add_topic(topic)
        self.subscriptions_by_topic[name] = TopicSubscription(
            self, name, kind, self._depth, self.writer.write
        )
        self.subscriptions_by_topic[name].update(offers)
        self.get_logger().info(f"subscribed to {name} [{type_name}]")

    def _poll(self) -> None:
        """Write the received messages."""
        for subscription in self.subscriptions_by_topic.values():
            subscription.poll()

    # ------------------------------------------------------------------ reports

    def _attach_parameters(self, node_name: str, text: str) -> None:
        name = f"parameters/{node_name.strip('/').replace('/', '.')}.yaml"
        self.writer.attach(name, media_type(name), text.encode())

    def _report(self) -> None:
        error = self.writer.error
        if self._snapshots is not None and error is None:
            self._snapshots.look_for_nodes()
        counters, lost = self.writer.statistics(), self._lost()
        lacks = bool(lost or counters["dropped"] or self._left_out)
        level, fact = reported_state(lacks, self.writer.is_paused, self._awaited, error)
        values = {
            "bag": self.writer.folder,
            "topics": len(self.subscriptions_by_topic),
            **counters,
            "lost": sum(lost.values()),
            **{f"lost {topic}": count for topic, count in lost.items()},
            **{f"left out {topic}": reason for topic, reason in self._left_out.items()},
        }
        self._diagnostics.publish([Report("recording", level, fact, values)])

    def _lost(self) -> dict[str, int]:
        """Messages that are missing by their numbers, by topic."""
        return {name: sub.lost for name, sub in self.subscriptions_by_topic.items() if sub.lost}

    def _finish(self) -> None:
        """Finish the bag with all received messages; report its content or its defects."""
        self._poll()
        lost, dropped = self._lost(), self.writer.statistics()["dropped"]
        missing = sum(lost.values()) + dropped
        self.writer.custom_data["lost_messages"] = str(missing)
        self.writer.custom_data |= {
            f"lost_messages {topic}": str(count) for topic, count in lost.items()
        }
        self.writer.close()
        counters = self.writer.statistics()
        # a logger that does not publish to /rosout: after a signal the node's context is shut
        # down
        logger = get_logger(f"{self.get_logger().name}.bag")
        if self.writer.error is not None:
            self.failed = True
            if not self._failure_logged:
                logger.fatal(str(self.writer.error))
        else:
            if self._awaited:
                logger.warning(
                    "nothing was recorded: these topics were not there: "
                    f"{', '.join(self._awaited)}"
                )
            logger.info(
                f"{counters['written']} messages in {self.writer.folder} (missing: {missing})"
            )
        if (
            self._on_finished and (self.writer.folder / METADATA_NAME).exists()
        ):  # else there is no finished bag
            try:
                after_recording.start(self._on_finished, self.writer.folder)
            except OSError as error:
                logger.error(
                    f"on_finished cannot be started: {error.strerror}; the bag is unharmed"
                )

    def destroy_node(self) -> None:
        """Finish the bag and leave the graph."""
        if self.is_active:
            self._finish()
        super().destroy_node()


def main(args: Sequence[str] | None = None) -> int:
    """Run the recorder until it is stopped; exit code 1 if writing failed."""
    nodes: list[RecorderNode] = []

    def make() -> RecorderNode:
        nodes.append(RecorderNode())
        return nodes[0]

    code = run(
        make,
        args,
        NodeArguments("fsw_recorder", __doc__ or "", RecorderParameters),
    )
    return 1 if code == 0 and any(node.failed for node in nodes) else code


if __name__ == "__main__":
    sys.exit(main())
