"""README and function block of an exported folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from fsw_control.parameters import load
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
        title=sources.title[0].upper() + sources.title[1:],
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
        figures=figures_text("nmpc_paper" if sources.sizes.get("FSW_MAX_BLOCKS") == _ALL_MOVES else sources.name),
        tables=sources.tables_name,
        digest=sources.digest(),
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
        inputs="\n".join(_declared_inputs(sources.inputs)),
        outputs="\n".join(map(_declaration, sources.outputs)),
    )


def _declared_inputs(inputs: Sequence[Signal]) -> list[str]:
    """Inputs as a PLC declares them: flags of what is valid in place of NaN, and one announced set-point."""
    lines = []
    for signal in inputs:
        if signal.name in ("dt_s", "n_changes"):
            continue
        lines.append(_declaration(replace(signal, text=signal.text.partition("; NaN")[0])))
        if flag := _FLAGS.get(signal.name):
            lines.append(f"  {flag[0]} : BOOL; (* {flag[1]} *)")
    return lines


#: flag after the last of the inputs that it speaks of, in a function block
_FLAGS = {
    "acting_speed_rpm": ("drives_valid", "whether the two above are known"),
    "applied_speed_rpm": ("applied_valid", "whether the two above are known; if not, as before"),
    "reference_temperature_c": ("reference_valid", "whether the two above are known; if not, as before"),
    "change_temperature_c": ("change_valid", "whether the three above announce a set-point"),
}


def _declaration(signal: Signal) -> str:
    unit = f"{signal.unit}; " if signal.unit else ""
    return f"  {signal.name} : {_IEC_TYPES[signal.kind]}; (* {unit}{signal.text} *)"


#: blocks of moves of the paper's tuning
_ALL_MOVES = 54
#: clocks of processors for which the time of a step is told [MHz]
_CLOCKS = (200, 480, 1000)
#: cap of the solver's iterations that the documentation recommends for slow processors
_LOW_CAP = 12
#: cycles per instruction that are reckoned with; QEMU counts instructions only
_CYCLES = (1, 2, 3)


def figures_text(name: str) -> str:
    """Memory and time of a controller as Markdown, from the shipped measurement."""
    found = figures(name).get("cortex_m7")
    if not found:
        return "Not measured."
    return (
        f"Measured with the paper's model and {'its' if name == 'nmpc_paper' else 'the default'} tuning on a Cortex-M7 "
        f"emulated by QEMU (gcc -O3, double precision):\n\n{_memory(found)}\n\n{_time(found)}"
    )


def _memory(found: Mapping[str, Any]) -> str:
    rows = [
        ("controller, input and output", "state_bytes"),
        ("stack of a step", "stack_bytes"),
        ("code and constants", "flash_bytes"),
    ]
    lines = ["| memory | kB |", "|---|---|"]
    lines += [f"| {title} | {found[key] / 1024:.1f} |" for title, key in rows]
    return "\n".join(lines)


def _time(found: Mapping[str, Any]) -> str:
    counts = {
        "median tick": found["instructions_p50"],
        "99th percentile": found["instructions_p99"],
        "largest": found["instructions_max"],
    }
    if "iterations_max" in found:
        caps = load("fsw_nmpc", "nmpc.yaml")["max_iterations"]
        for cap in (_LOW_CAP, caps.default):
            counts[f"estimate of the worst with `max_iterations` {cap}"] = _worst(found, cap)
    lines = [
        "| tick | instructions | " + " | ".join(f"ms at {clock} MHz" for clock in _CLOCKS) + " |",
        "|---|---|" + "---|" * len(_CLOCKS),
    ]
    for title, count in counts.items():
        times = [[count * cycles / clock / 1e3 for cycles in _CYCLES] for clock in _CLOCKS]
        lines.append(
            f"| {title} | {count:,} | " + " | ".join(f"{_short(t[0])} to {_short(t[-1])}" for t in times) + " |"
        )
    ends = f"{_CYCLES[0]} to {_CYCLES[-1]}"
    if "iterations_max" in found:
        lines.append(_caps(found))
    lines.append(
        f"\nQEMU counts instructions. The times assume {ends} cycles per instruction; "
        "they were not measured on a board. A tick may take 100 ms."
    )
    return "\n".join(lines)


def _caps(found: Mapping[str, Any]) -> str:
    """Up to which cap of the iterations the worst tick fits, per clock."""
    fits = {}
    for clock in _CLOCKS:
        budget = 0.1 * clock * 1e6 / _CYCLES[-1]
        fits[clock] = max((cap for cap in range(1, 201) if _worst(found, cap) <= budget), default=0)
    words = [f"{cap} at {clock} MHz" if cap else f"none at {clock} MHz" for clock, cap in fits.items()]
    cycles = f"{_CYCLES[-1]} cycles per instruction"
    return f"\nLargest `max_iterations` with which the worst tick takes 100 ms at {cycles}: {', '.join(words)}."


def _worst(found: Mapping[str, Any], cap: int) -> int:
    """Instructions of a tick that solves twice, as it may at most, each time up to the cap."""
    without = int(found["instructions_without"])
    per_iteration = (found["instructions_max"] - without) / found["iterations_max"]
    return int(without + 2 * cap * per_iteration)


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def results_page(found: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """The page of measured figures of all exports.

    Parameters
    ----------
    found : mapping of str to mapping of str to mapping
        By export and target, as ``benchmarks/targets.py`` measures them.
    """
    titles = {
        "nmpc": "NMPC, default tuning (20 blocks of moves)",
        "nmpc_paper": "NMPC, the paper's tuning (108 moves)",
        "decentral": "Decentralized controller",
    }
    parts = [
        "# The controllers on other processors\n",
        "Written by `benchmarks/targets.py --publish`: every controller is exported ([how](../how-to/plc.md)), built "
        "by its own `CMakeLists.txt` and run on its test vectors, a weld of 240 s with noise, disturbances and sensor "
        "faults.\n",
        "The paper ends with a real-time implementation that is not possible on the machine's PLCs.\n",
    ]
    for name, by_target in found.items():
        parts.append(f"## {titles[name]}\n")
        parts.append("| processor | largest difference of an output from x86-64 |\n|---|---|")
        parts += [f"| {one['title']} | {one['largest_difference']:.3g} |" for one in by_target.values()]
        for target in ("cortex_m7", "cortex_m7_sp"):
            if target in by_target:
                one = by_target[target]
                parts.append(f"\n{one['title']}:\n\n{_memory(one)}\n\n{_time(one)}\n")
    return "\n".join(parts) + "\n"
