"""What all benchmarks share.

Their environment, command line, table, JSON file and page of results.

Import it before all that the environment installs.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

Figures = dict[str, Any]

HERE = Path(__file__).resolve().parent
WORKSPACE = HERE.parent
RESULTS = WORKSPACE / "docs" / "results"
sys.path.append(str(WORKSPACE / "scripts"))

# a benchmark that is run, not one that a test or another script imports, nor a process of its pool
if Path(sys.argv[0]).resolve().parent == HERE and multiprocessing.parent_process() is None:
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # one weld on one core
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from _bootstrap import ensure

    ensure(dev=True, extras=("canister", "history", "hmi", "machine", "science"))


def parser(description: str | None, quick: str) -> argparse.ArgumentParser:
    """Parser with ``--quick``, which means what ``quick`` says, and ``--json``."""
    made = argparse.ArgumentParser(description=(description or "").partition("\n")[0])
    made.add_argument("--quick", action="store_true", help=quick.replace("%", "%%"))
    made.add_argument("--json", type=Path, metavar="FILE", help="write the figures as flat JSON")
    return made


def show(
    figures: Mapping[str, Any], aims: Mapping[str, float] | None = None, sign: str = ">="
) -> None:
    """Print a row per figure, with its aim where it has one."""
    width = max(map(len, figures))
    for name, value in figures.items():
        text = f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)
        aim = f"  aim: {sign} {aims[name]:g}" if aims and name in aims else ""
        print(f"{name:<{width}}{text:>20}{aim}")


def save(figures: Mapping[str, Any], path: Path | None) -> None:
    """Write the figures, if a file was asked for."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


def rendered(page: str, content: Mapping[str, Any]) -> str:
    """A page of results by the template of the same name."""
    from fsw_analysis.report import templates

    return templates(HERE).get_template(f"{page.replace('-', '_')}.md.j2").render(content)


def run(
    description: str | None,
    quick: str,
    measure: Callable[..., tuple[Figures, Mapping[str, Any]]],
    page: str = "",
    options: Mapping[str, Mapping[str, Any]] | None = None,
    aims: Mapping[str, float] | None = None,
    sign: str = ">=",
) -> Figures:
    """Measure, print the figures with their aims, save them and, unless quick, write the page.

    ``measure`` gets ``quick`` and the values of ``options`` (arguments of the command line, each
    with those of ``add_argument``) by name; it returns the figures, which are returned, and the
    content of the page, empty if there is to be none.
    """
    made = parser(description, quick)
    for name, settings in (options or {}).items():
        made.add_argument(name, **settings)
    chosen = vars(made.parse_args())
    file = chosen.pop("json")
    figures, content = measure(**chosen)
    show(figures, aims, sign)
    save(figures, file)
    if page and content and not chosen["quick"]:
        (RESULTS / f"{page}.md").write_text(rendered(page, content), encoding="utf-8")
    return figures


def flat(nested: Mapping[Any, Any], between: str = ": ") -> Figures:
    """Figures of nested mappings by the keys that lead to them; a key may be a tuple.

    E.g. ``canister: depth stuck: welds``.
    """
    figures: Figures = {}
    for key, value in nested.items():
        name = between.join(map(str, key)) if isinstance(key, tuple) else str(key)
        if isinstance(value, Mapping):
            figures |= {f"{name}{between}{rest}": of for rest, of in flat(value, between).items()}
        else:
            figures[name] = value
    return figures


def records(table: Any) -> list[Figures]:
    """Rows of a data frame as plain values; None where a value is missing."""
    rows: list[Figures] = table.astype(object).where(table.notna(), None).to_dict("records")
    return rows


def each(function: Callable[[Any], Any], tasks: Iterable[Any], name: str = "") -> list[Any]:
    """Results of a function of each task, on all cores, with the progress on standard error."""
    from fsw_tuning.standard_runs import on_all_cores  # of the environment

    jobs = list(tasks)
    return counted(on_all_cores(function, jobs), jobs, name)


def counted(results: Iterable[Any], jobs: Sequence[Any], name: str = "") -> list[Any]:
    """All results, with the progress on standard error."""
    kept = []
    for result in results:
        kept.append(result)
        print(f"\r{name} {len(kept)} of {len(jobs)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return kept


def percentiles(name: str, values: Sequence[float], unit: str = "ms") -> Figures:
    """Median, 99th percentile and largest of values."""
    import numpy as np  # of the environment

    shares = {"p50": 0.5, "p99": 0.99, "max": 1.0}
    return {f"{name}_{word}_{unit}": float(np.quantile(values, of)) for word, of in shares.items()}


def processor_s(process: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mib(process: int) -> float:
    """Resident memory of a process; 0 of one that has ended."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0) / 1024.0
