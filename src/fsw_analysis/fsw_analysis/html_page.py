"""Pages of reports, each one HTML file with its images in it: values are escaped, and a missing one is an error."""

from __future__ import annotations

import base64
import io
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure


def page(package: str, template: str, **values: Any) -> str:
    """Text of a template in the folder ``templates`` of a package."""
    environment = Environment(
        loader=PackageLoader(package), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    return environment.get_template(template).render(values)


def png(figure: Figure, dpi: float) -> bytes:
    """A figure as PNG."""
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=dpi)
        return file.getvalue()


def source(image: bytes) -> str:
    """A PNG as the source of an image of a page."""
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"
