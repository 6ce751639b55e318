"""What the ``setup.py`` of all packages does; colcon runs them, pip does not.

The version stands in ``package.xml``, entry points in ``pyproject.toml`` of the distribution, and
nodes are programs of their package, too.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Sequence
from glob import glob
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import setuptools

_NODE_PROGRAM = "fsw_control.schema.entry:"


def entry_points(folder: Path) -> dict[str, list[str]]:
    """Entry points of the package in ``folder``, by group."""
    above = (parent / "pyproject.toml" for parent in folder.parents)
    text = next(path for path in above if path.is_file()).read_text("utf-8")
    project = tomllib.loads(text)["project"]
    named = {**project["entry-points"], "console_scripts": project.get("scripts", {})}
    points = {
        group: [
            f"{name} = {value}"
            for name, value in entries.items()
            if re.split("[.:]", value)[0] == folder.name
        ]
        for group, entries in named.items()
    }
    programs = [
        f"{name.strip()} = {_NODE_PROGRAM}{value.strip().replace(':', '.')}"
        for name, value in (point.split("=") for point in points.get("fsw.nodes", ()))
    ]
    points["console_scripts"] += programs
    return {group: entries for group, entries in points.items() if entries}


def set_up(
    file: str,
    data: Sequence[str] = (),
    shared: Sequence[str] = (),
    kernel: bool = False,
    **options: Any,
) -> None:
    """Set a package up.

    Parameters
    ----------
    file : str
        Its ``setup.py``.
    data, shared : sequence of str
        Patterns of the files beside its modules, and of those for its share, in folders of it.
    kernel : bool
        Whether it has a C library.
    **options
        Further arguments of ``setuptools.setup``.
    """
    folder = Path(file).resolve().parent
    name = folder.name
    if kernel:
        sys.path.append(str(folder.parent / "fsw_control"))
        from fsw_control.c_library import CLibrary

        library = CLibrary(name, Path(name, "kernel"))
        options["ext_modules"] = [setuptools.Extension(**library.extension())]
        data = (*data, "kernel/*.c", "kernel/*.h")
    setuptools.setup(
        name=name,
        version=ElementTree.parse(folder / "package.xml").findtext("version"),
        packages=setuptools.find_packages(exclude=["test"]),
        package_data={name: [*data, "py.typed"]},
        data_files=[
            ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
            (f"share/{name}", ["package.xml"]),
            *((f"share/{name}/{Path(files).parent}", sorted(glob(files))) for files in shared),
        ],
        extras_require={"test": ["pytest"]},
        entry_points=entry_points(folder),
        **options,
    )
