"""``fsw.py tune``: tunings of both controllers for a model, as files that their nodes take."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

import fsw
from fsw.command import command, file, number, switch
from fsw.outputs import new_folder
from fsw.progress import ProgressBar
from fsw_model import ModelParameters
from fsw_scenario.identification_design import plant_factors
from fsw_scenario.standard_runs import draw_sweep, sweep
from fsw_scenario.tune_decentral import NAMES
from fsw_schema.ranges import Range

#: processes that differ from the model, as factors on its parameters
_SWEEP: dict[str, dict[str, float]] = {
    "the model": {},
    **{f"thermal gain × {k:g}": {"thermal_gain_c_per_kw": k} for k in (0.7, 1.4)},
    **{f"depth gain × {k:g}": {"depth_gain_mm_per_kn_s": k} for k in (0.7, 1.4)},
    **{f"softening × {k:g}": {"softening_per_c": k} for k in (0.7, 1.4)},
    **{f"thermal lag × {k:g}": {"copper_lag_s": k} for k in (0.7, 1.4)},
    **{f"dead time × {k:g}": {"dead_time_s": k} for k in (0.7, 1.3)},
}
EVALUATIONS = 3000


@command(
    "tune",
    "tunings of both controllers for a model",
    file("--model", "model file, e.g. from fsw.py identify", required=True),
    file("--out", "folder for the files", "DIR", required=True),
    number(
        "--evaluations",
        "N",
        Range(1, 1_000_000, ""),
        "of the search, per decentralized tuning; fewer are faster but worse (default %(default)s: some minutes)",
        EVALUATIONS,
        int,
    ),
    switch("--no-sweep", "without the figure of processes that differ from the model"),
    description="Search for both tunings of the decentralized controller for a model, derive that of the NMPC by "
    "rule, plot their performance on processes that differ from the model, and write parameter files for the "
    "controllers' nodes.",
)
def tune(arguments: argparse.Namespace) -> int:
    model = ModelParameters.from_file(arguments.model)
    folder = new_folder(arguments.out, "tuning").resolve()
    own = write_tunings(arguments.model, folder, arguments.evaluations)
    model_file = folder / "model.yaml"
    if not arguments.no_sweep:
        own["nmpc:default"] = {"model_file": str(model_file)}
        plants = {name: plant_factors(model.scaled(**factors)) for name, factors in _SWEEP.items()}
        with ProgressBar("processes that differ from the model") as bar:
            draw_sweep(sweep(own, plants, bar), folder / "sweep.png")
    print(f"in {folder}: {', '.join(path.name for path in sorted(folder.iterdir()))}")
    return 0


def write_tunings(model_file: Path, folder: Path, evaluations: int, origin: str = "") -> dict[str, Mapping[str, Any]]:
    """Search, and write the parameter files of all controllers; returns the gains of the decentralized ones by label.

    ``origin``: comment for the head of the files.
    """
    own: dict[str, Mapping[str, Any]] = {}
    for name in NAMES:
        label = f"decentral:{name}"
        with ProgressBar(label) as bar:
            own[label] = fsw.tune(label, model_file, evaluations=evaluations, progress=bar)
        _write(folder / f"decentral_{name}.yaml", "fsw_decentral", own[label], origin)
    copy, tuning_file = folder / "model.yaml", folder / "nmpc_tuning.yaml"
    shutil.copyfile(model_file, copy)
    rule = f"# By rule from the dead time of {model_file.name}.\n"
    tuning_file.write_text(f"{origin}{rule}{yaml.safe_dump(fsw.tune('nmpc', model_file))}", "utf-8")
    _write(folder / "nmpc.yaml", "fsw_nmpc", {"model_file": str(copy), "tuning_file": str(tuning_file)}, origin)
    return own


def _write(path: Path, node: str, values: Mapping[str, Any], origin: str) -> None:
    """Write parameters of a node, as ``--ros-args --params-file`` takes them."""
    text = yaml.safe_dump({node: {"ros__parameters": dict(values)}}, sort_keys=False)
    path.write_text(origin + text, encoding="utf-8")
