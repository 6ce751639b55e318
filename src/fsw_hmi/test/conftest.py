"""What the tests of the web server share: a server without a graph, and pages that are no browser."""

from __future__ import annotations

import json
import queue
import threading
from functools import partial

import pytest
from websockets.sync.client import connect

from fsw_hmi.control_room import ControlRoom
from fsw_hmi.page_files import PageFiles
from fsw_hmi.web import LivePage
from fsw_hmi.web_server import address, application, listen
from fsw_hmi.web_thread import WebThread

TOKEN = "a token of some length"
PATIENCE_S = 30.0


class Page:
    """An open page: keeps the newest frame of each kind."""

    def __init__(self, url, build, **options):
        given = {"origin": url.rstrip("/"), "max_size": None, "compression": None} | options
        self._connection = connect(f"{url.replace('http', 'ws')}ws?build={build}", **given)
        self.socket = self._connection.__enter__()
        self.frames = {}
        self.count = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._connection.__exit__(None, None, None)

    def receive(self):
        """The next frame."""
        frame = json.loads(self.socket.recv(PATIENCE_S))
        self.frames[frame["t"]] = frame
        return frame

    def until(self, kind, condition=lambda frame: True):
        """The next frame of a kind for which a condition holds."""
        while True:
            frame = self.receive()
            if frame["t"] == kind and condition(frame):
                return frame

    def send(self, do, **content):
        """Send a request; returns its number."""
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "do": do, **content}))
        return self.count

    def ask(self, do, **content):
        """Send a request and wait for its answer."""
        number = self.send(do, **content)
        return self.until("answer", lambda frame: frame["id"] == number)

    def command(self, name="anna"):
        """Log in and take control, whoever has it."""
        assert self.ask("login", token=TOKEN, name=name)["outcome"] == "done"
        holder = self.frames["control"]["holder"]
        assert self.ask("take_control", **{"from": holder and holder["session"]})["outcome"] == "done"
        return self


class Server:
    """A server whose orders are kept in a queue."""

    def __init__(self, folder, **options):
        self.files = PageFiles("live", folder)
        self.orders = queue.Queue()
        settings = {"request_timeout_s": 30.0, "patience_s": 30.0, "max_pages": 100} | options
        self.page = LivePage(self.files, ControlRoom(TOKEN), self.orders.put, **settings)
        listening = listen("127.0.0.1", 0, settings["patience_s"])
        self.url = address(listening)
        self.port = listening.getsockname()[1]
        self.thread = WebThread(self.page, application(self.page.routes(), ["weld.example"]), listening)
        self.thread.start()
        self.call(self.page.set_hello, {"commands": True})

    def open(self, build=None, **options):
        """Open a page."""
        return Page(self.url, build or self.files.build, **options)

    def call(self, function, *arguments):
        """Run a function in the server's loop and wait until it has run."""
        done = threading.Event()
        self.thread.call(lambda: (function(*arguments), done.set()))
        assert done.wait(PATIENCE_S)

    def next_order(self):
        return self.orders.get(timeout=PATIENCE_S)

    def answer(self, order, outcome="done", message="well"):
        self.thread.call(partial(self.page.on_outcome, order.number, outcome, message))


@pytest.fixture
def folder(tmp_path):
    """The files of a small page."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "index.html").write_text('<meta name="build" content="{{build}}"><p>{{source}}</p>')
    (tmp_path / "main.js").write_text("export {};")
    (tmp_path / "sub" / "LICENSE").write_text("MIT")
    (tmp_path / "notes.txt~").write_text("not to be served")
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
        assert not server.thread._thread.is_alive()


@pytest.fixture
def server(make_server):
    return make_server()
