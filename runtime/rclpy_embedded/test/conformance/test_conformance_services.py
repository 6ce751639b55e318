"""Services and clients."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle, InvalidServiceNameException
from rclpy.task import Future
from std_srvs.srv import Empty, SetBool, Trigger

SERVER = """
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("server")
def answer(request, response):
    import os
    print("called", flush=True)
    os._exit(1)
node.create_service(Trigger, "dies", answer)
print("ready", flush=True)
rclpy.spin(node)
"""


def _invert(request: Any, response: Any) -> Any:
    response.success = not request.data
    response.message = "inverted"
    return response


def test_call(node: Any, spinner: Any) -> None:
    service = node.create_service(SetBool, "invert", _invert)
    client = node.create_client(SetBool, "invert")
    assert client.wait_for_service(120)
    future = client.call_async(SetBool.Request(data=False))
    assert spinner.until(future.done)
    assert future.result() == SetBool.Response(success=True, message="inverted")
    assert service.service_name == client.service_name == "/invert"


def test_blocking_call_from_another_thread(node: Any, spinner: Any) -> None:
    node.create_service(SetBool, "invert", _invert)
    client = node.create_client(SetBool, "invert")
    results: list[Any] = []
    thread = threading.Thread(target=lambda: results.append(client.call(SetBool.Request(data=True), timeout_sec=120)))
    thread.start()
    assert spinner.until(lambda: results)
    thread.join()
    assert results[0].message == "inverted"


def test_blocking_call_times_out(node: Any) -> None:
    client = node.create_client(Trigger, "nobody")
    assert client.call(Trigger.Request(), timeout_sec=0.01) is None


def test_responses_go_to_their_callers(context: Any, node: Any, spinner: Any) -> None:
    node.create_service(SetBool, "invert", _invert)
    others = [rclpy.create_node(f"client_{number}", context=context) for number in range(8)]
    clients = [other.create_client(SetBool, "/invert") for other in others]
    for other in others:
        spinner.executor.add_node(other)
    assert all(client.wait_for_service(120) for client in clients)
    futures = [client.call_async(SetBool.Request(data=bool(n % 2))) for n, client in enumerate(clients)]
    assert spinner.until(lambda: all(future.done() for future in futures))
    assert [future.result().success for future in futures] == [n % 2 == 0 for n in range(8)]


def test_concurrent_calls_of_one_client(node: Any, spinner: Any) -> None:
    node.create_service(SetBool, "invert", _invert)
    client = node.create_client(SetBool, "invert")
    assert client.wait_for_service(120)
    futures = [client.call_async(SetBool.Request(data=bool(n % 2))) for n in range(9)]
    assert spinner.until(lambda: all(future.done() for future in futures))
    assert [future.result().success for future in futures] == [n % 2 == 0 for n in range(9)]


def test_async_service_callback(node: Any, spinner: Any) -> None:
    gate: Future = Future()

    async def answer(request: Any, response: Any) -> Any:
        response.message = await gate
        return response

    node.create_service(Trigger, "slow", answer, callback_group=ReentrantCallbackGroup())
    client = node.create_client(Trigger, "slow")
    assert client.wait_for_service(120)
    future = client.call_async(Trigger.Request())
    spinner.rest()
    assert not future.done()
    gate.set_result("at last")
    assert spinner.until(future.done)
    assert future.result().message == "at last"


def test_await_a_call_in_a_callback(node: Any, spinner: Any) -> None:
    node.create_service(SetBool, "invert", _invert)
    client = node.create_client(SetBool, "invert")
    results: list[Any] = []

    async def ask() -> None:
        timer.cancel()
        results.append(await client.call_async(SetBool.Request(data=False)))

    assert client.wait_for_service(120)
    timer = node.create_timer(0.01, ask, callback_group=ReentrantCallbackGroup())
    assert spinner.until(lambda: results)
    assert results[0].success


def test_removed_request_is_forgotten(node: Any, spinner: Any) -> None:
    node.create_service(Trigger, "late", lambda request, response: response)
    client = node.create_client(Trigger, "late")
    assert client.wait_for_service(120)
    future = client.call_async(Trigger.Request())
    client.remove_pending_request(future)
    spinner.rest()
    assert not future.done()


def test_availability_follows_the_server(node: Any, wait_until: Any) -> None:
    client = node.create_client(Trigger, "comes_and_goes")
    assert not client.service_is_ready()
    assert not client.wait_for_service(0.02)
    service = node.create_service(Trigger, "comes_and_goes", lambda request, response: response)
    assert client.wait_for_service(120)
    node.destroy_service(service)
    assert wait_until(lambda: not client.service_is_ready())


def test_wait_for_service_ends_with_the_context(context: Any, node: Any) -> None:
    client = node.create_client(Trigger, "nobody")
    threading.Timer(0.1, context.shutdown).start()
    with pytest.raises(RCLError, match="context is invalid"):
        client.wait_for_service(30)


def test_server_dies_mid_call(node: Any, spinner: Any, run_program: Any) -> None:
    client = node.create_client(Trigger, "dies")
    server = run_program(SERVER)
    assert server.line() == "ready"
    assert client.wait_for_service(120)
    future = client.call_async(Trigger.Request())
    assert server.line() == "called"
    spinner.rest()
    assert not future.done()
    # A new server serves the next call of the same client.
    node.create_service(Trigger, "dies", lambda request, response: Trigger.Response(success=True))
    again = client.call_async(Trigger.Request())
    assert spinner.until(again.done)
    assert again.result().success


def test_wrong_types(node: Any) -> None:
    client = node.create_client(Trigger, "typed")
    service = node.create_service(Trigger, "typed", lambda request, response: response)
    with pytest.raises(TypeError):
        client.call_async(Empty.Request())
    with pytest.raises(TypeError):
        client.call(Trigger.Response())
    with pytest.raises(TypeError):
        service.send_response(Empty.Response(), None)
    with pytest.raises(TypeError):
        service.send_response(Trigger.Response(), None)


def test_callback_that_returns_nothing_raises(node: Any, spinner: Any) -> None:
    node.create_service(Trigger, "silent", lambda request, response: None)
    client = node.create_client(Trigger, "silent")
    assert client.wait_for_service(120)
    assert client.wait_for_service(120)
    client.call_async(Trigger.Request())
    with pytest.raises(TypeError):
        spinner.until(lambda: False)


def test_names(node: Any) -> None:
    with pytest.raises(InvalidServiceNameException):
        node.create_client(Trigger, "bad name")
    with pytest.raises(InvalidServiceNameException):
        node.create_service(Trigger, "1st", lambda request, response: response)
    assert node.create_client(Trigger, "~/go").service_name == "/test_node/go"
    assert node.resolve_service_name("go") == "/go"


def test_after_destruction(node: Any) -> None:
    client = node.create_client(Trigger, "gone")
    service = node.create_service(Trigger, "gone", lambda request, response: response)
    assert node.destroy_client(client) and node.destroy_service(service)
    for use in (lambda: client.call_async(Trigger.Request()), client.service_is_ready, lambda: service.service_name):
        with pytest.raises(InvalidHandle):
            use()


def test_futures_are_not_asyncio(node: Any) -> None:
    assert not asyncio.isfuture(node.create_client(Trigger, "any").call_async(Trigger.Request()))
