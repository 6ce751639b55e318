"""Actions on the wire: topics, types, hashes and QoS of every endpoint."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import rclpy
from cyclonedds.core import Policy
from rclpy.action import (
    ActionClient,
    ActionServer,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from rclpy.impl.graph import user_data_field
from test_msgs.action import Fibonacci

HASHES = json.loads((Path(__file__).parent / "data" / "golden_action_hashes.json").read_text())
CANCEL = "action_msgs::srv::dds_::CancelGoal_{}_"
STATUS = "action_msgs::msg::dds_::GoalStatusArray_"


def test_endpoints(node: Any) -> None:
    server = ActionServer(node, Fibonacci, "fibonacci", lambda _: None)
    client = ActionClient(node, Fibonacci, "fibonacci")
    type_name = "test_msgs::action::dds_::Fibonacci_{}_"
    topics = {"feedback": (type_name.format("FeedbackMessage"), "server"), "status": (STATUS, "server")}
    expected = {f"rt/fibonacci/_action/{part}": found for part, found in topics.items()}
    for part, service in {"send_goal": "SendGoal", "get_result": "GetResult", "cancel_goal": ""}.items():
        for prefix, suffix, direction, sender in (
            ("rq", "Request", "Request", "client"),
            ("rr", "Reply", "Response", "server"),
        ):
            dds_type = type_name.format(f"{service}_{direction}") if service else CANCEL.format(direction)
            expected[f"{prefix}/fibonacci/_action/{part}{suffix}"] = dds_type, sender
    graph = node.context.session.graph
    owners = {"server": server, "client": client}
    for writers in (True, False):
        endpoints = {e.topic_name: e for e in graph.endpoints(writers=writers) if "/_action/" in e.topic_name}
        assert {name: e.type_name for name, e in endpoints.items()} == {k: v[0] for k, v in expected.items()}
        for name, endpoint in endpoints.items():
            ros_name = endpoint.type_name.replace("::dds_::", "/").replace("::", "/").removesuffix("_")
            if ros_name in HASHES:
                assert user_data_field(endpoint.qos, "typehash") == HASHES[ros_name]
            latched = endpoint.qos[Policy.Durability] == Policy.Durability.TransientLocal
            assert latched == name.endswith("/status")
            assert endpoint.qos[Policy.History].depth == (1 if latched else 10)
            assert isinstance(endpoint.qos[Policy.Reliability], Policy.Reliability.Reliable)
            owner = (
                owners[expected[name][1]]
                if writers
                else owners[{"server": "client", "client": "server"}[expected[name][1]]]
            )
            assert endpoint.key in [e.guid for made in owner._endpoints for e in made._entities]
    client.destroy()
    server.destroy()
    server.destroy()
    assert not [e for e in graph.endpoints(writers=True) if "/_action/" in e.topic_name]
    assert list(node.waitables) == [w for w in node.waitables if not isinstance(w, ActionServer | ActionClient)]


def test_remapping(context: Any) -> None:
    args = ["--ros-args", "-r", "weld:=/cell/weld", "-r", "/cell/weld/_action/status:=/status"]
    node = rclpy.create_node("remapped", context=context, cli_args=args)
    ActionServer(node, Fibonacci, "weld", lambda _: None)
    ActionClient(node, Fibonacci, "weld")
    type_name = ["test_msgs/action/Fibonacci"]
    assert get_action_names_and_types(node) == [("/cell/weld", type_name)]
    assert get_action_server_names_and_types_by_node(node, "remapped", "/") == [("/cell/weld", type_name)]
    assert node.count_publishers("/status") == 1
    assert dict(node.get_service_names_and_types())["/cell/weld/_action/send_goal"] == [f"{type_name[0]}_SendGoal"]


def test_actions_end_with_their_node(node: Any) -> None:
    server = ActionServer(node, Fibonacci, "fibonacci", lambda _: None)
    client = ActionClient(node, Fibonacci, "fibonacci")
    graph = node.context.session.graph
    node.destroy_node()
    assert not [e for e in graph.endpoints(writers=True) if "/_action/" in e.topic_name]
    server.destroy()
    client.destroy()


def test_a_failure_leaves_nothing_behind(node: Any) -> None:
    before = len(list(node.timers)), len(list(node.waitables))
    with pytest.raises(ValueError, match="'fibonacci/' is not the name of an action"):
        ActionServer(node, Fibonacci, "fibonacci/", lambda _: None)
    with pytest.raises(ValueError, match="result_timeout must not be negative, got -1"):
        ActionServer(node, Fibonacci, "fibonacci", lambda _: None, result_timeout=-1)
    with pytest.raises(RuntimeError, match="The action type provided is not valid"):
        ActionClient(node, Fibonacci.Goal, "fibonacci")
    assert (len(list(node.timers)), len(list(node.waitables))) == before
    assert not [e for e in node.context.session.graph.endpoints(writers=True) if "/_action/" in e.topic_name]
