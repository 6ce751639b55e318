"""Exports and programs that many tests look at.

Made once in a session, by whichever of its processes asks first.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from fsw_export import fmu
from fsw_export.c_folder import write_folder
from fsw_export.choice import Choice
from fsw_test_support.c_code import compile_c


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A file or folder that is the session's.

    ``make`` is given its place if it is not there yet.
    """
    root = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    place = root / "made_once" / name
    place.parent.mkdir(exist_ok=True)
    with open(place.with_name(f"{name}.lock"), "w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        if not place.exists():
            part = place.with_name(f"part_{name}")
            make(part)
            part.rename(place)
    return place


def c_folder(factory: pytest.TempPathFactory, controller: str) -> Path:
    """The exported folder of a controller."""
    return made_once(factory, controller, lambda out: write_folder(Choice(controller), out))


def c_objects(factory: pytest.TempPathFactory, controller: str, *flags: str) -> list[str]:
    """Object files of an exported folder's sources, main.c apart, compiled with these flags."""
    sources = c_folder(factory, controller) / "src"

    def compile_all(out: Path) -> None:
        out.mkdir()
        for source in sources.glob("*.c"):
            options = ["-std=c99", "-O2", *flags, "-I", str(sources), "-c", str(source)]
            built = compile_c([*options, "-o", str(out / f"{source.stem}.o")])
            assert built.returncode == 0, built.stderr

    folder = made_once(
        factory, "_".join([controller, "objects", *flags]).replace("/", "_"), compile_all
    )
    return [str(path) for path in sorted(folder.glob("*.o"))]


def fmu_file(factory: pytest.TempPathFactory, unit: str) -> Path:
    """The FMU of a unit with nothing changed."""
    return made_once(factory, f"{unit}.fmu", lambda out: fmu.write(fmu.make(Choice(unit)), out))
