#!/usr/bin/env python3
"""Campaigns: welds per second with one worker and with two, and the overhead of Dask and of the dataset.

usage: campaign.py [--quick] [--json FILE]
"""

import os
import platform
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(extras=("campaign",))

from report import parser, save, show

from fsw_campaign import dataset, definition, engine
from fsw_campaign.welds import run_batch

AIMS = {
    "nmpc_default_2_workers_welds_per_s": 4.0,
    "decentral_tight_2_workers_welds_per_s": 25.0,
    "decentral_tight_speedup_by_2_workers": 1.8,
}
#: a weld of 240 s
SCENARIO = "reference_tracking"
FACTORS = {
    f"plant.factors.{name}": {"uniform": [0.8, 1.25]}
    for name in (
        "thermal_gain_c_per_kw",
        "copper_lag_s",
        "tool_lag_s",
        "depth_gain_mm_per_kn_s",
        "depth_zero_s",
    )
}


def campaign(controller, welds):
    """A campaign with one controller and as many factors as a study has."""
    text = definition.scenario_file.text_of(SCENARIO)
    return definition.read(
        {
            "name": "benchmark",
            "scenario": definition.scenario_file.content_of(text),
            "controllers": [controller],
            "welds": welds,
            "distributions": FACTORS,
            "limits": {"depth_error_mm": {"min": -0.1, "max": 0.1}},
        }
    )


def cpu_s(client):
    """CPU time of this process, which has the scheduler, and of all workers."""
    return time.process_time() + sum(client.run(time.process_time).values())


def run(made, workers, folder):
    """Run a campaign, and the same welds in this process, whose CPU time is no overhead."""
    labels = [one.label for one in made.entrants]
    batch = [(index, made.parameters(index), labels) for index in range(made.welds)]
    with engine.connect(None, workers) as client, dataset.Dataset(folder, made) as written:
        client.run(run_batch, made.text, batch[:4])  # to warm up
        before_s, began_s = cpu_s(client), time.perf_counter()
        welds = engine.run(written, client)
        elapsed_s, used_s = time.perf_counter() - began_s, cpu_s(client) - before_s
    began_s = time.process_time()
    run_batch(made.text, batch)
    welds_s = time.process_time() - began_s
    return {
        "welds_per_s": welds / elapsed_s,
        "cpu_per_weld_ms": 1e3 * welds_s / welds,
        "overhead_share": used_s / welds_s - 1.0,
    }


def main():
    """Measure, print a table, write JSON."""
    arguments = parser(__doc__, "fewer welds").parse_args()
    share = 0.2 if arguments.quick else 1.0
    result = {"scenario": SCENARIO, "cpus": os.cpu_count(), "python": platform.python_version()}
    result["load_before"] = os.getloadavg()[0]
    for controller, welds in (("decentral:tight", 400), ("nmpc:default", 120)):
        name = controller.replace(":", "_")
        for workers in (1, 2):
            made = campaign(controller, int(welds * share * workers / 2))
            with tempfile.TemporaryDirectory() as scratch:
                found = run(made, workers, Path(scratch) / "campaign")
            result |= {f"{name}_{workers}_workers_{key}": value for key, value in found.items()}
        rates = [result[f"{name}_{workers}_workers_welds_per_s"] for workers in (2, 1)]
        result[f"{name}_speedup_by_2_workers"] = rates[0] / rates[1]
    result["load_after"] = os.getloadavg()[0]
    show(result, AIMS)
    save(result, arguments.json)


if __name__ == "__main__":
    main()
