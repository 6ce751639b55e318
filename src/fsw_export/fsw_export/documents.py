"""README and function block of an exported folder."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from fsw_export.c_library import ControllerSources
from fsw_export.signals import Signal

_IEC_TYPES = {"real": "LREAL", "int": "DINT", "bool": "BOOL"}


def write(folder: Path, sources: ControllerSources, origin: str, checked: str) -> None:
    """Write README.md and the function block into an exported folder.

    Parameters
    ----------
    folder : Path
    sources : ControllerSources
    origin : str
        From which model and tuning, in words.
    checked : str
        What the example said on the machine of the export.
    """
    block = f"FB_Fsw{sources.name.capitalize()}"
    templates = resources.files("fsw_export").joinpath("c")
    readme = Template(templates.joinpath("README.md.in").read_text(encoding="utf-8")).substitute(
        title=sources.title,
        origin=origin,
        checked=checked,
        header=sources.header,
        prefix=sources.prefix,
        input=sources.input_type,
        output=sources.output_type,
        start=sources.start,
        block=block,
        inputs=_table(sources.inputs),
        outputs=_table(sources.outputs),
        figures=figures_text(sources.name),
    )
    (folder / "README.md").write_text(readme, encoding="utf-8")
    (folder / f"{block}.st").write_text(_function_block(block, sources), encoding="utf-8")


def figures(name: str) -> dict[str, Any]:
    """Measured figures of a controller on other processors (``benchmarks/targets.py --publish``), empty if none."""
    text = resources.files("fsw_export").joinpath("targets.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text).get(name, {})
    return found


def _table(signals: tuple[Signal, ...]) -> str:
    lines = ["| name | type | unit | meaning |", "|---|---|---|---|"]
    lines += [
        f"| `{s.name}`{'' if s.in_c == s.name else f' (`{s.in_c}`)'} | {'int' if s.is_int else 'double'} "
        f"| {s.unit or '–'} | {s.text} |"
        for s in signals
    ]
    return "\n".join(lines)


def _function_block(block: str, sources: ControllerSources) -> str:
    templates = resources.files("fsw_export").joinpath("c")
    return Template(templates.joinpath("function_block.st.in").read_text(encoding="utf-8")).substitute(
        block=block,
        title=sources.title,
        prefix=sources.prefix,
        inputs="\n".join(map(_declaration, sources.inputs)),
        outputs="\n".join(map(_declaration, sources.outputs)),
    )


def _declaration(signal: Signal) -> str:
    unit = f"{signal.unit}; " if signal.unit else ""
    return f"  {signal.name} : {_IEC_TYPES[signal.kind]}; (* {unit}{signal.text} *)"


def figures_text(name: str) -> str:
    """Measured figures as Markdown."""
    return str(figures(name))
