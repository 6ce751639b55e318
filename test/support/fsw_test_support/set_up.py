"""What a package's ``setup.py`` sets up."""

import runpy
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import setuptools  # type: ignore[import-untyped]


@cache
def arguments(package: Path) -> dict[str, Any]:
    """Arguments with which a package calls ``setuptools.setup``."""
    passed: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setuptools, "setup", passed.update)
        patch.chdir(package)
        patch.syspath_prepend(str(package))
        runpy.run_path(str(package / "setup.py"))
    return passed


def entry_points(package: Path, group: str) -> dict[str, str]:
    """Entry points of a package in a group, by name."""
    points = (point.split(" = ") for point in arguments(package)["entry_points"].get(group, ()))
    return {name: value for name, value in points}
