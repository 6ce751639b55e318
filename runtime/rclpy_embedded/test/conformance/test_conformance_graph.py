"""Graph queries, and how the graph follows what happens."""

from __future__ import annotations

import os
from typing import Any

import pytest
import rclpy
from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.context import Context
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo, TopicEndpointTypeEnum
from std_msgs.msg import Header, Int32, String
from std_srvs.srv import Trigger

STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"

OTHER = """
import rclpy
from std_msgs.msg import String
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("other", namespace="/far")
publisher = node.create_publisher(String, "~/status", 3)
node.create_subscription(String, "/orders", lambda _: None, 10)
node.create_service(Trigger, "go", lambda request, response: response)
node.create_client(Trigger, "/home")
print("ready", flush=True)
import sys; sys.stdin.read()
"""
#: who does not say goodbye stays in the graph for as long as no test waits
LONG_LEASE = "<CycloneDDS><Domain><Discovery><LeaseDuration>3600 s</LeaseDuration></Discovery></Domain></CycloneDDS>"


def test_topics_services_and_nodes_of_another_process(node: Any, run_program: Any, wait_until: Any) -> None:
    program = run_program(OTHER, environ={**os.environ, "CYCLONEDDS_URI": LONG_LEASE})
    assert program.line() == "ready"
    assert node.wait_for_node("far/other", 120)
    # Its endpoints, and which of them are its own, become known one after the other.
    assert wait_until(lambda: len(node.get_service_names_and_types_by_node("other", "/far")) == 8)
    assert wait_until(lambda: len(node.get_client_names_and_types_by_node("other", "/far")) == 1)
    assert wait_until(lambda: len(node.get_publisher_names_and_types_by_node("other", "/far")) == 3)
    assert wait_until(lambda: len(node.get_subscriber_names_and_types_by_node("other", "/far")) == 1)
    assert wait_until(lambda: node.count_clients("/home") == 1)
    assert ("other", "/far") in node.get_node_names_and_namespaces()
    assert ("other", "/far", "/") in node.get_node_names_and_namespaces_with_enclaves()
    assert ("/far/other/status", ["std_msgs/msg/String"]) in node.get_topic_names_and_types()
    dds_topics = dict(node.get_topic_names_and_types(no_demangle=True))
    assert dds_topics["rt/orders"] == ["std_msgs::msg::dds_::String_"]
    assert {name.split("/")[0] for name in dds_topics} == {"rt", "rq", "rr", "ros_discovery_info"}
    assert ("/far/go", ["std_srvs/srv/Trigger"]) in node.get_service_names_and_types()
    assert node.count_publishers("/far/other/status") == node.count_subscribers("/orders") == 1
    assert node.count_services("/far/go") == 1
    publishers = dict(node.get_publisher_names_and_types_by_node("other", "/far"))
    assert publishers == {
        "/far/other/status": ["std_msgs/msg/String"],
        "/parameter_events": ["rcl_interfaces/msg/ParameterEvent"],
        "/rosout": ["rcl_interfaces/msg/Log"],
    }
    assert dict(node.get_subscriber_names_and_types_by_node("other", "/far")) == {"/orders": ["std_msgs/msg/String"]}
    assert dict(node.get_client_names_and_types_by_node("other", "/far")) == {"/home": ["std_srvs/srv/Trigger"]}
    services = dict(node.get_service_names_and_types_by_node("other", "/far"))
    assert services["/far/go"] == ["std_srvs/srv/Trigger"]
    assert services["/far/other/get_parameters"] == ["rcl_interfaces/srv/GetParameters"]
    assert len(services) == 8
    # It ends without saying goodbye to rclpy, and leaves the graph all the same, not at the end of its lease.
    program.finish()
    assert wait_until(lambda: "other" not in node.get_node_names())
    assert wait_until(lambda: node.count_publishers("/far/other/status") == 0)


def test_endpoint_info(node: Any, wait_until: Any) -> None:
    profile = QoSProfile(depth=7, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(String, "status", profile)
    node.create_subscription(String, "status", lambda _: None, 4)
    # Genuine rclpy learns of its own endpoints as of those of others, a moment later.
    assert wait_until(lambda: node.count_publishers("status") == node.count_subscribers("status") == 1)
    (info,) = node.get_publishers_info_by_topic("status")
    assert (info.node_name, info.node_namespace) == ("test_node", "/")
    assert info.topic_type == "std_msgs/msg/String"
    assert str(info.topic_type_hash) == STRING_HASH
    assert info.endpoint_type is TopicEndpointTypeEnum.PUBLISHER
    assert any(info.endpoint_gid)
    assert info.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    assert (info.qos_profile.history, info.qos_profile.depth) == (QoSHistoryPolicy.KEEP_LAST, 7)
    assert "History (Depth): KEEP_LAST (7)" in str(info)
    (info,) = node.get_subscriptions_info_by_topic("rt/status", no_mangle=True)
    assert info.endpoint_type is TopicEndpointTypeEnum.SUBSCRIPTION
    assert info.topic_type == "std_msgs::msg::dds_::String_"
    (info,) = node.get_subscriptions_info_by_topic("status")
    assert info.topic_type == "std_msgs/msg/String"
    assert info == node.get_subscriptions_info_by_topic("status")[0]
    assert info != TopicEndpointInfo()
    assert node.get_publishers_info_by_topic("nothing") == []


def test_unknown_node(node: Any) -> None:
    for query in (
        node.get_publisher_names_and_types_by_node,
        node.get_subscriber_names_and_types_by_node,
        node.get_service_names_and_types_by_node,
        node.get_client_names_and_types_by_node,
    ):
        with pytest.raises(NodeNameNonExistentError):
            query("nobody", "/")


def test_two_types_on_one_topic(node: Any, wait_until: Any) -> None:
    node.create_publisher(String, "mixed", 10)
    node.create_subscription(Int32, "mixed", lambda _: None, 10)
    expected = ("/mixed", ["std_msgs/msg/Int32", "std_msgs/msg/String"])
    assert wait_until(lambda: expected in node.get_topic_names_and_types())


def test_counts_follow(node: Any, wait_until: Any) -> None:
    assert node.count_publishers("here") == 0
    publishers = [node.create_publisher(String, "here", 10) for _ in range(3)]
    assert wait_until(lambda: node.count_publishers("here") == node.count_publishers("/here") == 3)
    for publisher in publishers:
        node.destroy_publisher(publisher)
    assert wait_until(lambda: node.count_publishers("here") == 0)
    service = node.create_service(Trigger, "~/go", lambda request, response: response)
    assert wait_until(lambda: node.count_services("~/go") == 1)
    node.destroy_service(service)
    assert wait_until(lambda: node.count_services("~/go") == 0)


def test_domains_do_not_mix(node: Any, wait_until: Any, other_domain_id: int) -> None:
    other = Context()
    other.init(args=[], domain_id=other_domain_id)
    try:
        stranger = rclpy.create_node("stranger", context=other)
        # Each sees its own domain, and goes on seeing nothing else once the other node is known to be up.
        assert wait_until(lambda: stranger.count_publishers("/rosout") == node.count_publishers("/rosout") == 1)
        assert node.get_node_names() == ["test_node"]
        assert stranger.get_node_names() == ["stranger"]
    finally:
        other.destroy()


def test_wait_for_node_times_out(node: Any) -> None:
    assert not node.wait_for_node("/nobody", 0.05)


def test_type_description_service(node: Any, spinner: Any, wait_until: Any) -> None:
    from type_description_interfaces.srv import GetTypeDescription

    client = node.create_client(GetTypeDescription, "~/get_type_description")
    assert client.wait_for_service(120)
    name = "std_msgs/msg/Header"
    node.create_publisher(Header, "status", 10)
    assert wait_until(lambda: node.count_publishers("status") == 1)
    (info,) = node.get_publishers_info_by_topic("status")
    request = GetTypeDescription.Request(type_name=name, type_hash=str(info.topic_type_hash), include_type_sources=True)
    future = client.call_async(request)
    assert spinner.until(future.done)
    response = future.result()
    assert response.successful, response.failure_reason
    assert response.type_description.type_description.type_name == name
    fields = [field.name for field in response.type_description.type_description.fields]
    assert fields == ["stamp", "frame_id"]
    referenced = [entry.type_name for entry in response.type_description.referenced_type_descriptions]
    assert referenced == ["builtin_interfaces/msg/Time"]
    assert "frame_id" in response.type_sources[0].raw_file_contents
    for type_hash in ("", "RIHS01_" + "0" * 64):
        future = client.call_async(GetTypeDescription.Request(type_name="no_msgs/msg/Such", type_hash=type_hash))
        assert spinner.until(future.done)
        assert not future.result().successful and future.result().failure_reason
