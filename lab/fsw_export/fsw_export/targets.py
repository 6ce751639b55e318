"""Memory and time of exported controllers on other processors (``benchmarks/targets.py``)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

from fsw_control.parameters import defaults
from fsw_export.choice import render
from fsw_nmpc.parameters import NmpcParameters

_TITLES = {
    "nmpc": "NMPC, default tuning (20 blocks of moves)",
    "nmpc_paper": "NMPC, the paper's tuning (108 moves)",
    "decentral": "Decentralized controller",
}
#: clocks of processors for which the time of a step is estimated [MHz]
_CLOCKS = (200, 480, 1000)
#: fewest and most cycles per instruction that are assumed; QEMU counts instructions only
_CYCLES = (1, 3)
#: limit on the solver's iterations that the documentation recommends for slow processors
_LOW_CAP = 12
#: clock of the page's times [MHz]
_CLOCK = 480
_TICK_MS = 100.0
_HEADER = [
    "controller",
    "processor",
    "difference from x86-64",
    "memory [KiB]",
    "code and constants [KiB]",
    f"largest measured tick [ms, {_CLOCK} MHz]",
    f"worst tick [ms, {_CLOCK} MHz]",
    "largest `max_iterations` in time",
]


def published(name: str, target: str) -> dict[str, Any] | None:
    """Shipped figures of an export on a processor for ``figures.md.j2``; None without any."""
    measured = json.loads(
        resources.files("fsw_export").joinpath("targets.json").read_text(encoding="utf-8")
    )
    return _derived(measured[name][target]) if target in measured.get(name, {}) else None


def results_page(measured: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """Page of the figures that ``benchmarks/targets.py`` measures, by export and target."""
    targets = [(_TITLES[name], of) for name, by in measured.items() for of in by.values()]
    counted = [(title, of) for title, of in targets if "instructions_max" in of]
    others = [of for _, of in targets if "instructions_max" not in of]
    return render(
        "targets.md",
        rows=[_HEADER, *([title, of["title"], *_figures(of)] for title, of in counted)],
        late=sum(_longest_ms(of, _default_limit()) > _TICK_MS for _, of in counted),
        others=sorted({of["title"] for of in others}),
        others_differ=max((of["largest_difference"] for of in others), default=0.0),
        limit=_default_limit(),
        clock=_CLOCK,
        cycles=_CYCLES,
    )


def _figures(measured: Mapping[str, Any]) -> list[str]:
    """Cells of a row of the page."""
    memory_kib = (measured["state_bytes"] + measured["stack_bytes"]) / 1024
    cap = _largest_limit(measured, _CLOCK) if "iterations_max" in measured else "-"
    return [
        f"{measured['largest_difference']:.3g}",
        f"{memory_kib:.1f}",
        f"{measured['flash_bytes'] / 1024:.1f}",
        _short(_milliseconds(measured["instructions_max"], _CLOCK)),
        _short(_longest_ms(measured, _default_limit())),
        f"{cap}",
    ]


def _default_limit() -> int:
    return int(defaults(NmpcParameters)["max_iterations"])


def _milliseconds(instructions: float, clock_mhz: int) -> float:
    """Longest time of so many instructions."""
    return instructions * _CYCLES[-1] / clock_mhz / 1e3


def _longest_ms(measured: Mapping[str, Any], cap: int) -> float:
    """Time of the worst tick.

    With an iterative solver that of its limit, else the largest measured.
    """
    iterative = "iterations_max" in measured
    return _milliseconds(
        _worst(measured, cap) if iterative else measured["instructions_max"], _CLOCK
    )


def _largest_limit(measured: Mapping[str, Any], clock_mhz: int) -> int:
    """Largest limit on the iterations with which the worst tick is in time; 0 if there is none."""
    limits = range(1, 201)
    in_time = (
        cap for cap in limits if _milliseconds(_worst(measured, cap), clock_mhz) <= _TICK_MS
    )
    return max(in_time, default=0)


def _derived(measured: Mapping[str, Any]) -> dict[str, Any]:
    """Measured figures, with the times and largest limits on the iterations from them."""
    counts, caps = {}, {}
    if "instructions_max" in measured:
        counts = {
            "median tick": measured["instructions_p50"],
            "99th percentile": measured["instructions_p99"],
            "largest": measured["instructions_max"],
        }
    if "iterations_max" in measured:
        for cap in (_LOW_CAP, _default_limit()):
            counts[f"estimated worst case with `max_iterations` {cap}"] = _worst(measured, cap)
        caps = {clock: _largest_limit(measured, clock) for clock in _CLOCKS}
    ticks = [
        (
            title,
            count,
            [[_short(count * cycles / clock / 1e3) for cycles in _CYCLES] for clock in _CLOCKS],
        )
        for title, count in counts.items()
    ]
    return {**measured, "ticks": ticks, "caps": caps, "clocks_mhz": _CLOCKS, "cycles": _CYCLES}


def _worst(measured: Mapping[str, Any], cap: int) -> int:
    """Instructions of a tick that solves twice, the most that it may, up to the limit."""
    without = int(measured["instructions_without"])
    return int(
        without + 2 * cap * (measured["instructions_max"] - without) / measured["iterations_max"]
    )


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
