"""Runs the launch tests under plain pytest.

The same test classes, with processes started by a helper of ours.

Classes of tests after shutdown come last in their module; the first of them ends the processes.
"""

from __future__ import annotations

import inspect
import sys
from functools import partial
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))


def pytest_configure(config):
    config.addinivalue_line("markers", "launch_test: entry point of launch_testing")


@pytest.fixture(scope="module")
def weld(request, tmp_path_factory):
    """The running weld that the module asks for: arguments of its tests, and how to end it."""
    with request.module.WELD.plain_processes(tmp_path_factory.mktemp("weld")) as running:
        yield running


@pytest.fixture(autouse=True)
def _weld_arguments(request):
    """Give a test method the arguments that it names, as launch_testing does."""
    if not hasattr(request.module, "WELD"):  # of a package that runs these tests with its own
        return
    arguments, stop = request.getfixturevalue("weld")
    if _is_after_shutdown(request.node):
        stop()
    method = request.node.obj
    request.node.obj = partial(
        method, **{name: arguments[name] for name in inspect.signature(method).parameters}
    )


def _is_after_shutdown(item):
    return getattr(getattr(item, "cls", None), "__post_shutdown_test__", False)
