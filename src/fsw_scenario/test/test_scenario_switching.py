"""Requests for a controller that no supervisor receives, or answers too late."""

from unittest.mock import create_autospec

import pytest
from rclpy.node import Node

from fsw_scenario.switching_ros import Switching


@pytest.fixture
def lone_switching(monkeypatch):
    """Without time for a delivery, on a client that never gets an answer."""
    monkeypatch.setattr("fsw_scenario.switching_ros._DELIVERY_S", 0.0)
    node, received = create_autospec(Node, instance=True), []
    made = Switching(node, lambda: received.append(True))
    return made, node, node.create_client.return_value, received


@pytest.mark.parametrize("is_sent", [False, True])
def test_a_request_that_no_supervisor_receives_is_dropped_and_logged(lone_switching, is_sent):
    switching, node, client, received = lone_switching
    client.service_is_ready.return_value = is_sent
    switching.ask("nmpc")
    switching.look()
    switching.look()
    assert received == [True]
    assert node.get_logger.return_value.error.call_count == 1
    forgotten = [call.args for call in client.remove_pending_request.call_args_list]
    assert forgotten == [(client.call_async.return_value,)] * is_sent


def test_an_answer_after_the_weld_has_left_the_graph_permits_nothing(lone_switching):
    switching, _, client, received = lone_switching
    switching.ask("nmpc")
    answer = client.call_async.return_value
    (on_answer,) = answer.add_done_callback.call_args.args
    switching.destroy()
    on_answer(answer)
    assert received == []
