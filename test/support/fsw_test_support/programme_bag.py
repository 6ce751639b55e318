"""Writes the bag of a made-up weld that has phases, a hold and an operator."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from pathlib import Path

import yaml

from fsw_control.parameters import defaults
from fsw_recorder.bag_writer import BagWriter, RecordedTopic, WriterOptions
from fsw_recorder.definitions import interface_definition, interface_hash
from fsw_recorder.topic import profile
from fsw_supervisor.parameters import SupervisorParameters
from fsw_test_support.sample_weld import START_NS, SampleTypes, sample_messages, sample_topics

_TOPICS = {
    "/fsw/weld_progress": "fsw_msgs/msg/WeldProgress",
    "/fsw/operator_action": "fsw_msgs/msg/OperatorAction",
}
#: second, state and phase
PROGRESS = (
    (0, "running", "dwell"),
    (10, "running", "start"),
    (20, "held", "start"),
    (21, "running", "start"),
)
ACTION = {
    "who": "anna (3f2a)",
    "action": "weld resume",
    "outcome": "done",
    "message": "running in phase start",
}


def write_programme_weld(
    folder: Path,
    phases: int = 2,
    options: WriterOptions | None = None,
    custom_data: Mapping[str, str] | None = None,
    attachments: Mapping[str, bytes] | None = None,
) -> None:
    """Write 30 s: phases from 0 and 10 s (or the first), a hold from 20 to 21 s, an action at 25 s, a swap at 15 s."""
    types, messages = SampleTypes(), list(sample_messages(300))

    def add(topic: str, second: int, values: Mapping[str, object]) -> None:
        stamp = {"sec": START_NS // 10**9 + second, "nanosec": 0}
        data = types.serialize(_TOPICS[topic], {"header": {"stamp": stamp}, **values})
        messages.append((topic, START_NS + second * 10**9 + 300_000, data))

    for second, state, phase in PROGRESS if phases > 1 else PROGRESS[:1]:
        add(
            "/fsw/weld_progress",
            second,
            {"state": state, "phase": phase, "angle": radians(second)},
        )
    add("/fsw/operator_action", 25, ACTION)
    with BagWriter(folder, options, custom_data) as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        for name, kind in _TOPICS.items():
            writer.add_topic(
                RecordedTopic(
                    name, kind, interface_definition(kind), interface_hash(kind), (profile(),)
                )
            )
        parameters = {"/fsw_supervisor": {"ros__parameters": defaults(SupervisorParameters)}}
        writer.attach(
            "parameters/fsw_supervisor.yaml",
            "application/yaml",
            yaml.safe_dump(parameters).encode(),
        )
        for name, data in (attachments or {}).items():
            writer.attach(name, "application/yaml", data)
        for name, time_ns, data in sorted(messages, key=lambda message: message[1]):
            writer.write(name, data, time_ns, time_ns)
    if writer.error is not None:
        raise writer.error
