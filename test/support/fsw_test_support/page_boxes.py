"""What is wrong with the layout of an open page, by measured boxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_MEASURE = Path(__file__).with_suffix(".js").read_text(encoding="utf-8")


def faults(page: Any, may_scroll: bool = False) -> dict[str, list[str]]:
    """Faults of the layout by kind; empty where all is well.

    ``may_scroll``: the page may be higher than the screen.
    """
    script = f"layoutFaults({str(may_scroll).lower()})"
    return dict(page.evaluate(f"(() => {{ {_MEASURE}\nreturn {script}; }})()"))


def places(page: Any) -> dict[str, list[int]]:
    """Where everything is that must not move when a state changes."""
    return dict(page.evaluate(f"(() => {{ {_MEASURE}\nreturn places(); }})()"))
