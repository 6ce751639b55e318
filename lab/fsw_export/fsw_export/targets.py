"""Memory and time of the exported controllers on other processors, as ``benchmarks/targets.py`` has measured them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

from fsw_control.parameters import defaults
from fsw_export.templates import render
from fsw_nmpc.parameters import NmpcParameters

_TITLES = {
    "nmpc": "NMPC, default tuning (20 blocks of moves)",
    "nmpc_adaptive": "NMPC, preset `adaptive` (20 blocks of moves)",
    "nmpc_paper": "NMPC, the paper's tuning (108 moves)",
    "decentral": "Decentralized controller",
}
#: clocks of processors for which the time of a step is estimated [MHz]
_CLOCKS = (200, 480, 1000)
#: fewest and most cycles per instruction that are assumed; QEMU counts instructions only
_CYCLES = (1, 3)
#: limit on the solver's iterations that the documentation recommends for slow processors
_LOW_CAP = 12


def published(name: str, target: str) -> dict[str, Any] | None:
    """Shipped figures of an export on a processor for ``figures.md.j2``, None if there are none."""
    measured = json.loads(
        resources.files("fsw_export").joinpath("targets.json").read_text(encoding="utf-8")
    )
    return _derived(measured[name][target]) if target in measured.get(name, {}) else None


def results_page(measured: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """The page of measured figures, by export and target as ``benchmarks/targets.py`` measures them."""
    exports = {
        _TITLES[name]: list(map(_derived, targets.values())) for name, targets in measured.items()
    }
    return render("targets.md", exports=exports)


def _derived(measured: Mapping[str, Any]) -> dict[str, Any]:
    """Measured figures, with the times and the largest limits on the iterations that follow from them."""
    counts, caps = {}, {}
    if "instructions_max" in measured:
        counts = {
            "median tick": measured["instructions_p50"],
            "99th percentile": measured["instructions_p99"],
            "largest": measured["instructions_max"],
        }
    if "iterations_max" in measured:
        for cap in (_LOW_CAP, defaults(NmpcParameters)["max_iterations"]):
            counts[f"estimated worst case with `max_iterations` {cap}"] = _worst(measured, cap)
        for clock in _CLOCKS:
            budget = 0.1 * clock * 1e6 / _CYCLES[-1]
            caps[clock] = max(
                (cap for cap in range(1, 201) if _worst(measured, cap) <= budget), default=0
            )
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
    """Instructions of a tick that solves twice, the most that it may, each time up to the limit."""
    without = int(measured["instructions_without"])
    return int(
        without + 2 * cap * (measured["instructions_max"] - without) / measured["iterations_max"]
    )


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
