"""Connections of strangers do not keep others out.

The gate by itself, and before the real server.
"""

import contextlib
import socket
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed

from fsw_hmi.gate import Gate, client_of, is_loopback
from fsw_hmi.web_server import server as make_uvicorn
from fsw_test_support.page_client import PATIENCE_S

TOKEN = "a token of some length"
HERE, THERE = "127.0.0.1", "127.0.0.5"


class Link:
    """A connection that is open until it is shut down."""

    def __init__(self):
        self.open = True

    def fileno(self):
        return 5 if self.open else -1

    def shutdown(self, _):
        self.open = False


class Door:
    """A gate with connections by address and port."""

    def __init__(self, **limits):
        self.gate, self.links, self.requests, self.now_s = (
            Gate(**limits),
            {},
            contextlib.ExitStack(),
            0.0,
        )

    def come(self, host, port, asks=False, known=False):
        self.now_s += 0.001
        self.links[host, port] = Link()
        self.gate.admit((host, port), self.links[host, port], self.now_s)
        if asks:
            self.requests.enter_context(self.gate.request((host, port)))
        if known:
            self.gate.touch((host, port), True)

    def open(self, host):
        return [
            port for (address, port), link in self.links.items() if address == host and link.open
        ]


def test_client_with_too_many_loses_its_oldest_that_waits_then_its_oldest_page():
    door = Door(of_client=3)
    door.come(HERE, 1, asks=True)
    door.come(HERE, 2)
    door.come(HERE, 3)
    door.come(THERE, 1)
    door.come(HERE, 4, asks=True)
    assert (door.open(HERE), door.open(THERE)) == ([1, 3, 4], [1])
    door.come(HERE, 5, asks=True)
    assert door.open(HERE) == [1, 4, 5]
    door.come(HERE, 6)
    assert door.open(HERE) == [4, 5, 6]


def test_page_that_was_touched_outlasts_those_that_were_not():
    door = Door(of_client=3)
    for port in (1, 2, 3):
        door.come(HERE, port, asks=True)
    door.gate.touch((HERE, 1), False)
    door.come(HERE, 4, asks=True)
    door.gate.touch((HERE, 4), False)
    door.come(HERE, 5, asks=True)
    assert door.open(HERE) == [1, 4, 5]
    door.come(HERE, 6, asks=True)
    assert door.open(HERE) == [1, 4, 6]


def test_without_strangers_the_page_of_a_user_that_is_untouched_for_longest_goes():
    door = Door(of_client=2)
    door.come(HERE, 1, asks=True, known=True)
    door.come(HERE, 2, asks=True, known=True)
    door.gate.touch((HERE, 1), True)
    door.come(HERE, 3, asks=True)
    assert door.open(HERE) == [1, 3]
    door.come(HERE, 4, asks=True)  # a stranger costs no second user the page
    assert door.open(HERE) == [1, 4]


def test_client_with_one_page_keeps_it_when_many_others_have_one_each():
    door = Door(of_all=3)
    door.come(HERE, 1, asks=True, known=True)
    for host in range(9):
        door.come(f"192.0.2.{host}", 1, asks=True)
    assert door.open(HERE) == [1]


def test_of_too_many_altogether_the_client_with_the_most_loses_one():
    door = Door(of_client=10, of_all=6)
    door.come(HERE, 1, asks=True)
    for port in range(5):
        door.come(THERE, port)
    door.come(HERE, 2)
    assert (door.open(HERE), door.open(THERE)) == ([1, 2], [1, 2, 3, 4])


def test_connection_must_send_a_whole_request_in_time_each_time():
    door = Door(request_s=10.0)
    door.come(HERE, 1)
    door.come(HERE, 2, asks=True)
    door.gate.sweep(9.0)
    assert door.open(HERE) == [1, 2]
    door.gate.sweep(10.1)
    assert door.open(HERE) == [2]
    door.requests.close()  # answered: now it waits again
    door.gate.sweep(time.monotonic() + 9.0)
    assert door.open(HERE) == [2]
    door.gate.sweep(time.monotonic() + 10.1)
    assert door.open(HERE) == []


def test_closed_connections_do_not_count_and_may_be_unknown():
    door = Door(of_client=2)
    for port in range(100):
        door.come(HERE, port, asks=True)
        door.links[HERE, port].open = False
    door.come(HERE, 101)
    door.come(HERE, 102)
    assert door.open(HERE) == [101, 102]
    door.gate.touch((HERE, 7), True)
    with door.gate.request(None), door.gate.request(("stranger", 1)):
        door.gate.touch(None, True)


@given(
    st.lists(
        st.tuples(st.sampled_from([HERE, THERE, "192.0.2.1"]), st.booleans(), st.booleans()),
        max_size=60,
    ),
    st.integers(1, 8),
    st.integers(1, 12),
)
def test_limits_hold_whoever_comes_and_users_lose_a_page_only_without_strangers(
    comers, of_client, of_all
):
    door = Door(of_client=of_client, of_all=of_all)
    known = set()
    for port, (host, asks, knows) in enumerate(comers):
        before = {client for client, link in door.links.items() if link.open}
        door.come(host, port, asks)
        lost = [client for client in before if not door.links[client].open]
        assert door.links[host, port].open and len(lost) <= 1
        if lost and lost[0] in known:
            own = {client for client in before if client[0] == host}
            assert known >= (own if len(own) == of_client else before)
        if knows:
            door.gate.touch((host, port), True)
            known.add((host, port))
        assert sum(link.open for link in door.links.values()) <= of_all
        assert all(len(door.open(host)) <= of_client for host in (HERE, THERE, "192.0.2.1"))


def half_open(server, stack, count, host, content=b"GET / HTTP/1.1\r\nHost: "):
    """Connections that have not sent a whole request."""
    connections = []
    for _ in range(count):
        connection = stack.enter_context(
            socket.create_connection((HERE, server.port), PATIENCE_S, (host, 0))
        )
        connection.sendall(content)
        connections.append(connection)
    return connections


@pytest.mark.slow
@pytest.mark.requirement("S30")
@pytest.mark.parametrize("host", [HERE, THERE])
def test_300_half_open_requests_shut_no_new_page_out(server, host):
    with contextlib.ExitStack() as stack:
        anna = stack.enter_context(server.open())
        assert anna.log_in(TOKEN)["outcome"] == "done"
        strangers = half_open(server, stack, 300, host)
        strangers[0].settimeout(PATIENCE_S)
        assert strangers[0].recv(1) == b""  # the oldest has gone
        with server.open() as page:
            assert page.log_in(TOKEN, "bert")["outcome"] == "done"
        anna.send("safe_stop")
        assert server.next_order().asked == "safe stop"


@pytest.mark.slow
@pytest.mark.requirement("S30")
@pytest.mark.parametrize("host", [HERE, THERE])
def test_idle_pages_of_strangers_shut_no_new_page_out(make_server, host):
    server = make_server(limits={"of_client": 20})
    with contextlib.ExitStack() as stack:
        anna = stack.enter_context(server.open(source_address=(host, 0)))
        assert anna.log_in(TOKEN)["outcome"] == "done"
        strangers = [stack.enter_context(server.open(source_address=(host, 0))) for _ in range(20)]
        with pytest.raises(ConnectionClosed):
            strangers[0].until("never")
        with server.open() as page:
            assert page.receive()["t"] == "hello"
        with server.open(source_address=(host, 0)) as page:
            assert page.log_in(TOKEN, "bert")["outcome"] == "done"
        assert anna.ask("withdraw_request")["code"] == "not_asker"


@pytest.mark.slow
@pytest.mark.requirement("S30")
def test_strangers_at_many_addresses_shut_no_new_page_out(server):
    with contextlib.ExitStack() as stack:
        for host in range(2, 10):
            half_open(server, stack, 100, f"127.0.0.{host}")
        with server.open() as page:
            assert page.receive()["t"] == "hello"
        assert len(server.gate._peers) <= 601


def test_few_connections_are_accepted_at_once():
    """The event loop accepts as many in a row as may wait, and does nothing else meanwhile."""
    assert make_uvicorn(lambda *_: None, Gate()).config.backlog <= 32


@pytest.mark.slow
def test_server_closes_a_request_that_trickles_in_by_the_clock(make_server):
    server = make_server()
    with contextlib.ExitStack() as stack:
        page = stack.enter_context(server.open())
        (late,) = half_open(server, stack, 1, HERE)
        server.gate._request_s = 1.0
        end_s = time.monotonic() + PATIENCE_S
        with pytest.raises(OSError):
            while time.monotonic() < end_s:
                late.sendall(b"x")  # each byte would wind up an idle timer
                page.until("beat")
        page.until("beat")  # an open page needs no request


@pytest.mark.parametrize(
    ("address", "client", "local"),
    [
        ("127.0.0.1", "127.0.0.1", True),
        ("127.3.2.1", "127.3.2.1", True),
        ("::1", "::/64", True),
        ("::ffff:127.0.0.1", "127.0.0.1", True),
        ("192.0.2.4", "192.0.2.4", False),
        ("::ffff:192.0.2.4", "192.0.2.4", False),
        ("2001:db8::1:2:3:4", "2001:db8::/64", False),
        ("fe80::1%eth0", "fe80::/64", False),
        ("localhost", "localhost", False),
        ("", "", False),
    ],
)
def test_client_of_an_address(address, client, local):
    assert (client_of(address), is_loopback(address)) == (client, local)
