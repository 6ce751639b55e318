#!/usr/bin/env python3
"""The history of welds: time to add, to read, and to report on ten thousand of them.

usage: history.py [--quick] [--json FILE]
"""

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))
sys.path.append(str(Path(__file__).resolve().parent.parent / "test" / "support"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(extras=("history",))

from report import parser, save, show

from fsw_quality import history, history_report
from fsw_test_support.made_history import rows


def main():
    """Measure, print a table, write JSON."""
    arguments = parser(__doc__, "a thousand welds").parse_args()
    welds = 1000 if arguments.quick else 10_000
    figures = {"welds": welds, "load_before": os.getloadavg()[0]}
    made = rows(welds, wear_nm=0.01)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        began = time.perf_counter()
        history.add(folder, made[:-1])
        figures["add_all_s"] = time.perf_counter() - began
        began = time.perf_counter()
        history.add(folder, made[-1:])
        figures["add_one_more_s"] = time.perf_counter() - began
        began, cpu = time.perf_counter(), time.process_time()
        table = history.load(folder)
        figures["load_s"] = time.perf_counter() - began
        history_report.write(table, folder / "report.html", "benchmark")
        figures["load_and_report_s"] = time.perf_counter() - began
        figures["load_and_report_cpu_s"] = time.process_time() - cpu
        figures["bytes_per_weld"] = sum(one.stat().st_size for one in folder.glob("*.parquet")) / welds
    show(figures)
    save(figures, arguments.json)


if __name__ == "__main__":
    main()
