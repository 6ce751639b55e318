"""Definitions and hashes of interfaces, in a sourced ROS 2 and in the environment."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.definitions import (
    Definitions,
    definition_of,
    interface_definition,
    interface_hash,
)
from fsw_recorder.errors import BagError
from fsw_recorder.topic import RecordedTopic


@pytest.fixture(autouse=True)
def _forget() -> None:
    for function in (interface_definition, interface_hash):
        function.cache_clear()


def test_sourced_interfaces_come_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = tmp_path / "share" / "fsw_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "ShoulderDepth.msg").write_text("float64 another_depth  # metres\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'nowhere'}{os.pathsep}{tmp_path}")
    assert "float64 another_depth" in interface_definition("fsw_msgs/msg/ShoulderDepth")


@pytest.mark.skipif("ROS_DISTRO" in os.environ, reason="a sourced ROS 2 sets the path")
def test_definitions_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert "float64 depth" in interface_definition("fsw_msgs/msg/ShoulderDepth")
    assert interface_hash("fsw_msgs/msg/ShoulderDepth").startswith("RIHS01_")


def test_unknown_type() -> None:
    assert interface_definition("no_msgs/msg/Such") == ""
    assert interface_hash("no_msgs/msg/Such") == ""


def test_hash_follows_from_the_definition_as_genuine_ros_2_computes_it(genuine_bag: Path) -> None:
    with BagReader(genuine_bag) as reader:
        for topic in reader.topics().values():
            store = Definitions().typestore(topic.type_name, topic.definition)
            assert store.hash_rihs01(topic.type_name) == topic.type_hash


DEPTH = "fsw_msgs/msg/ShoulderDepth"


@pytest.mark.parametrize(
    ("definition", "encoding"), [("", ""), ("", "ros2msg"), ("module fsw_msgs {};", "ros2idl")]
)
def test_missing_definition_falls_back_to_the_installed_one(
    definition: str, encoding: str
) -> None:
    topic = RecordedTopic("/fsw/depth", DEPTH, definition, definition_encoding=encoding)
    assert definition_of(topic) == interface_definition(DEPTH) != ""
    assert definition_of(replace(topic, type_hash=interface_hash(DEPTH))) == interface_definition(
        DEPTH
    )


def test_the_bags_own_definition_comes_first() -> None:
    assert (
        definition_of(RecordedTopic("/fsw/depth", DEPTH, "float64 depth\n")) == "float64 depth\n"
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"type_name": "no_msgs/msg/None"},
        {"type_name": ""},
        {"type_hash": "RIHS01_00"},
        {"encoding": "json"},
    ],
)
def test_a_type_that_cannot_be_known_is_refused(changes: dict[str, str]) -> None:
    with pytest.raises(BagError):
        definition_of(replace(RecordedTopic("/fsw/depth", DEPTH), **changes))
