"""Passwords are checked beside everything else: a flood of logins delays nothing."""

import contextlib
import os
import threading

import pytest

from fsw_hmi.users import Users, new_user
from fsw_test_support.page_client import PATIENCE_S
from fsw_test_support.waiting import wait_until

PASSWORD = "correct horse battery"
NAMES = ("otto", "olga", "egon")


class SlowUsers(Users):
    """Users whose passwords take until the test says so."""

    def __init__(self):
        super().__init__(new_user(name, PASSWORD) for name in NAMES)
        self.begun, self.go_on = threading.Semaphore(0), threading.Semaphore(0)

    def check(self, name, password):
        self.begun.release()
        assert self.go_on.acquire(timeout=PATIENCE_S)
        return super().check(name, password)


@pytest.fixture
def users():
    return SlowUsers()


@pytest.mark.slow
def test_check_runs_in_a_thread_that_steps_back_and_may_fail(make_server, users, monkeypatch):
    priorities = []

    def too_large(name, password):
        priorities.append(os.getpriority(os.PRIO_PROCESS, 0))
        raise MemoryError

    monkeypatch.setattr(users, "check", too_large)
    server = make_server(users=users)
    with server.open() as page:
        for _ in range(2):
            assert page.log_in(PASSWORD, "otto")["code"] == "busy"
    assert priorities == [min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)] * 2


@pytest.mark.slow
@pytest.mark.requirement("S30")
def test_flood_of_logins_delays_no_safe_stop_and_no_frame(make_server, users):
    server = make_server(users=users)
    with contextlib.ExitStack() as stack:
        otto = stack.enter_context(server.open())
        number = otto.send("login", name="otto", password=PASSWORD)
        assert users.begun.acquire(timeout=PATIENCE_S)
        users.go_on.release()
        answer = otto.until("answer", lambda frame: frame["id"] == number)
        assert answer["code"] == "logged_in"
        for host in range(2, 12):
            stranger = stack.enter_context(server.open(source_address=(f"127.0.0.{host}", 0)))
            stranger.send("login", name="egon", password=f"guess {host}")
        assert users.begun.acquire(timeout=PATIENCE_S)  # and runs until the test ends it
        otto.send("safe_stop")
        assert server.next_order().who.startswith("otto (")
        otto.until("beat")
        waiting = stack.enter_context(server.open())  # on this computer
        waiting.send("login", name="olga", password=PASSWORD)
        waiting.send("safe_stop")
        assert "this computer" in server.next_order().who
        users.go_on.release(100)


@pytest.mark.slow
def test_page_that_leaves_while_its_password_is_checked_is_forgotten(make_server, users):
    server = make_server(users=users)
    with server.open() as gone:
        gone.send("login", name="otto", password=PASSWORD)
        assert users.begun.acquire(timeout=PATIENCE_S)
    users.go_on.release(100)
    with server.open() as page:
        wait_until(lambda: page.log_in(PASSWORD, "olga")["outcome"] == "done", "the first check")
        assert page.ask("take_control")["outcome"] == "done"


@pytest.mark.slow
@pytest.mark.requirement("S18")
def test_control_is_handed_over_on_real_pages(make_server, users):
    users.go_on.release(100)
    server = make_server(users=users, rules={"handover_timeout_s": 3600.0})
    with server.open() as otto, server.open() as olga:
        otto.command(PASSWORD, "otto")
        assert server.next_order().asked == "take control"
        assert olga.log_in(PASSWORD, "olga")["outcome"] == "done"
        assert olga.ask("request_control")["outcome"] == "done"
        asked = otto.seen("control", lambda frame: frame["request"])["request"]
        assert asked["name"] == "olga"
        assert otto.ask("hand_over_control", to=asked["session"])["outcome"] == "done"
        assert olga.seen("control", lambda frame: frame["you"])["note_code"] == "received"
        recorded = [server.next_order() for _ in range(2)]
        assert [(record.who.split()[0], record.asked) for record in recorded] == [
            ("olga", "request control"),
            ("otto", "hand over control"),
        ]
