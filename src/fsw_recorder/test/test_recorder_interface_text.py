"""Definitions and hashes of interfaces, with ROS 2, without it, and with only a part of it."""

from __future__ import annotations

import sys
import types
from pathlib import Path

import pytest

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.definitions import Definitions
from fsw_recorder.interface_text import interface_definition, interface_hash


def _install(monkeypatch: pytest.MonkeyPatch, shares: dict[str, Path]) -> None:
    """Put an ``ament_index_python`` in place that knows these packages."""
    packages = types.ModuleType("ament_index_python.packages")
    packages.get_package_share_directory = lambda name: str(shares[name])  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "ament_index_python", types.ModuleType("ament_index_python"))
    monkeypatch.setitem(sys.modules, "ament_index_python.packages", packages)
    for function in (interface_definition, interface_hash):
        function.cache_clear()


def test_installed_interfaces_come_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "Depth.msg").write_text("float64 depth  # metres\n")
    _install(monkeypatch, {"one_msgs": tmp_path})
    assert "float64 depth" in interface_definition("one_msgs/msg/Depth")


def test_index_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rosidl_embedded", reason="with genuine ROS 2 the package is there")
    _install(monkeypatch, {})
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
