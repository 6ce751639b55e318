"""The same node in either world looks the same in the graph and to the ros2 command line tools."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest


def _view(node: Any) -> dict[str, Any]:
    """Everything the graph shows about ``/far/sample`` and its endpoints, but for GIDs."""
    view: dict[str, Any] = {}
    for query in (
        node.get_publisher_names_and_types_by_node,
        node.get_subscriber_names_and_types_by_node,
        node.get_service_names_and_types_by_node,
        node.get_client_names_and_types_by_node,
    ):
        view[query.__name__] = sorted(query("sample", "/far"))
    for topic, _ in node.get_topic_names_and_types(no_demangle=True):
        for query in (node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic):
            for info in query(topic, no_mangle=True):
                if info.node_name == "sample":
                    view[f"{query.__name__} {topic}"] = re.sub("GID: .*", "", str(info))
    return view


def test_node_looks_the_same(node: Any, wait_until: Any, start: Any) -> None:
    views = []
    for genuine in (False, True):
        peer = start("sample", genuine=genuine)
        assert wait_until(lambda: len(_services(node)) == 9 and node.count_clients("/home") == 1)
        # Four lists, both ends of nine servers and a client, eight publishers, two subscriptions.
        assert wait_until(lambda: len(_view(node)) == 4 + 18 + 2 + 8 + 2)
        views.append(_view(node))
        peer.process.terminate()
        _, _, errors = peer.finish()
        assert errors == ""
        assert wait_until(lambda: "sample" not in node.get_node_names())
    assert views[0] == views[1]


def _services(node: Any) -> Any:
    if "sample" not in node.get_node_names():
        return []
    return node.get_service_names_and_types_by_node("sample", "/far")


COMMANDS = ["node info /far/sample", "topic info -v /far/full", "service list -t", "param dump /far/sample"]
STREAMS = [
    "service call /far/set std_srvs/srv/SetBool {data:\\ true}",
    "topic echo --once /far/status",
    "topic pub --once /far/orders std_msgs/msg/String {data:\\ x}",
]


@pytest.mark.skipif(shutil.which("ros2") is None, reason="needs the ros2 command line tools")
def test_command_line_tools_see_the_same(start: Any, tmp_path: Path) -> None:
    seen: list[dict[str, str]] = []
    for genuine in (False, True):
        peer = start("sample", genuine=genuine)
        seen.append({})
        for command in COMMANDS + STREAMS:
            words = command.replace("\\ ", "\0").split()
            words = [word.replace("\0", " ") for word in words]
            if command in COMMANDS:
                words[2:2] = ["--no-daemon", "--spin-time", "2"]
            done = subprocess.run(["ros2", *words], capture_output=True, text=True, timeout=240)
            seen[-1][command] = re.sub("GID: .*", "", done.stdout) + done.stderr
        peer.process.terminate()
        _, _, errors = peer.finish()
        assert "heard x" in errors and len(errors.splitlines()) == 1
        # Some of the tools start it.
        subprocess.run(["ros2", "daemon", "stop"], capture_output=True, check=True, timeout=240)
    assert seen[0] == seen[1]
    assert "/far/status: std_msgs/msg/String" in seen[0]["node info /far/sample"]
