"""Draws block diagrams (``graph LR`` of mermaid) as SVG, for pages without mermaid's script.

Blocks stand in columns by their distance from the inputs; an arrow that closes a loop runs above.
"""

from __future__ import annotations

import re

_BLOCK = r'(\w+)(?:\["(.*?)"\])?'
_ARROW = re.compile(rf'\s*{_BLOCK} (?:-- "?(.*?)"? )?--> {_BLOCK}\s*')
#: sizes [px]: a letter, a line, margin inside a block, gaps between columns and rows
_LETTER, _LINE, _MARGIN, _GAP, _ROW = 7.0, 17, 10, 46, 22
_TOP = 26
_LOOK = 'fill="none" stroke="#333" stroke-width="1.4"'


def parse(graph: str) -> tuple[dict[str, list[str]], list[tuple[str, str, str]]]:
    """Lines of text of each block, and begin, end and label of each arrow."""
    words: dict[str, list[str]] = {}
    arrows = []
    for line in graph.strip().splitlines()[1:]:
        match = _ARROW.fullmatch(line)
        if match is None:
            raise ValueError(f"a line of a block diagram is no arrow: {line}")
        begin, begin_text, label, end, end_text = match.groups()
        for name, text in ((begin, begin_text), (end, end_text)):
            if text or name not in words:
                words[name] = (text or name).split("<br/>")
        arrows.append((begin, end, label or ""))
    return words, arrows


def columns(
    words: dict[str, list[str]], arrows: list[tuple[str, str, str]]
) -> tuple[list[list[str]], set[tuple[str, str]]]:
    """Blocks by column, and the arrows that close loops."""
    after: dict[str, list[str]] = {name: [] for name in words}
    loops: set[tuple[str, str]] = set()

    def reaches(name: str, other: str) -> bool:
        return name == other or any(reaches(block, other) for block in after[name])

    for begin, end, _ in arrows:
        if reaches(end, begin):
            loops.add((begin, end))
        else:
            after[begin].append(end)
    before = {name: [block for block in words if name in after[block]] for name in words}

    def rank(name: str) -> int:
        return max((rank(block) + 1 for block in before[name]), default=0)

    ranks = {name: rank(name) for name in words}
    for name in words:  # an input stands beside what it leads to
        if not before[name]:
            ranks[name] = min((ranks[block] for block in after[name]), default=1) - 1
    in_loops = {name for loop in loops for name in loop}
    ordered = sorted(words, key=lambda name: name not in in_loops)
    return [
        [block for block in ordered if ranks[block] == i] for i in range(max(ranks.values()) + 1)
    ], loops


def svg(graph: str, title: str) -> str:
    """The drawing, on one line."""
    words, arrows = parse(graph)
    stacks, loops = columns(words, arrows)
    height = {name: _LINE * len(text) + 2 * _MARGIN for name, text in words.items()}
    tall = [sum(height[block] + _ROW for block in stack) - _ROW for stack in stacks]
    top = _TOP if loops else 4
    boxes: dict[str, tuple[float, float, float]] = {}  # left, middle, width
    left = 4.0
    for stack, own in zip(stacks, tall, strict=True):
        width = max(len(line) for block in stack for line in words[block]) * _LETTER + 2 * _MARGIN
        y = top + 0.5 * (max(tall) - own)
        for block in stack:
            boxes[block] = (left, y + 0.5 * height[block], width)
            y += height[block] + _ROW
        labels = [
            len(label)
            for begin, end, label in arrows
            if begin in stack and (begin, end) not in loops
        ]
        left += width + max([_GAP, *(_LETTER * length + 24 for length in labels)])
    right = max(x + width for x, _, width in boxes.values())
    parts = [
        f'<svg viewBox="0 0 {right + 4:g} {top + max(tall) + 6:g}" width="{right + 4:g}" '
        f'font-family="sans-serif" font-size="13" role="img"><title>{title}</title>'
    ]
    for begin, end, label in arrows:
        (x0, y0, width0), (x1, y1, width1) = boxes[begin], boxes[end]
        if (begin, end) in loops:
            x0, x1 = x0 + 0.5 * width0, x1 + 0.5 * width1
            y0, y1 = y0 - 0.5 * height[begin], y1 - 0.5 * height[end]
            path, head, at = (
                f"M{x0:g} {y0:g}V12H{x1:g}V{y1:g}",
                f"M{x1:g} {y1:g}l-5 -9h10z",
                (x0 + x1, 58.0),
            )
        else:
            x0 += width0
            bend = f"C{x0 + 22:g} {y0:g} {x1 - 30:g} {y1:g} {x1 - 8:g} {y1:g}"
            path, head, at = (
                f"M{x0:g} {y0:g}{bend}",
                f"M{x1:g} {y1:g}l-9 -5v10z",
                (x0 + x1, y0 + y1),
            )
        parts.append(f'<path d="{path}" {_LOOK}/><path d="{head}" fill="#333"/>')
        parts.append(
            f'<text x="{0.5 * at[0]:g}" y="{0.5 * at[1] - 5:g}" text-anchor="middle" '
            'font-size="12" fill="#1f4e79" stroke="#fff" stroke-width="4" '
            f'paint-order="stroke">{label}</text>'
        )
    for name, (x, y, width) in boxes.items():
        parts.append(
            f'<rect x="{x:g}" y="{y - 0.5 * height[name]:g}" width="{width:g}" '
            f'height="{height[name]}" rx="4" fill="#dce9f7" stroke="#333"/>'
        )
        for i, line in enumerate(words[name]):
            at_y = y + _LINE * (i - 0.5 * len(words[name])) + 13
            parts.append(
                f'<text x="{x + 0.5 * width:g}" y="{at_y:g}" text-anchor="middle">{line}</text>'
            )
    return "".join([*parts, "</svg>"])
