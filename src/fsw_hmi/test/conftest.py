"""What the tests of the web server share: a server without a graph."""

from __future__ import annotations

import queue
import threading
from functools import partial

import pytest
from argon2 import PasswordHasher

from fsw_hmi.answers import Answer
from fsw_hmi.control_room import ControlRoom
from fsw_hmi.gate import Gate
from fsw_hmi.users import Users
from fsw_hmi.web import LivePage, PageFiles
from fsw_hmi.web_server import WebThread, address, application, listen
from fsw_test_support.page_client import Page
from fsw_test_support.ros_graph import domain_id
from fsw_test_support.trends_library import uplot
from fsw_test_support.waiting import PATIENCE_S, wait_until

__all__ = ["domain_id", "uplot"]
TOKEN = "a token of some length"


@pytest.fixture(autouse=True, scope="session")
def cheap_hashes():
    """What a hash of a password costs is the library's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fsw_hmi.users.HASHER", PasswordHasher(1, 8, 1))
        yield


class Server:
    """A server whose orders are kept in a queue.

    Patient unless a test says otherwise: a machine may stand still.
    """

    def __init__(self, folder, **options):
        self.files = PageFiles("live", folder)
        self.orders, self.logins = queue.Queue(), queue.Queue()
        settings = dict(options)
        known = settings.pop("users", None) or Users(token=TOKEN)
        self.room = room = ControlRoom(known, **settings.pop("rules", {}))
        encrypted = settings.pop("encrypted", None)
        listening = listen("127.0.0.1", 0, settings.pop("patience_s", PATIENCE_S))
        self.gate = listening.gate = Gate(request_s=PATIENCE_S, **settings.pop("limits", {}))
        self.page = LivePage(self.files, room, self._take, touch=self.gate.touch, **settings)
        self.url = address(listening, encrypted is not None)
        self.port = listening.getsockname()[1]
        app = application(self.page.routes(), ["weld.example"], self.gate)
        self.thread = WebThread(self.page, app, listening, encrypted)
        self.thread.start()
        self.call(self.page.set_hello, {"limits": {}})

    def open(self, build=None, **options):
        """Open a page."""
        return Page(self.url, build or self.files.build, **options)

    def call(self, function, *arguments):
        """Run a function in the server's loop and wait until it has run."""
        done = threading.Event()
        self.thread.call(lambda: (function(*arguments), done.set()))
        assert done.wait(PATIENCE_S)

    def _take(self, order):
        (self.logins if order.asked == "log in" else self.orders).put(order)

    def next_order(self):
        return self.orders.get(timeout=PATIENCE_S)

    def answer(self, order, outcome="done", message="well"):
        self.thread.call(partial(order.reply, Answer(outcome, "", message)))


@pytest.fixture
def folder(tmp_path):
    """The files of a small page."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "index.html").write_text(
        '<meta name="build" content="{{build}}"><p>{{source}}</p>'
    )
    (tmp_path / "main.js").write_text("export {};")
    (tmp_path / "sub" / "LICENSE").write_text("MIT")
    return tmp_path


@pytest.fixture
def make_server(folder):
    servers = []

    def make(**options):
        servers.append(Server(folder, **options))
        return servers[-1]

    yield make
    for server in servers:
        server.thread.stop()
        wait_until(lambda stopped=server: not stopped.thread.alive, "the server's end")


@pytest.fixture
def server(make_server):
    return make_server()
