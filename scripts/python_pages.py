"""Pages on what is public in Python."""

from collections.abc import Callable

import fsw
from fsw_control.schema.extensions import extensions

#: page of what is public in Python, by package
API_PAGES = {
    "fsw": "fsw",
    "fsw_analysis": "fsw",
    "fsw_control": "contract",
    "fsw_scenario": "contract",
    "fsw_lab": "more",
    "fsw_quality": "more",
}


def python_api(page: Callable[..., str]) -> dict[str, str]:
    """Pages on `import fsw` whose text mkdocstrings makes from the docstrings, one per module."""
    places = dict(fsw.MODULE_OF)
    places |= {name: entry.module for name, entry in extensions("fsw.api").items()}
    modules: dict[str, list[str]] = {}
    for name, module in sorted(places.items()):
        modules.setdefault(API_PAGES[module.partition(".")[0]], []).append(f"{module}.{name}")
    return {
        f"python-{key}": page(title, *(f"::: {name}\n" for name in modules[key]))
        for key, title in (
            ("fsw", "Python: weld, compare, model"),
            ("contract", "Python: contracts of controllers and plants"),
            ("more", "Python: identify, tune, export, record"),
        )
    }
