"""Jinja2 templates of the texts that are exported."""

from __future__ import annotations

from math import inf
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape


def _c(value: Any) -> str:
    """A number or an array of numbers as a C constant, exactly."""
    if hasattr(value, "__len__"):
        return "{" + ", ".join(map(_c, value)) + "}"
    return {inf: "INFINITY", -inf: "-INFINITY"}.get(value) or repr(value)


_ENVIRONMENT = Environment(
    loader=PackageLoader("fsw_export"),
    autoescape=select_autoescape(["xml.j2"]),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_ENVIRONMENT.filters["c"] = _c


def render(template: str, **values: Any) -> str:
    """Text of ``templates/<template>.j2``."""
    return _ENVIRONMENT.get_template(f"{template}.j2").render(values)
