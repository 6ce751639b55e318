"""Writes the bag of a replay.

The inputs of a recorded weld, and the proposals of a controller in shadow.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from heapq import merge
from operator import attrgetter
from pathlib import Path

import yaml

from fsw_control.reason import Reason
from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS, n_from_kn, rad_s_from_rpm
from fsw_lab.replay import Replay
from fsw_recorder.bag_reader import FOREVER_NS, BagReader, BagRecord
from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.definitions import Definitions, interface_definition, interface_hash
from fsw_recorder.recover import copy

_TYPE = "fsw_msgs/msg/WeldCommand"


def write_shadow(replay: Replay, source: Path, namespace: str, target: Path) -> None:
    """Copy the controller's inputs and all that figures need, and add its proposals.

    Raises
    ------
    BagError
        The bag cannot be written.
    """
    sensors = "|".join(row.topic for row in SENSORS.values())
    shown = re.compile(
        rf"/clock|{namespace}/({sensors}|fsw/(drives|reference|reference_plan|command|plant/truth|weld_progress"
        rf"|operator_action|alarms|supervisor/(state|reference)|{replay.controller}/reference))"
    )
    topic = f"{namespace}/fsw/{replay.controller}/proposal"
    node = f"{namespace}/fsw_{replay.controller}"
    parameters = f"parameters/{node.strip('/').replace('/', '.')}.yaml"
    with (
        BagReader(source) as reader,
        BagWriter(target, custom_data={"shadow_of": source.name}) as writer,
    ):
        copied = {name: kind for name, kind in reader.topics().items() if shown.fullmatch(name)}
        for kind in copied.values():
            writer.add_topic(kind)
        writer.add_topic(
            RecordedTopic(topic, _TYPE, interface_definition(_TYPE), interface_hash(_TYPE))
        )
        for file in reader.attachments():
            if file.name != parameters:
                writer.attach(file.name, file.media_type, file.data)
        contents = yaml.safe_dump(
            {node: {"ros__parameters": replay.parameters}}, allow_unicode=True
        )
        writer.attach(parameters, "application/yaml", contents.encode())
        stop_ns = replay.came[-1] + 1 if replay.is_part else FOREVER_NS
        records = merge(
            reader.records(copied, stop_ns=stop_ns),
            _records(replay, topic),
            key=attrgetter("log_time_ns"),
        )
        copy(records, writer)


def _records(replay: Replay, topic: str) -> Iterator[BagRecord]:
    definitions, definition = Definitions(), interface_definition(_TYPE)
    for stamp_ns, came_ns, proposal in zip(
        replay.stamps, replay.came, replay.proposals, strict=True
    ):
        sec, nanosec = divmod(stamp_ns, NANOSECONDS)
        values = {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}},
            "axial_force": n_from_kn(proposal.command.force_kn),
            "spindle_speed": rad_s_from_rpm(proposal.command.speed_rpm),
            "source": replay.controller,
            "healthy": proposal.healthy,
            "why": Reason.of(proposal.reason).fields,
        }
        yield BagRecord(
            topic, _TYPE, came_ns, came_ns, definitions.encode(_TYPE, definition, values), 0
        )
