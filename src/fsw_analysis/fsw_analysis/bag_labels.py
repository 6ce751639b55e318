"""Names of bags, for tables and charts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def labels(bags: Sequence[Path]) -> list[str]:
    """Shortest path ends that distinguish the bags; a folder ``bag`` gets the name of its parent folder."""
    named = [
        path.resolve().parent if path.resolve().name == "bag" else path.resolve() for path in bags
    ]
    parts = [path.parts for path in named]
    for length in range(1, max(map(len, parts)) + 1):
        shortened = ["/".join(part[-length:]) for part in parts]
        if len(set(shortened)) == len(shortened):
            return shortened
    return [f"{path} ({i + 1})" for i, path in enumerate(bags)]
