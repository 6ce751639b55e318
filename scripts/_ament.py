"""Setup of an ament package of the workspace: its part of its distribution's pyproject.toml."""

import os
import re
import tomllib
from glob import glob
from pathlib import Path
from typing import Any

WORKSPACE = Path(__file__).resolve().parents[1]


def entry_points(package: Path) -> dict[str, list[str]]:
    """Entry points by group whose modules are the package's; each node is a program, too."""
    folder = package.parent
    files = (folder / "pyproject.toml", WORKSPACE / "pyproject.toml")
    file = next(filter(Path.is_file, files))
    project = tomllib.loads(file.read_text("utf-8"))["project"]
    groups = {"console_scripts": project.get("scripts", {}), **project.get("entry-points", {})}
    points = {
        group: {
            name: place
            for name, place in places.items()
            if place.partition(":")[0].partition(".")[0] == package.name
        }
        for group, places in groups.items()
    }
    # a node's program imports nothing before a Ctrl-C is taken care of
    points["console_scripts"] |= {
        name: f"fsw_control.schema.entry:{place.replace(':', '.')}"
        for name, place in points.get("fsw.nodes", {}).items()
    }
    return {
        group: [f"{name} = {place}" for name, place in places.items()]
        for group, places in points.items()
        if places
    }


def version() -> str:
    """Version of all packages."""
    text = (WORKSPACE / "src/fsw/fsw/__init__.py").read_text("utf-8")
    return re.findall(r'^__version__ = "(.+)"', text, re.MULTILINE)[0]


def setup_package(script: str, *data: str, shared: tuple[str, ...] = (), **more: Any) -> None:
    """Set up the package of a setup.py.

    Parameters
    ----------
    script : str
        Path of the setup.py.
    data : str
        Patterns of files beside the package's modules.
    shared : tuple of str
        Folders to install into the package's share.
    more : Any
        Further arguments of ``setuptools.setup``.
    """
    from setuptools import find_packages, setup

    package = Path(script).resolve().parent
    share = f"share/{package.name}"
    files = {share: ["package.xml"]} | {
        f"{share}/{folder}": sorted(filter(os.path.isfile, glob(f"{folder}/*")))
        for folder in shared
    }
    setup(
        name=package.name,
        version=version(),
        packages=find_packages(exclude=["test"]),
        package_data={package.name: ["py.typed", *data]},
        data_files=[
            ("share/ament_index/resource_index/packages", [f"resource/{package.name}"]),
            *files.items(),
        ],
        extras_require={"test": ["pytest"]},
        entry_points=entry_points(package),
        **more,
    )
