"""A request to a supervisor that was stalled: acted on and answered only when it is certain that it leads."""

import pytest

from fsw_supervisor.leadership_ros import Leadership


class Standing:
    """A node without an executor, and a failover that says what a test wants."""

    executor = None
    now = None

    def leads(self, _now_s):
        return self.now


def step(coroutine):
    """Run a coroutine until it waits; its result, None while it waits."""
    try:
        coroutine.send(None)
    except StopIteration as end:
        return end.value
    return None


@pytest.mark.requirement("S28")
@pytest.mark.parametrize("leads", [True, False])
def test_a_request_waits_until_it_is_certain_who_leads(leads):
    standing = Standing()
    leadership = Leadership(standing, standing)
    first, second = leadership.certain(), leadership.certain()
    assert step(first) is None and step(second) is None
    leadership.look()
    assert step(first) is None, "still uncertain"
    standing.now = leads
    leadership.look()
    assert step(first) is leads and step(second) is leads
    assert step(leadership.certain()) is leads


def test_a_second_stall_before_the_request_goes_on_makes_it_wait_again():
    standing = Standing()
    leadership = Leadership(standing, standing)
    asked = leadership.certain()
    step(asked)
    standing.now = True
    leadership.look()
    standing.now = None
    assert step(asked) is None
    standing.now = False
    leadership.look()
    assert step(asked) is False
