"""``fsw.py identify``: the model of a process from its recorded welds."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import fsw
from fsw.bags import print_notes, read_weld
from fsw.command import FORCE, FORMAT, assigned, command, file, number, option, repeated, switch
from fsw.console import ProgressBar, check_new, new_folder, print_table, write_text
from fsw.errors import CommandError
from fsw.welds import Weld
from fsw_analysis.changes import cut_to_scenario
from fsw_control.schema.models import range_of
from fsw_control.schema.ranges import Range
from fsw_identification import report, summary
from fsw_identification.read_table import read_table
from fsw_lab.identify import TABLES
from fsw_model import ModelParameters, ParameterCovariance
from fsw_plant.parameters import Actuators
from fsw_tuning.identification_design import SAFE_C, SAFE_MM, propose

#: lengths of an experiment that can be proposed, and the default
_EXPERIMENT_S, _DURATION_S = Range(60.0, 1800.0, "s"), 300.0
DRIVE_LAG = number(
    "--drive-lag",
    "S",
    range_of(Actuators, "lag_s"),
    "time constant of the drives (default %(default)s s, the emulator's)",
    Actuators().lag_s,
)


@command(
    "identify",
    "model parameters of a process from bags of its welds; proposes an experiment",
    option(
        "bag", type=Path, nargs="*", help="bag or log (CSV) of a weld; several: one model for all"
    ),
    repeated(
        "--column",
        "QUANTITY=NAME",
        "with a log: name of a column by quantity and unit, e.g. force_n=F_ax; "
        "others are found by names such as force_kn or 'Axial force [N]'",
    ),
    file("--out", "model file (YAML); with --design the scenario"),
    file(
        "--covariance",
        "covariance of the estimates (YAML), for the monitor and for --prior at the next weld",
    ),
    file("--machine", "noise of the sensors and rates of the drives (YAML), for the NMPC"),
    file("--validate", "weld to validate the model, not used for the estimate", "BAG"),
    file("--air", "run in air at several speeds, to identify the friction (23)", "BAG"),
    file("--report", "write report.html and its figure into this folder", "DIR"),
    file("--model", "model to start from (default: the paper's)"),
    file(
        "--prior",
        "covariance of --model, as the last weld of the machine left it: this weld updates both",
        "COVARIANCE",
    ),
    switch(
        "--other-type", "with --prior: the last weld was of another type of canister, lid or path"
    ),
    DRIVE_LAG,
    switch(
        "--steady",
        "take disturbances as constant: without drifts and shifts all that is "
        "slow is the process's",
    ),
    switch("--design", "propose an experiment and print the accuracy to expect"),
    number(
        "--duration",
        "S",
        _EXPERIMENT_S,
        f"of the proposed experiment, {_EXPERIMENT_S} (default {_DURATION_S:g})",
    ),
    switch("--open-loop", "propose steps of force and speed, without controller"),
    FORMAT,
    FORCE,
    description="Estimate the parameters of the process model from one or more recorded welds of "
    "one process, in open or closed loop, with standard deviations, "
    "and write them as a model file. With --design, propose an experiment instead.",
)
def identify(arguments: argparse.Namespace) -> int:
    if arguments.design:
        return _design(arguments)
    if arguments.duration is not None or arguments.open_loop:
        raise CommandError("identify: --duration and --open-loop go with --design")
    if not arguments.bag:
        raise CommandError("identify: give the bag of a weld, or --design")
    if arguments.out is None:
        raise CommandError("identify: give --out FILE for the model")
    columns = _columns(arguments)
    if arguments.prior is not None and arguments.model is None:
        raise CommandError("identify: --prior is the covariance of a model; give it by --model")
    if arguments.other_type and arguments.prior is None:
        raise CommandError("identify: --other-type goes with --prior")
    check_new([arguments.out, arguments.covariance, arguments.machine], arguments.force)
    arguments.out.parent.mkdir(
        parents=True, exist_ok=True
    )  # now, because the fit may take minutes
    welds = [_weld(bag, columns) for bag in arguments.bag]
    validate, air = (
        None if bag is None else _weld(bag, columns) for bag in (arguments.validate, arguments.air)
    )
    start, lag_s = _model(arguments.model), arguments.drive_lag
    prior = None if arguments.prior is None else ParameterCovariance.from_file(arguments.prior)
    if arguments.report is not None:
        written = (arguments.out, arguments.covariance, arguments.machine)
        new_folder(arguments, "", "--report", written)
    with ProgressBar("identifying") as bar:
        result = fsw.identify(
            *welds,
            validate=validate,
            air=air,
            start=start,
            drive_lag_s=lag_s,
            steady=arguments.steady,
            prior=prior,
            other_type=arguments.other_type,
            progress=bar,
        )
    for rows in (summary.parameter_rows(result), summary.output_rows(result)):
        print_table(rows[1:], rows[0], words=1)
        print()
    print("".join(f"- {line}\n" for line in summary.remarks(result)), end="")
    write_text(arguments.out, result.text)
    files = [arguments.out]
    if arguments.covariance is not None:
        write_text(arguments.covariance, result.covariance.text)
        files.append(arguments.covariance)
    if arguments.machine is not None:
        write_text(arguments.machine, result.machine.text)
        files.append(arguments.machine)
    if arguments.report is not None:
        files += report.write(result, arguments.report, arguments.format or "png")
    print(f"written: {', '.join(map(str, files))}")
    return 0


def _columns(arguments: argparse.Namespace) -> dict[str, str]:
    """Names of a log's columns by quantity and unit; texts, whatever they would be in YAML."""
    columns = assigned("--column", arguments.column, "QUANTITY=NAME")
    sources = [*arguments.bag, *filter(None, (arguments.validate, arguments.air))]
    if columns and not any(source.suffix.lower() in TABLES for source in sources):
        raise CommandError(
            f"identify: --column is for logs ({', '.join(TABLES)}); all that is given are bags"
        )
    return columns


def _design(arguments: argparse.Namespace) -> int:
    duration_s = _DURATION_S if arguments.duration is None else arguments.duration
    if (
        arguments.bag
        or arguments.report
        or arguments.validate
        or arguments.air
        or arguments.steady
    ):
        raise CommandError(
            "identify: --design takes no bags, estimates nothing and writes no report"
        )
    if arguments.covariance or arguments.machine or arguments.prior:
        raise CommandError(
            "identify: --design estimates nothing: no covariance, no prior, no data of the machine"
        )
    check_new([arguments.out], arguments.force)
    model = _model(arguments.model)
    with ProgressBar("trying experiments") as bar:
        design = propose(duration_s, not arguments.open_loop, model, progress=bar)
    rows = [
        (name, f"{d * getattr(model, name):.2g}", f"{100.0 * d:.2f}")
        for name, d in design.deviations.items()
    ]
    print_table(rows, ("parameter", "expected std", "[%]"), words=1)
    print(
        f"moves the modelled process by {design.depth_mm:.3f} mm (bound {SAFE_MM:g}) and "
        f"{design.temperature_c:.1f} degC (bound {SAFE_C:g})"
    )
    if arguments.open_loop:
        print(
            "open loop: nothing controls depth and temperature; on a process that differs from "
            "the model they drift far beyond these bounds. Use it only with a model of this "
            "machine (--model), and supervised; otherwise use the closed-loop experiment"
        )
    if arguments.out is not None:
        write_text(arguments.out, design.scenario)
        print(f"written: {arguments.out}")
    return 0


def _model(file: Path | None) -> ModelParameters:
    return ModelParameters() if file is None else ModelParameters.from_file(file)


def _weld(bag: Path, columns: Mapping[str, str]) -> Weld:
    if bag.suffix.lower() in TABLES:
        signals = read_table(bag, columns)
        print_notes(f"{bag}: {problem}" for problem in signals.problems)
        return Weld(signals.path.stem, signals)
    return Weld(bag.name, cut_to_scenario(read_weld(bag)))
