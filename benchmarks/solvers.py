#!/usr/bin/env python3
"""Writes docs/results/solvers.md from measurements of nmpc_qp.py, nmpc.py, nmpc_acados.py.

python3 benchmarks/nmpc_qp.py --json out/qp.json
python3 benchmarks/nmpc.py --only-ratios --json out/nlp.json
python3 benchmarks/nmpc_acados.py --json out/acados.json
python3 benchmarks/solvers.py out/qp.json out/nlp.json --acados out/acados.json
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from nmpc_acados import QPS

from fsw_analysis.figure_style import legend_below, looks_of, sheet
from fsw_analysis.report import numbers, templates

PAGE = Path(__file__).resolve().parent.parent / "docs" / "results" / "solvers.md"
NAMES = {
    "own": "this project's",
    "daqp": "DAQP",
    "qpoases": "qpOASES",
    "hpipm": "HPIPM",
    "piqp": "PIQP",
    "highs": "HiGHS",
    "proxqp": "ProxQP",
    "osqp": "OSQP",
    "rti108": "this project's",
    "ipopt": "IPOPT",
    "sqp_piqp": "SQP, PIQP",
    "fatrop": "FATROP",
}
#: time over this project's that others should have at least
_AIM = 2.0
#: of a whole run of the benchmarks
ALL_PROBLEMS = 20
#: what a figure on a logarithmic scale shows of a cost that is the best (chosen)
_LEAST_EXCESS = 1e-12


class Row(NamedTuple):
    """A solver; None: not measured, or nothing was solved."""

    name: str
    unsolved: int
    cold_ms: float | None
    warm_ms: float | None
    interface_ms: float | None
    ratio: float | None  #: of the time over this project's
    excess: float | None  #: of the cost, largest


def qp_rows(figures: dict[str, Any], preset: str) -> list[Row]:
    """Solvers of a tick's QP, the fastest first."""

    def of(key: str) -> Any:
        return figures.get(f"{preset}_{key}")

    rows = [Row(NAMES["own"], 0, None, of("own_ms"), None, 1.0, of("excess_own"))]
    for name in (name for name in NAMES if of(f"unsolved_{name}") is not None):
        times = (of(f"{name}_{kind}") or None for kind in ("ms", "warm_ms", "interface_ms"))
        rows.append(
            Row(
                NAMES[name],
                of(f"unsolved_{name}"),
                *times,
                of(f"ratio_{name}"),
                of(f"excess_{name}"),
            )
        )
    return sorted(rows, key=lambda row: row.ratio or float("inf"))


def nlp_rows(figures: dict[str, Any]) -> list[Row]:
    """Solvers of the nonlinear problem, the fastest first."""
    rows = []
    for name in ("rti108", "sqp_piqp", "fatrop", "ipopt"):
        if figures.get(f"solve_{name}_ms") is None and not figures.get(f"unsolved_{name}"):
            continue
        ratio = 1.0 if name == "rti108" else figures[f"ratio_{name}"]
        excess, unsolved = figures.get(f"cost_excess_{name}"), figures.get(f"unsolved_{name}", 0)
        rows.append(
            Row(NAMES[name], unsolved, figures[f"solve_{name}_ms"], None, None, ratio, excess)
        )
    return sorted(rows, key=lambda row: row.ratio or float("inf"))


def lost(tables: dict[str, list[Row]]) -> list[str]:
    """Problems in which a solver takes less than twice this project's time, and the solvers."""
    close = {
        title: [row for row in rows if row.ratio is not None and row.ratio < _AIM]
        for title, rows in tables.items()
    }
    return [
        f"{title}: {', '.join(f'{row.name} ({row.ratio:.2g})' for row in rows)}"
        for title, of in close.items()
        if (rows := [row for row in of if row.name != NAMES["own"]])
    ]


def combined(tables: dict[str, list[Row]]) -> list[list[str]]:
    """Time of each solver over this project's by problem; most solved and fastest first."""

    def cell(row: Row | None) -> str:
        if row is None:
            return ""
        return number(row.ratio) if row.ratio is not None else f"{row.unsolved} not solved"

    by_name = {
        name: [next((row for row in rows if row.name == name), None) for rows in tables.values()]
        for name in dict.fromkeys(row.name for rows in tables.values() for row in rows)
    }
    return [["solver", *tables], *([name, *map(cell, rows)] for name, rows in by_name.items())]


def acados_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Phases of acados by QP solver beside the whole step of this project's solver: p50 / p99."""

    def both(name: str) -> str:
        return f"{number(figures[f'{name}_ms'])} / {number(figures[f'{name}_p99_ms'])}"

    rows = [
        ["", "preparation", "feedback", "together", "over this project's", "first move, off by"]
    ]
    rows.append([NAMES["own"], "", "", both("own"), "1", ""])
    for name, (title, _) in QPS.items():
        cells = [both(f"{name}_{phase}") for phase in ("preparation", "feedback")]
        off = number(figures[f"{name}_move_difference"], 2)
        rows.append([title, *cells, both(name), number(figures[f"{name}_ratio"]), off])
    return rows


def page(tables: dict[str, list[Row]], figures: dict[str, Any]) -> str:
    """The page, from the rows by problem and the figures of the benchmarks that it names."""
    template = templates(Path(__file__).parent).get_template("solvers.md.j2")
    return template.render(
        figures,
        lost=lost(tables),
        rows=combined(tables),
        acados_rows=acados_rows(figures["acados"]) if figures["acados"] else [],
    )


def draw(tables: dict[str, list[Row]], file: Path) -> None:
    """Cost excess against time, a panel for each problem; a solver has one look in all."""
    others = sorted({row.name for rows in tables.values() for row in rows} - {NAMES["own"]})
    points = [look.point for look in looks_of(["nmpc", *others])]
    looks = dict(zip([NAMES["own"], *others], points, strict=True))
    with sheet(11.0, 4.6, file) as figure:
        panels = zip(figure.subplots(1, len(tables)), tables.items(), strict=True)
        for axes, (title, rows) in panels:
            for row in (row for row in rows if row.excess is not None):
                time_ms = min(time for time in (row.cold_ms, row.warm_ms) if time is not None)
                excess = max(row.excess or 0.0, _LEAST_EXCESS)
                axes.plot(time_ms, excess, markersize=8, label=row.name, **looks[row.name])
            axes.set(xscale="log", yscale="log", title=title, xlabel="CPU time [ms]")
            axes.margins(0.15)
        figure.axes[0].set_ylabel("largest excess of the cost")
        legend_below(figure, most=7)


def number(value: float | None, digits: int = 3) -> str:
    """For a table."""
    return "–" if value is None else f"{value:.{digits}g}" if value else "0"


def main() -> int:
    """Write the page; returns the exit code."""
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("qp", type=Path, metavar="QP.json", help="of nmpc_qp.py")
    arguments.add_argument("nlp", type=Path, metavar="NLP.json", help="of nmpc.py")
    arguments.add_argument("--acados", type=Path, metavar="ACADOS.json", help="of nmpc_acados.py")
    arguments.add_argument("--page", type=Path, default=PAGE)
    parsed = arguments.parse_args()
    qp, nlp = (json.loads(file.read_text(encoding="utf-8")) for file in (parsed.qp, parsed.nlp))
    tables = {
        "QP, preset default": qp_rows(qp, "default"),
        "QP, preset paper": qp_rows(qp, "paper"),
        "nonlinear": nlp_rows(nlp),
    }
    draw(tables, parsed.page.with_suffix(".png"))
    figures = {
        "default_problems": qp["default_problems"],
        "paper_problems": qp["paper_problems"],
        "nonlinear_problems": nlp["ratio_problems"],
        "active": number(qp["default_active"]),
        "iterations": number(qp["default_iterations"]),
        "acados": json.loads(parsed.acados.read_text(encoding="utf-8")) if parsed.acados else {},
        "fatrop": {key: number(value) for key, value in nlp.items() if key.startswith("fatrop_")},
        "quick": " --quick" if qp["paper_problems"] < ALL_PROBLEMS else "",
    }
    rows = {title: [row._asdict() for row in of] for title, of in tables.items()}
    parsed.page.with_name(f"{parsed.page.stem}_tables.json").write_text(
        numbers({**figures, "tables": rows}), encoding="utf-8"
    )
    parsed.page.write_text(page(tables, figures), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
