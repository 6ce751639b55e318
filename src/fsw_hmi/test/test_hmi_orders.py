"""Requests to the graph's services: what becomes of them in time."""

from types import SimpleNamespace

import pytest
from rclpy.task import Future

from fsw_hmi import orders_ros
from fsw_hmi.orders_ros import Orders
from fsw_hmi.requests import SetReference
from fsw_hmi.weld_view import Awake
from fsw_msgs.srv import SetReference as Service

PATIENCE_S = 3.0


class Services:
    """A node whose services are there and answer when the test says so."""

    def __init__(self):
        self.future = Future()

    def create_client(self, *_):
        return self

    def service_is_ready(self):
        return True

    def call_async(self, _):
        return self.future

    def remove_pending_request(self, _):
        self.future.cancel()


def test_request_after_a_pause_that_is_not_noted_yet_waits_no_longer(monkeypatch):
    now = SimpleNamespace(monotonic=lambda: now.s, s=100.0)
    monkeypatch.setattr(orders_ros, "time", now)
    awake, answers = Awake(), []
    orders = Orders(Services(), awake)
    awake.look(now.s)
    now.s += 3.0 * PATIENCE_S
    action = SetReference(depth_mm=2.7, temperature_c=820.0)
    orders.carry_out(action, "", answers.append, PATIENCE_S)
    begun_s = now.s
    while not answers:
        now.s += 0.05
        awake.look(now.s)
        orders.look()
    assert now.s - begun_s == pytest.approx(PATIENCE_S, abs=0.11)


@pytest.mark.parametrize(("stood_still", "outcome"), [(True, "done"), (False, "timed_out")])
def test_answer_that_came_while_the_page_stood_still_counts(monkeypatch, stood_still, outcome):
    now = SimpleNamespace(monotonic=lambda: now.s, s=100.0)
    monkeypatch.setattr(orders_ros, "time", now)
    services, awake, answers = Services(), Awake(), []
    orders = Orders(services, awake)
    awake.look(now.s)
    orders.carry_out(
        SetReference(depth_mm=2.7, temperature_c=820.0), "", answers.append, PATIENCE_S
    )
    for look in range(1, 64):
        now.s = 100.0 + 0.05 * look
        if not stood_still or look == 63:
            awake.look(now.s)
            orders.look()
    if not services.future.cancelled():
        services.future.set_result(Service.Response(ok=True, code="next"))
    assert [answer.outcome for answer in answers] == [outcome]
