"""The page over bags as a web application, and its command line."""

from __future__ import annotations

import asyncio
import gzip
import json
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip(
    "starlette", reason="starlette is not installed: pip install -r requirements/hmi.lock"
)

from fsw_hmi import bag_view
from fsw_hmi.bag_view import load, routes
from fsw_hmi.gate import Gate
from fsw_hmi.main import main
from fsw_hmi.web import PageFiles
from fsw_hmi.web_server import application
from fsw_test_support.sample_weld import write_sample_weld

Get = Callable[..., tuple[int, dict[str, str], bytes]]


@pytest.fixture
def page(tmp_path: Path) -> PageFiles:
    """The files of a page that is as small as can be."""
    (tmp_path / "page").mkdir()
    (tmp_path / "page" / "index.html").write_text('<meta name="source" content="{{source}}">')
    return PageFiles("bag", tmp_path / "page")


@pytest.fixture
def get(tmp_path: Path, page: PageFiles) -> Get:
    """Asks the application for a path; returns status, headers and body."""
    write_sample_weld(tmp_path / "weld", 50)
    app = application(routes(page, load([tmp_path / "weld"])), [], Gate())

    def get(
        path: str, encoding: str = "gzip, br", host: str = "localhost:8080"
    ) -> tuple[int, dict[str, str], bytes]:
        sent: list[Any] = []

        async def receive() -> Any:
            return {"type": "http.request", "body": b""}

        async def send(message: Any) -> None:
            sent.append(message)

        headers = [(b"host", host.encode()), (b"accept-encoding", encoding.encode())]
        scope = {
            "type": "http",
            "method": "GET",
            "path": path,
            "query_string": b"",
            "headers": headers,
        }
        with ThreadPoolExecutor(
            1
        ) as own_thread:  # in this one a loop of the browser's tests may be running
            own_thread.submit(asyncio.run, app(scope, receive, send)).result()
        names = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
        return sent[0]["status"], names, b"".join(message.get("body", b"") for message in sent[1:])

    return get


def test_bags_and_rows_are_packed_for_those_who_can_unpack_them(get: Get) -> None:
    for path in ("/bags", "/bags/0"):
        status, headers, body = get(path)
        assert (status, headers["content-encoding"], headers["vary"]) == (
            200,
            "gzip",
            "Accept-Encoding",
        )
        assert "default-src 'self'" in headers["content-security-policy"]
        plain = get(path, encoding="")
        assert "content-encoding" not in plain[1]
        assert plain[2] == gzip.decompress(body)
    listed = json.loads(get("/bags", encoding="")[2])
    assert set(listed) == {"build", "bags", "limits"}
    assert [bag["n"] for bag in listed["bags"]] == [0]
    shown = json.loads(get("/bags/0", encoding="")[2])
    assert len(shown["rows"]) == 50
    assert len(shown["rows"][0]) == len(shown["columns"])


def test_the_page_learns_what_it_shows(get: Get) -> None:
    assert b'content="bag"' in get("/", encoding="")[2]


@pytest.mark.parametrize("path", ["/bags/1", "/bags/-1", "/bags/x", "/bags/0/1", "/ws"])
def test_what_is_not_there_is_not_found(get: Get, path: str) -> None:
    assert get(path)[0] == 404


def test_other_hosts_are_refused(get: Get) -> None:
    assert get("/bags", host="evil.example")[0] == 400


def test_bad_arguments_are_one_line(
    tmp_path: Path,
    page: PageFiles,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bag_view, "PageFiles", lambda _: page)
    write_sample_weld(tmp_path / "weld", 20)
    weld = ["--bag", str(tmp_path / "weld")]
    for arguments, complaint in (
        (["--bag", str(tmp_path / "none")], "there is no such bag"),
        (weld * 3, "3 bags: the page shows one, or compares 2"),
        ([*weld, "--host", "no such host"], "cannot listen on"),
    ):
        assert main(["hmi", *arguments]) == 2
        complained = capsys.readouterr().err
        assert complaint in complained and complained.count("\n") == 1


@pytest.fixture
def served(tmp_path: Path, page: PageFiles) -> Iterator[subprocess.Popen[str]]:
    """The command as a process, on any free port, with a small page."""
    write_sample_weld(tmp_path / "weld", 20)
    source = f"""
import functools, pathlib, sys
from fsw_hmi import bag_view, main
bag_view.PageFiles = functools.partial(bag_view.PageFiles, folder=pathlib.Path({str(tmp_path / "page")!r}))
sys.exit(main.main())
"""
    command = [sys.executable, "-u", "-c", source, "--bag", str(tmp_path / "weld"), "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_command_serves_until_it_is_interrupted(
    served: subprocess.Popen[str], sign: signal.Signals
) -> None:
    assert served.stdout is not None
    address = next(line for line in served.stdout if "http://" in line).split()[-1]
    with urllib.request.urlopen(f"{address}bags", timeout=240) as answer:
        assert json.load(answer)["bags"][0]["name"] == "weld"
    served.send_signal(sign)
    assert served.wait(timeout=240) == 0
