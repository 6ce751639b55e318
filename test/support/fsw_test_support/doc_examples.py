"""The examples in docstrings."""

from __future__ import annotations

import doctest
from collections.abc import Iterable
from importlib import import_module


def examples(modules: Iterable[str]) -> list[doctest.DocTest]:
    """Those of modules, sorted."""
    tests = (
        test
        for name in sorted(set(modules))
        for test in doctest.DocTestFinder().find(import_module(name))
    )
    return [test for test in tests if test.examples]


def check(example: doctest.DocTest) -> None:
    """Run one; AssertionError with what it printed when that is not what stands there."""
    runner = doctest.DocTestRunner(optionflags=doctest.IGNORE_EXCEPTION_DETAIL)
    said: list[str] = []
    runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)
