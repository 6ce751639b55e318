"""Services, parameters and what nodes report about themselves, between genuine rclpy and rclpy_embedded."""

from __future__ import annotations

import re
from typing import Any

import rclpy
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_parameter_events
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import SetBool
from type_description_interfaces.srv import GetTypeDescription


def test_many_clients_of_one_server(context: Any, node: Any, spinner: Any, start: Any) -> None:
    start("sample")
    others = [rclpy.create_node(f"client_{number}", context=context) for number in range(4)]
    clients = [other.create_client(SetBool, "/far/set") for other in others]
    for other in others:
        spinner.executor.add_node(other)
    assert all(client.wait_for_service(120) for client in clients)
    futures = [client.call_async(SetBool.Request(data=n % 3 == 0)) for n in range(2) for client in clients]
    assert spinner.until(lambda: all(future.done() for future in futures))
    assert [future.result() for future in futures] == [
        SetBool.Response(success=n % 3 == 0, message="été") for n in range(2) for _ in clients
    ]


def test_embedded_client_sees_what_a_genuine_one_sees(node: Any, spinner: Any, start: Any) -> None:
    def invert(request: Any, response: Any) -> Any:
        response.success = not request.data
        return response

    node.create_service(SetBool, "/invert", invert)
    outputs = []
    # The caller is of one world, the node whose parameters it asks for of the other.
    for genuine in (False, True):
        sample = start("sample", genuine=not genuine)
        caller = start("caller", genuine=genuine)
        assert spinner.until(lambda caller=caller: caller.process.poll() is not None)
        code, out, errors = caller.finish()
        assert code == 0, errors
        outputs.append(out.splitlines())
        sample.process.terminate()
        sample.finish()
        assert spinner.until(lambda: "sample" not in node.get_node_names())
    assert outputs[0][0] == str([n % 3 == 0 for n in range(9)])
    assert outputs[0] == outputs[1]
    assert len(outputs[0]) == 8


def test_server_dies_and_comes_back(node: Any, spinner: Any, start: Any) -> None:
    first = start("sample")
    client = node.create_client(SetBool, "/far/set")
    assert client.wait_for_service(120)
    first.process.kill()
    lost = client.call_async(SetBool.Request(data=True))
    # The lease of a participant that was killed runs out after 10 s.
    assert spinner.until(lambda: not client.service_is_ready())
    assert spinner.until(lambda: "sample" not in node.get_node_names())
    assert spinner.until(lambda: node.count_publishers("/far/status") == 0)
    start("sample")
    assert client.wait_for_service(120)
    future = client.call_async(SetBool.Request(data=True))
    assert spinner.until(future.done)
    assert future.result().success and not lost.done()


def test_parameter_events_rosout_and_time(node: Any, spinner: Any, start: Any) -> None:
    events: list[Any] = []
    logs: list[Any] = []
    statuses: list[Any] = []
    start("sample")
    latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(ParameterEvent, "/parameter_events", events.append, qos_profile_parameter_events)
    node.create_subscription(Log, "/rosout", logs.append, latched)
    node.create_subscription(String, "/far/status", statuses.append, 10)
    orders = node.create_publisher(String, "/far/orders", 10)
    clock = node.create_publisher(Clock, "/clock", 10)
    client = AsyncParameterClient(node, "/far/sample")
    assert client.wait_for_services(120)
    assert spinner.until(lambda: orders.get_subscription_count() == 1 and statuses)
    orders.publish(String(data="a word"))
    assert spinner.until(lambda: any(log.msg == "heard a word" for log in logs))
    log = next(log for log in logs if log.msg == "heard a word")
    assert (log.name, log.level) == ("far.sample", 20)
    future = client.set_parameters([Parameter("use_sim_time", value=True)])
    assert spinner.until(future.done) and future.result().results[0].successful
    assert spinner.until(lambda: any(event.node == "/far/sample" for event in events))
    event = next(event for event in events if event.node == "/far/sample")
    assert [(p.name, p.value.bool_value) for p in event.changed_parameters] == [("use_sim_time", True)]
    # Its timer waits for time to pass now.
    assert spinner.until(lambda: clock.get_subscription_count() == 1)
    spinner.rest(100)
    statuses.clear()
    spinner.rest()
    assert statuses == []
    for tick in range(1, 40):
        clock.publish(Clock(clock=Time(seconds=tick).to_msg()))
        spinner.rest(2)
    assert spinner.until(lambda: len(statuses) > 3)


def test_type_descriptions(node: Any, spinner: Any, start: Any) -> None:
    answers = []
    for genuine in (False, True):
        peer = start("sample", genuine=genuine)
        client = node.create_client(GetTypeDescription, "/far/sample/get_type_description")
        assert client.wait_for_service(120)
        assert spinner.until(lambda: node.count_publishers("/latched") == 1)
        (info,) = node.get_publishers_info_by_topic("/latched")
        request = GetTypeDescription.Request(
            type_name="std_msgs/msg/Header", type_hash=str(info.topic_type_hash), include_type_sources=True
        )
        future = client.call_async(request)
        assert spinner.until(future.done)
        answers.append(future.result())
        node.destroy_client(client)
        peer.process.terminate()
        peer.finish()
        assert spinner.until(lambda: node.count_publishers("/latched") == 0)
    assert answers[0].successful, answers[0].failure_reason
    assert answers[0].type_description == answers[1].type_description
    # The definitions of rclpy_embedded have no comments.
    sources = [
        {
            source.type_name: re.sub(r"\s*(#.*)?\n+", "\n", source.raw_file_contents + "\n").strip()
            for source in answer.type_sources
        }
        for answer in answers
    ]
    assert sources[0] == sources[1]
    assert sources[0].keys() == {"std_msgs/msg/Header", "builtin_interfaces/msg/Time"}
