"""``fsw.py tune``: tunings of both controllers for a model, as files that their nodes take."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

import fsw
from fsw.command import FORCE, FORMAT, command, file, number, switch
from fsw.console import ProgressBar, listed, new_folder, print_table
from fsw_control.schema.ranges import Range
from fsw_model import MachineData, ModelParameters
from fsw_tuning import margins
from fsw_tuning.identification_design import plant_factors
from fsw_tuning.standard_cases import DEFAULT, TIGHT
from fsw_tuning.standard_runs import draw_sweep, sweep
from fsw_tuning.tune_decentral import NAMES

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
    file("--machine", "sensors' noise and drives' rates from fsw.py identify, for the NMPC"),
    file("--out", "folder for the files", "DIR", required=True),
    number(
        "--evaluations",
        "N",
        Range(1, 1_000_000, ""),
        "of the search, per decentralized tuning; "
        "fewer are faster but worse (default %(default)s: some minutes)",
        EVALUATIONS,
        int,
    ),
    switch(
        "--matched",
        "slow the NMPC's temperature until its margins are at least those of decentral:tight",
    ),
    FORMAT,
    FORCE,
    switch("--no-sweep", "without the figure of processes that differ from the model"),
    description="Search for the tunings of the decentralized controller for a model, "
    "derive that of the NMPC by rule, measure the margins of all, "
    "plot their performance on processes that differ from the model, "
    "and write parameter files for the controllers' nodes.",
)
def tune(arguments: argparse.Namespace) -> int:
    model = ModelParameters.from_file(arguments.model)
    if arguments.machine is not None:
        MachineData.from_file(arguments.machine)  # what is wrong in it is said before the search
    folder = new_folder(arguments, "tuning").resolve()
    tunings = write_tunings(
        arguments.model,
        folder,
        arguments.evaluations,
        matched=arguments.matched,
        machine_file=arguments.machine,
    )
    rows = [[label, *_ordered(of, model)] for label, of in tunings.margins.items()]
    print_table(rows, ["margins", *margins.TITLES.values()], words=1)
    if not arguments.no_sweep:
        plants = {name: plant_factors(model.scaled(**factors)) for name, factors in _SWEEP.items()}
        with ProgressBar("processes that differ from the model") as bar:
            target = folder / f"sweep.{arguments.format or 'png'}"
            draw_sweep(sweep(tunings.parameters, plants, bar), target)
    print(listed(folder))
    return 0


class Tunings(NamedTuple):
    """Parameters and margins of all controllers, by label."""

    parameters: dict[str, Mapping[str, Any]]
    margins: dict[str, dict[str, float]]


def write_tunings(
    model_file: Path,
    folder: Path,
    evaluations: int,
    origin: str = "",
    matched: bool = False,
    machine_file: Path | None = None,
) -> Tunings:
    """Search, measure the margins, and write the parameter files of all controllers.

    ``origin``: comment for the head of the files. ``matched``: the NMPC gets the margins of
    ``decentral:tight``. ``machine_file``: data of the sensors and drives, which the NMPC gets.
    """
    model = ModelParameters.from_file(model_file)
    tunings = Tunings({}, {})
    for name in NAMES:
        label = f"decentral:{name}"
        with ProgressBar(label) as bar:
            gains = fsw.tune(label, model_file, evaluations=evaluations, progress=bar)
        tunings.parameters[label] = gains
        tunings.margins[label] = margins.Loops(label, gains, model).margins()
        words = _words(tunings.margins[label], model)
        _write(folder / f"decentral_{name}.yaml", "fsw_decentral", gains, origin + words)
    copy, tuning_file = folder / "model.yaml", folder / "nmpc_tuning.yaml"
    shutil.copyfile(model_file, copy)
    files = {"model_file": str(copy)}
    if machine_file is not None:
        files["machine_file"] = str(folder / "machine.yaml")
        shutil.copyfile(machine_file, files["machine_file"])
    tuning = fsw.tune("nmpc", model_file)
    rule = f"# By rule from the dead time of {model_file.name}"
    if matched:
        slower = margins.slower_for(tunings.margins[TIGHT], files, model)
        tuning["temperature_time_s"] *= slower
        rule += f", times {slower:.3g} for the margins of {TIGHT}"
    parameters = files | {"tuning_file": str(tuning_file)}
    tuning_file.write_text(yaml.safe_dump(tuning), "utf-8")
    tunings.parameters[DEFAULT] = parameters
    tunings.margins[DEFAULT] = margins.Loops(DEFAULT, parameters, model).margins()
    words = _words(tunings.margins[DEFAULT], model)
    tuning_file.write_text(f"{origin}{rule}.\n{words}{yaml.safe_dump(tuning)}", "utf-8")
    _write(folder / "nmpc.yaml", "fsw_nmpc", parameters, origin + words)
    return tunings


def _words(measured: Mapping[str, float], model: ModelParameters) -> str:
    """Margins as a comment of a file."""
    words = ", ".join(
        f"{title} {text}"
        for title, text in zip(margins.TITLES.values(), _ordered(measured, model), strict=True)
    )
    return f"# Margins with this model, by simulation of small steps: {words}.\n"


def _ordered(measured: Mapping[str, float], model: ModelParameters) -> list[str]:
    words = margins.texts(measured, model)
    return [words[key] for key in margins.TITLES]


def _write(path: Path, node: str, values: Mapping[str, Any], origin: str) -> None:
    """Write parameters of a node, as ``--ros-args --params-file`` takes them."""
    text = yaml.safe_dump({node: {"ros__parameters": dict(values)}}, sort_keys=False)
    path.write_text(origin + text, encoding="utf-8")
