"""Command line, table and JSON file that all benchmarks have."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Figures = dict[str, Any]


def parser(description: str | None, quick: str) -> argparse.ArgumentParser:
    """Parser with ``--quick``, which means what ``quick`` says, and ``--json``."""
    made = argparse.ArgumentParser(description=(description or "").partition("\n")[0])
    made.add_argument("--quick", action="store_true", help=quick)
    made.add_argument("--json", type=Path, metavar="FILE", help="write the figures as flat JSON")
    return made


def show(figures: Mapping[str, Any], aims: Mapping[str, float] | None = None) -> None:
    """Print a row per figure, with its aim where it has one."""
    width = max(map(len, figures))
    for name, value in figures.items():
        text = f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)
        aim = f"  aim: >= {aims[name]:g}" if aims and name in aims else ""
        print(f"{name:<{width}}{text:>20}{aim}")


def save(figures: Mapping[str, Any], path: Path | None) -> None:
    """Write the figures, if a file was asked for."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
