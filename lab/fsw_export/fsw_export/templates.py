"""Jinja2 templates of the texts that are exported."""

from __future__ import annotations

from math import inf
from typing import Any

from fsw_analysis.report import templates


def _c(value: Any) -> str:
    """A number, an array of numbers or a struct of those as a C constant, exactly."""
    if isinstance(value, dict):
        return "{" + ", ".join(f".{name} = {_c(member)}" for name, member in value.items()) + "}"
    if hasattr(value, "__len__"):
        return "{" + ", ".join(map(_c, value)) + "}"
    return {inf: "INFINITY", -inf: "-INFINITY"}.get(value) or repr(value)


_ENVIRONMENT = templates("fsw_export")
_ENVIRONMENT.filters["c"] = _c


def render(template: str, **values: Any) -> str:
    """Text of ``templates/<template>.j2``."""
    return _ENVIRONMENT.get_template(f"{template}.j2").render(values)
