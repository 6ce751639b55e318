"""A request to a supervisor that was stalled: acted on only when it is certain who leads."""

import pytest

from fsw_supervisor.failover import Role
from fsw_supervisor.services_ros import Leadership


class Standing:
    """A node without an executor, and a failover in the state that a test gives it."""

    executor = None
    certain = False
    role = Role.ACTIVE

    def is_certain(self, _now_s):
        return self.certain


def step(coroutine):
    """Run a coroutine until it waits; its result, None while it waits."""
    try:
        coroutine.send(None)
    except StopIteration as end:
        return end.value
    return None


@pytest.mark.requirement("S28")
@pytest.mark.parametrize("role", [Role.ACTIVE, Role.STANDBY])
def test_a_request_waits_until_it_is_certain_who_leads(role):
    standing = Standing()
    leadership = Leadership(standing, standing)
    first, second = leadership.certain(), leadership.certain()
    assert step(first) is None and step(second) is None
    leadership.look()
    assert step(first) is None, "still uncertain"
    standing.certain, standing.role = True, role
    leadership.look()
    leads = role is Role.ACTIVE
    assert step(first) is leads and step(second) is leads
    assert step(leadership.certain()) is leads


def test_a_second_stall_before_the_request_continues_makes_it_wait_again():
    standing = Standing()
    leadership = Leadership(standing, standing)
    answer = leadership.certain()
    step(answer)
    standing.certain = True
    leadership.look()
    standing.certain = False
    assert step(answer) is None
    standing.certain, standing.role = True, Role.STANDBY
    leadership.look()
    assert step(answer) is False
