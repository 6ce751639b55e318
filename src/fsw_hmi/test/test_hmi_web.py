"""The web server with real sockets, without a graph."""

import contextlib
import json
import shutil
import socket
import time
from functools import partial
from http.client import HTTPConnection

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus

from fsw_control.schema.errors import InputError
from fsw_hmi.gate import HEADERS
from fsw_hmi.web import PageFiles
from fsw_hmi.web_server import listen
from fsw_test_support.waiting import wait_until

pytestmark = pytest.mark.slow
MANY = 100_000
TOKEN = "a token of some length"


def get(server, path, method="GET", **headers):
    connection = HTTPConnection("127.0.0.1", server.port, timeout=240)
    connection.request(
        method, path, headers={name.title(): value for name, value in headers.items()}
    )
    response = connection.getresponse()
    return response, response.read()


def test_page_and_its_files(server):
    response, content = get(server, "/")
    assert (response.status, content.decode()) == (
        200,
        f'<meta name="build" content="{server.files.build}"><p>live</p>',
    )
    response, content = get(server, "/page/main.js")
    assert (response.getheader("content-type"), content) == (
        "text/javascript; charset=utf-8",
        b"export {};",
    )
    assert get(server, "/page/sub/LICENSE")[1] == b"MIT"


def test_uplot_is_served_if_the_page_was_built_with_it(make_server, folder, uplot, capsys):
    shutil.copytree(uplot, folder / "uplot")
    server = make_server()
    response, content = get(server, "/page/uplot/uPlot.iife.min.js")
    assert response.getheader("content-type") == "text/javascript; charset=utf-8"
    assert content == (uplot / "uPlot.iife.min.js").read_bytes()
    response, _ = get(server, "/page/uplot/uPlot.min.css")
    assert response.getheader("content-type") == "text/css; charset=utf-8"
    assert capsys.readouterr().err == ""


def test_page_that_was_built_without_uplot_says_so(folder, capsys):
    PageFiles("live", folder)
    assert "no trends" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("path", "method", "status"),
    [
        ("/", "POST", 405),
        ("/page/none.js", "GET", 404),
        ("/page/../../hmi.yaml", "GET", 404),
        ("/page/..%2f..%2fhmi.yaml", "GET", 404),
        ("/page//etc/passwd", "GET", 404),
        ("/etc/passwd", "GET", 404),
        ("/all_welds", "GET", 404),
        ("/ws", "GET", 404),
        ("/page/main.js", "DELETE", 405),
        ("/page/" + "x" * 60_000, "GET", 404),
    ],
)
def test_nothing_else_is_served_and_every_answer_has_the_headers(server, path, method, status):
    response, _ = get(server, path, method)
    assert response.status == status
    assert {name: response.getheader(name) for name in HEADERS} == HEADERS


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "localhost:{port}"}, 200),
        ({"host": "[::1]"}, 200),
        ({"host": "WELD.example"}, 200),
        ({"host": "127.0.0.1:{port}", "origin": "http://127.0.0.1:{port}"}, 200),
        ({"host": "stranger.example"}, 400),
        ({"host": "127.0.0.1.stranger.example"}, 400),
        ({"host": "127.0.0.1@stranger.example"}, 400),
        ({"host": "[::1"}, 400),
        ({"host": ""}, 400),
        ({"host": "127.0.0.1:{port}", "origin": "http://stranger.example"}, 403),
        ({"host": "127.0.0.1:{port}", "origin": "null"}, 403),
    ],
)
def test_host_and_origin_must_be_those_of_the_page(server, headers, status):
    given_headers = {name: value.format(port=server.port) for name, value in headers.items()}
    response, _ = get(server, "/", **given_headers)
    assert response.status == status
    assert response.getheader("content-security-policy") == HEADERS["Content-Security-Policy"]


@pytest.mark.parametrize("origin", [None, "http://stranger.example", "null"])
def test_websocket_of_another_page_is_refused(server, origin):
    with pytest.raises(InvalidStatus) as refused:
        server.open(origin=origin)
    assert refused.value.response.status_code == 403


def test_websocket_under_the_name_of_a_stranger_is_refused(server):
    upgrade = {"connection": "Upgrade", "upgrade": "websocket", "sec-websocket-version": "13"}
    upgrade["sec-websocket-key"] = "dGhlIHNhbXBsZSBub25jZQ=="
    response, _ = get(
        server, "/ws", host="stranger.example", origin="http://stranger.example", **upgrade
    )
    assert response.status == 400
    origin = f"http://127.0.0.1:{server.port}"
    assert (
        get(server, "/ws", host=f"127.0.0.1:{server.port}", origin=origin, **upgrade)[0].status
        == 101
    )


def test_further_page_is_for_users_and_has_the_same_policy(make_server):
    def broken():
        raise InputError("nothing there")

    pages = {"history": lambda: "<p>6 welds</p>", "broken": broken}
    server = make_server(pages=pages)
    with server.open() as page:
        assert page.seen("hello")["pages"] == ["history", "broken"]
        tickets = ["", "guess", page.seen("control")["ticket"]]
        assert [get(server, f"/pages/history?ticket={one}")[0].status for one in tickets] == [
            403
        ] * 3
        page.log_in(TOKEN)
        ticket = page.seen("control", lambda frame: frame["authenticated"])["ticket"]
        response, content = get(server, f"/pages/history?ticket={ticket}")
        assert (response.status, content) == (200, b"<p>6 welds</p>")
        assert {name: response.getheader(name) for name in HEADERS} == HEADERS
        assert get(server, f"/pages/broken?ticket={ticket}")[0].status == 404
        assert get(server, f"/pages/other?ticket={ticket}")[0].status == 404
    wait_until(lambda: get(server, f"/pages/history?ticket={ticket}")[0].status == 403, "the end")


def test_page_that_is_out_of_date_is_told(server):
    with server.open(build="old") as page:
        assert page.receive() == {"t": "stale", "build": server.files.build}
        with pytest.raises(ConnectionClosed) as closed:
            page.receive()
    assert closed.value.rcvd.code == 4001


def test_page_is_told_what_is_known_and_the_past_from_the_newest_on(server):
    def fill():
        for number in range(1300):
            server.page.tick(f"[{number}]", None, time.monotonic())
        server.page.show("state", '{"t":"state","known":true}')

    server.call(fill)
    with server.open() as page:
        hello = page.receive()
        assert (hello["t"], hello["source"], hello["limits"]) == ("hello", "live", {})
        past = [page.until("history")["rows"] for _ in range(3)]
        assert [(rows[0], len(rows)) for rows in past] == [([1200], 100), ([600], 600), ([0], 600)]
        assert page.frames["state"]["known"]
        assert page.frames["control"] == {
            **{"t": "control", "holder": None, "you": False, "request": None, "name": ""},
            **{
                "authenticated": False,
                "ticket": "",
                "may_stop": True,
                "note": "",
                "note_code": "",
            },
        }
        assert page.until("beat")["tick_age_s"] >= 0.0


def test_another_weld_begins_with_another_hello(server):
    server.call(server.page.tick, "[1]", None, time.monotonic())
    with server.open() as page:
        page.until("history")
        server.call(server.page.show, "alarms", '{"t":"alarms","alarms":[]}')
        server.call(server.page.show, "progress", '{"t":"progress","phase":"parking"}')
        server.call(server.page.forget)
        page.until("hello")
        server.call(server.page.tick, "[2]", '{"t":"tick","row":[2]}', time.monotonic())
        assert page.until("tick")["row"] == [2]
    with server.open() as page:
        assert page.until("history")["rows"] == [[2]]
        assert ("alarms" in page.frames, "progress" in page.frames) == (True, False)


@pytest.mark.requirement("S20")
def test_request_goes_to_the_graph_and_is_answered_once(server):
    with server.open() as page:
        page.command(TOKEN)
        number = page.send("mode", mode="hold")
        orders = [server.next_order() for _ in range(2)]
        assert [(order.asked, order.answer.outcome) for order in orders] == [
            ("take control", "done"),
            ("mode hold", ""),
        ]
        server.answer(orders[1], "refused", "no")
        server.answer(orders[1], "done", "too late")
        answer = page.until("answer")
        assert answer == {
            "t": "answer",
            "id": number,
            "outcome": "refused",
            "code": "",
            "message": "no",
        }
        assert (
            page.ask("release_control")["outcome"] == "done"
        )  # and no second answer before this one
        released = server.next_order()
        assert (released.asked, released.answer.outcome, released.action) == (
            "release control",
            "done",
            None,
        )
        assert all(order.who.startswith("anna (") for order in (*orders, released))


def test_everybody_sees_who_has_control_and_a_reload_frees_it(server):
    with server.open() as anna, server.open() as bert:
        anna.command(TOKEN)
        assert bert.until("control", lambda frame: frame["holder"])["holder"]["name"] == "anna"
        assert bert.ask("login", token=TOKEN, name="bert")["outcome"] == "done"
        assert bert.ask("take_control")["outcome"] == "refused"
        anna.socket.close()
        bert.until("control", lambda frame: frame["holder"] is None)
        assert bert.ask("take_control")["outcome"] == "done"


def test_page_of_a_user_is_not_pushed_out_by_new_ones(make_server):
    server = make_server(limits={"of_client": 2})
    with contextlib.ExitStack() as stack:
        operator, new = stack.enter_context(server.open()).command(TOKEN), None
        for _ in range(5):
            before, new = new, stack.enter_context(server.open())
            new.until("control")
            if before:
                with pytest.raises(ConnectionClosed):
                    before.until("never")
        assert operator.ask("withdraw_request")["code"] == "not_asker"


@pytest.mark.requirement("S18")
def test_page_that_resumes_is_not_pushed_out_before_it_asks_for_something(make_server):
    server = make_server(limits={"of_client": 3})
    with contextlib.ExitStack() as stack:
        operator = server.open().command(TOKEN)
        operator.socket.close(4002)
        wait_until(lambda: server.room.holder.lost_s is not None, "the loss of the connection")
        again = stack.enter_context(server.open(resume=operator.frames["hello"]["resume"]))
        assert again.seen("control")["you"]
        for _ in range(5):
            stack.enter_context(server.open()).until("control")
        assert again.ask("withdraw_request")["code"] == "not_asker"


@pytest.mark.requirement("S30")
def test_page_that_somebody_touches_is_not_pushed_out_by_idle_ones(make_server):
    server = make_server(limits={"of_client": 20})
    with contextlib.ExitStack() as stack:
        touched = stack.enter_context(server.open())
        assert touched.ask("take_control")["message"] == "log in first"
        idle = [stack.enter_context(server.open()) for _ in range(60)]
        with pytest.raises(ConnectionClosed):
            idle[0].until("never")
        touched.send("safe_stop")
        assert "this computer" in server.next_order().who
        assert idle[-1].receive()["t"] == "hello"


@pytest.mark.requirement("S30")
def test_safe_stop_is_not_delayed_by_what_others_do(make_server):
    server = make_server(limits={"of_client": 20})
    other = {"source_address": ("127.0.0.5", 0)}
    with contextlib.ExitStack() as stack:
        anna = stack.enter_context(server.open())
        assert anna.ask("login", token=TOKEN, name="anna")["outcome"] == "done"
        for _ in range(5):
            stack.enter_context(server.open(build="old", **other)).until("stale")
        strangers = [stack.enter_context(server.open(**other)) for _ in range(3)]
        for number, page in enumerate([*strangers, *strangers[:2]]):
            assert page.ask("login", token=f"guess {number}", name="x")["message"] == "wrong token"
        assert strangers[1].ask("login", token=TOKEN, name="colleague")["outcome"] == "done"
        anna.send("safe_stop")
        assert server.next_order().who.startswith("anna (")
        assert (
            stack.enter_context(server.open()).ask("login", token=TOKEN, name="bert")["outcome"]
            == "done"
        )


def test_page_on_this_computer_stops_without_login_and_a_held_key_asks_once(server):
    with server.open() as page:
        numbers = [page.send("safe_stop") for _ in range(60)]
        order = server.next_order()
        assert "this computer" in order.who
        page.ask("login", token="wrong", name="x")  # it has read all sixty
        server.answer(order)
        answers = [page.until("answer") for _ in numbers]
        assert [(answer["id"], answer["outcome"]) for answer in answers] == [
            (number, "done") for number in numbers
        ]
        assert server.orders.empty()
        page.send("safe_stop")
        assert server.next_order() is not order


def test_large_frame_closes_the_page(server):
    with server.open() as page, pytest.raises(ConnectionClosed) as closed:
        page.socket.send("x" * 4097)
        page.until("never")
    assert closed.value.rcvd.code == 1009


def test_page_that_sends_nonsense_is_shut_out(server):
    with server.open() as page, pytest.raises(ConnectionClosed) as closed:
        for _ in range(30):
            page.socket.send(b"\x00\xff")
        page.until("never")
    assert closed.value.rcvd.code == 1008


def test_slow_page_loses_ticks_but_no_answer_and_no_other_page_notices(server):
    with server.open(max_queue=2) as slow, server.open() as other:
        slow.command(TOKEN)
        long = '{"t":"tick","row":["' + "x" * 2000 + '",%d]}'
        for number in range(2000):  # far more than the kernel keeps for a client
            server.call(server.page.tick, "[0]", long % number, time.monotonic())
        request = slow.send("safe_stop")
        server.answer([server.next_order() for _ in range(2)][1])
        rows = []
        assert other.until("tick", lambda frame: frame["row"][1] == 1999)
        while slow.frames["answer"]["id"] != request or not rows or rows[-1] < 1999:
            frame = slow.receive()
            if frame["t"] == "tick":
                rows.append(frame["row"][1])
        assert rows == sorted(rows)
        assert len(rows) < 1500


def test_page_that_takes_nothing_is_given_up(make_server):
    server = make_server(patience_s=0.5)
    with socket.create_connection(("127.0.0.1", server.port)) as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        raw.sendall(
            f"GET /ws?build={server.files.build} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
            f"Origin: http://127.0.0.1:{server.port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        end_s = time.monotonic() + 240.0
        number = 0
        while not number or server.page._pages:
            assert time.monotonic() < end_s
            number += 1
            server.call(
                server.page.tick,
                "[0]",
                '{"t":"tick","row":["' + "x" * MANY + '"]}',
                time.monotonic(),
            )
        raw.settimeout(240.0)
        with pytest.raises(ConnectionError):  # what is left, and then the kernel drops it
            wait_until(
                lambda: raw.send(b"\x89\x80\x00\x00\x00\x00") == 0, "the end of the connection"
            )


junk = st.binary(max_size=300) | st.tuples(
    st.sampled_from([b"GET ", b"POST ", b"GET /ws", b"\x81\xff", b"", b"PRI * HTTP/2.0\r\n\r\n"]),
    st.binary(max_size=200),
).map(b"".join)


@settings(
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(junk)
def test_junk_instead_of_http_does_no_harm(server, content):
    with socket.create_connection(("127.0.0.1", server.port)) as raw:
        raw.sendall(content + b"\r\n\r\n")
        raw.shutdown(socket.SHUT_WR)
    assert get(server, "/")[0].status == 200
    assert server.orders.empty()


@settings(
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.lists(st.binary(max_size=200), min_size=1, max_size=5))
def test_junk_instead_of_frames_does_no_harm(server, pieces):
    page = server.open()
    try:
        for piece in pieces:
            page.socket.socket.sendall(piece)
    except OSError:
        pass  # shut out already
    page.socket.close_socket()
    with server.open() as other:
        assert other.receive()["t"] == "hello"
    assert server.orders.empty()


def test_address_that_is_taken_is_told_in_a_line(server):
    with pytest.raises(
        ValueError, match=f"port {server.port}: Address already in use; .* a free port"
    ):
        listen("127.0.0.1", server.port)
    with pytest.raises(ValueError, match="cannot listen on"):
        listen("no.such.host.invalid", 0)


def test_frames_of_the_graph_replace_each_other(server):
    with server.open() as page:
        page.until("hello")
        server.call(partial(server.page.show, "state", json.dumps({"t": "state", "known": False})))
        assert page.until("state")["known"] is False


@pytest.mark.requirement("S18")
@pytest.mark.parametrize("noticed", [True, False], ids=["noticed", "unnoticed"])
def test_page_that_is_cut_off_resumes_where_it_was(server, noticed):
    page = server.open()
    page.command(TOKEN)
    assert server.next_order().asked == "take control"
    number = page.send("mode", mode="auto")
    order = server.next_order()
    hello = page.frames["hello"]
    if noticed:
        page.socket.close(4002)
        wait_until(lambda: server.room.holder.lost_s is not None, "the loss of the connection")
        server.answer(order)  # while no page is there
    with server.open(resume=hello["resume"]) as again:
        assert again.seen("hello")["session"] == hello["session"]
        assert again.seen("control")["you"]
        server.answer(order)  # to a request of the connection that was cut
        again.seen("answer", lambda frame: (frame["id"], frame["outcome"]) == (number, "done"))
        again.send("mode", mode="hold")
        assert server.next_order().holder == f"anna ({hello['session']})"
    wait_until(lambda: server.room.holder is None, "the end of control")  # a page that is closed
