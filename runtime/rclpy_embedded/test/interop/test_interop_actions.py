"""Actions and managed nodes between genuine rclpy and rclpy_embedded."""

from __future__ import annotations

import re
import shutil
import subprocess
from typing import Any

import pytest
from rclpy.action import get_action_server_names_and_types_by_node

ACTIONS = [("/far/weld", ["example_interfaces/action/Fibonacci"])]
GOAL = "example_interfaces/action/Fibonacci {order:\\ 3}"


def _endpoints(node: Any) -> dict[str, list[str]]:
    """What the graph shows of the welder's own topics and of both ends of its services, but for GIDs."""
    view: dict[str, list[str]] = {}
    for topic, _ in node.get_topic_names_and_types(no_demangle=True):
        if "/_action/" in topic or "/far/welder/" in topic:
            for query in (node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic):
                infos = [info for info in query(topic, no_mangle=True) if info.node_name == "welder"]
                view[f"{query.__name__} {topic}"] = [re.sub("GID: .*", "", str(info)) for info in infos]
    return view


def test_every_caller_sees_the_same_of_every_server(node: Any, wait_until: Any, start: Any) -> None:
    outputs, views = [], []
    for genuine_server in (False, True):
        for genuine_client in (False, True):
            server = start("welder", genuine=genuine_server)
            assert wait_until(lambda: "welder" in node.get_node_names())
            assert wait_until(lambda: get_action_server_names_and_types_by_node(node, "welder", "/far") == ACTIONS)
            # Five parts of the action, two of them topics; five services of a managed node, its event, and those of
            # parameters and type descriptions.
            assert wait_until(lambda: sum(map(len, _endpoints(node).values())) == 2 + 2 * 3 + 1 + 2 * (5 + 6 + 1))
            views.append(_endpoints(node))
            caller = start("weld_caller", genuine=genuine_client)
            code, out, errors = caller.finish()
            assert code == 0, errors
            outputs.append(out.splitlines())
            server.process.terminate()
            server.finish()
            assert wait_until(lambda: "welder" not in node.get_node_names())
    assert outputs[0][:5] == ["0 False", "2", "5 True", "[[0], [0, 1]]", "4 [0, 1, 2, 3, 4]"]
    assert outputs[0] == outputs[1] == outputs[2] == outputs[3]
    assert views[0] == views[2]


COMMANDS = {
    "action info -t /far/weld": "Action servers: 1",
    f"action send_goal --feedback /far/weld {GOAL}": "Goal finished with status: SUCCEEDED",
    "lifecycle get /far/welder": "unconfigured [1]",
    "lifecycle list /far/welder": "- configure [1]",
    "lifecycle set /far/welder configure": "Transitioning successful",
}


@pytest.mark.skipif(shutil.which("ros2") is None, reason="needs the ros2 command line tools")
def test_command_line_tools(start: Any) -> None:
    start("welder")
    for command, expected in COMMANDS.items():
        words = [word.replace("\0", " ") for word in command.replace("\\ ", "\0").split()]
        done = subprocess.run(["ros2", *words], capture_output=True, text=True, timeout=240)
        assert expected in done.stdout, done.stdout + done.stderr
    subprocess.run(["ros2", "daemon", "stop"], capture_output=True, check=True, timeout=240)
