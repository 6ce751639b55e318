"""FMUs in tests: FMPy, without which they are skipped, the example ``fmu_loop``, and instances that are ended."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

fmpy: Any = pytest.importorskip("fmpy", reason="FMPy is not installed, see requirements/fmu.lock")
for _name in ("fmi2", "simulation", "util", "validation"):
    importlib.import_module(f"fmpy.{_name}")
_PATH = Path(__file__).resolve().parents[3] / "examples" / "fmu_loop.py"
_SPEC = importlib.util.spec_from_file_location("fmu_loop", _PATH)
assert _SPEC is not None and _SPEC.loader is not None
fmu_loop = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(fmu_loop)


class Units:
    """Instances of FMUs, each with a binary of its own, unpacked below a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._started: list[Any] = []

    def start(self, path: Path, **parameters: Any) -> Any:
        """A ``fmu_loop.Unit`` of an FMU, initialised with these parameters."""
        unit = fmu_loop.Unit(str(path), self._folder / f"unit_{len(self._started)}", **parameters)
        self._started.append(unit)
        return unit

    def end(self, unit: Any) -> None:
        """Free an instance and unload its binary."""
        self._started[self._started.index(unit)] = None
        unit.fmu.freeInstance()

    def end_all(self) -> None:
        """Free what is left."""
        for unit in filter(None, self._started):
            unit.fmu.freeInstance()
