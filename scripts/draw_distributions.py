#!/usr/bin/env python3
"""Draws the three distributions and their packages: docs/figures/distributions.svg."""

import sys
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]
FIGURE = WORKSPACE / "docs" / "figures" / "distributions.svg"
#: folder: title, left and upper edge, width, columns of packages
BOXES = {
    "quality": ("quality: what judges afterwards", 10, 10, 340, 2),
    "lab": ("lab: what prepares and researches", 370, 10, 340, 2),
    "src": ("core: what welds", 10, 190, 700, 4),
}
_ROW, _HEAD = 22, 44


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}"{style}>{text}</text>'


def _box(folder: str) -> tuple[list[str], float]:
    """Parts of a box and its lower edge."""
    title, x, y, width, columns = BOXES[folder]
    names = sorted(path.parent.name for path in (WORKSPACE / folder).glob("*/package.xml"))
    names += ["studies"] * (WORKSPACE / folder / "studies").is_dir()
    height = _HEAD + _ROW * -(-len(names) // columns)
    parts = [f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6"/>']
    parts.append(_text(x + 12, y + 24, title, ' font-weight="bold"'))
    for i, name in enumerate(names):
        column, row = i % columns, i // columns
        parts.append(
            _text(x + 12 + column * (width - 12) / columns, y + _HEAD + 6 + row * _ROW, name)
        )
    return parts, y + height


def drawing() -> str:
    """The figure."""
    made = {folder: _box(folder) for folder in BOXES}
    parts = [part for box, _ in made.values() for part in box]
    top = BOXES["src"][2]
    for folder in ("quality", "lab"):
        _, x, _, width, _ = BOXES[folder]
        below, middle = made[folder][1], x + width / 2
        parts.append(f'<path d="M{middle - 50:g} {below:g}V{top - 3:g}" marker-end="url(#tip)"/>')
        parts.append(
            f'<path d="M{middle + 50:g} {top:g}V{below + 3:g}" stroke-dasharray="5 4" marker-end="url(#tip)"/>'
        )
        parts.append(_text(middle - 44, (below + top) / 2 + 4, "imports"))
        parts.append(_text(middle + 56, (below + top) / 2 + 4, "entry points"))
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 {made["src"][1] + 10:g}" font-family="sans-serif" '
        'font-size="14">',
        "<title>Quality and lab import the core; the core finds them by entry points</title>",
        "<style>rect{fill:#f4f6f8;stroke:#456}path{fill:none;stroke:#456}</style>",
        '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0L8 4L0 8"/></marker>',
    )
    return "\n".join([*head, *parts, "</svg>\n"])


if __name__ == "__main__":
    if sys.argv[1:]:
        sys.exit(__doc__)
    FIGURE.write_text(drawing(), encoding="utf-8")
