"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence


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
