"""Shared parts of the reports: tables, templates, pages, figures in pages."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment


def table(rows: Sequence[Sequence[object]], words: int | None = 1, padded: bool = False) -> str:
    """A table, without a line break at its end.

    Parameters
    ----------
    rows : Sequence[Sequence[object]]
        Cells of the header, then those of the rows.
    words : int, optional
        Number of columns, from the left, that hold text; the others hold numbers, flush right.
        None: all hold text.
    padded : bool
        Fill the cells with spaces, so that the columns line up on a terminal.
    """
    cells = [[str(cell).replace("|", "\\|") for cell in row] for row in rows]
    numeric = [words is not None and column >= words for column in range(len(cells[0]))]
    widths = [3 + number for number in numeric]
    if padded:
        widths = [
            max(width, *map(len, column))
            for width, column in zip(widths, zip(*cells, strict=True), strict=True)
        ]
        cells = [
            [
                cell.rjust(width) if number else cell.ljust(width)
                for cell, width, number in zip(row, widths, numeric, strict=True)
            ]
            for row in cells
        ]
    rule = [
        "-" * (width - number) + ":" * number
        for width, number in zip(widths, numeric, strict=True)
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in (cells[0], rule, *cells[1:]))


@cache
def templates(place: str | Path) -> Environment:
    """Templates of a package's folder ``templates``, or of a folder.

    A missing value is an error, values in HTML and XML are escaped, ``table`` makes a table in
    Markdown, and ``do`` extends its rows.
    """
    import jinja2  # heavy to import, and a weld's table needs no template

    environment = jinja2.Environment(
        loader=(
            jinja2.FileSystemLoader(place)
            if isinstance(place, Path)
            else jinja2.PackageLoader(place)
        ),
        autoescape=jinja2.select_autoescape(("html.j2", "xml.j2")),
        extensions=["jinja2.ext.do"],
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.globals["table"] = table
    return environment


def page(package: str, template: str, **values: Any) -> str:
    """A page, from one of a package's templates."""
    return templates(package).get_template(template).render(values)


def numbers(parts: Mapping[str, Any]) -> str:
    """Numbers of a page as JSON, with six digits, a line for each part."""
    short = json.loads(json.dumps(parts), parse_float=lambda text: float(f"{float(text):.6g}"))
    lines = (
        f"{json.dumps(name)}: {json.dumps(part, ensure_ascii=False)}"
        for name, part in short.items()
    )
    return "{\n" + ",\n".join(lines) + "\n}\n"


def source(image: bytes) -> str:
    """A PNG as the source of an image of a page, which so is one file."""
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"


def labels(bags: Sequence[Path]) -> list[str]:
    """Shortest path ends that distinguish the bags.

    A folder ``bag`` gets the name of its parent folder.
    """
    named = [
        path.resolve().parent if path.resolve().name == "bag" else path.resolve() for path in bags
    ]
    parts = [path.parts for path in named]
    for length in range(1, max(map(len, parts)) + 1):
        shortened = ["/".join(part[-length:]) for part in parts]
        if len(set(shortened)) == len(shortened):
            return shortened
    return [f"{path} ({i + 1})" for i, path in enumerate(bags)]
