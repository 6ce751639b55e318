"""What all reports share: their templates, pages, tables in Markdown, and shares with their intervals."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, FileSystemLoader, PackageLoader, StrictUndefined

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def templates(place: str | Path, html: bool = False) -> Environment:
    """Templates of a package's folder ``templates``, or of a folder; a missing value is an error.

    ``html``: values are escaped.
    """
    return Environment(
        loader=FileSystemLoader(place) if isinstance(place, Path) else PackageLoader(place),
        autoescape=html,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )


def page(package: str, template: str, **values: Any) -> str:
    """A page, from one of a package's templates."""
    return templates(package, html=True).get_template(template).render(values)


def png(figure: Figure, dpi: float) -> bytes:
    """A figure as PNG."""
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=dpi)
        return file.getvalue()


def source(image: bytes) -> str:
    """A PNG as the source of an image of a page, which so is one file."""
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"


def table(rows: Sequence[Sequence[str]]) -> str:
    """Markdown of a table; the first row is its header, the first column words and all others numbers."""
    header, *body = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([header, "|---|" + "---:|" * (len(rows[0]) - 1), *body])


def wilson(good: int, total: int) -> tuple[float, float]:
    """Wilson interval (95 %) of the share of ``good`` ones in ``total``."""
    from scipy.stats import binomtest  # heavy to import

    interval = binomtest(good, total).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)
