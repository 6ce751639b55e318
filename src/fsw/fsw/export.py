"""``fsw.py export``: controllers and plant for use outside ROS 2."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import yaml

from fsw.errors import CommandError
from fsw.progress import ProgressBar
from fsw.simulate import assignment
from fsw_control.contract import Controller
from fsw_control.parameters import ParameterError
from fsw_control.yaml_text import load_yaml
from fsw_decentral import DecentralController
from fsw_model import ModelParameters, OperatingPointError, ProcessModel, nominal
from fsw_nmpc import NmpcController
from fsw_scenario.controllers import make
from fsw_scenario.scenario_file import parse

#: A weld of 240 s in which everything happens that a controller must bear; set-points are relative to the model's.
_WELD = """
name: test_vectors
description: Set-points, announced, disturbances and sensor faults.
duration_s: 240.0
controller: {controller}
announced: true
plant: {{model_file: '{model}', start: {{depth_mm: {depth}, temperature_c: {temperature}}}, seed: 5}}
events:
  - {{at_s: 10.0, reference: {{depth_mm: {deeper}}}}}
  - {{at_s: 30.0, fault: {{sensor: depth, kind: dropout, duration_s: 1.0}}}}
  - {{at_s: 50.0, reference: {{depth_mm: {depth}, temperature_c: {hotter}}}}}
  - {{at_s: 90.0, disturbance: {{channel: depth, shape: step, amplitude_mm: 0.05}}}}
  - {{at_s: 110.0, fault: {{sensor: torque, kind: nan, duration_s: 3.0}}}}
  - {{at_s: 130.0, disturbance: {{channel: axial_force, shape: step, amplitude_kn: 1.0}}}}
  - {{at_s: 150.0, fault: {{sensor: thermocouple, kind: freeze, duration_s: 5.0}}}}
  - {{at_s: 170.0, disturbance: {{channel: temperature, shape: step, amplitude_c: -5.0}}}}
  - {{at_s: 200.0, reference: {{temperature_c: {temperature}}}}}
"""


#: of the proposals of that weld, which has sensor faults
_HEALTHY_SHARE = 0.95


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parser = commands.add_parser(
        "export",
        help="a controller as C99 for a PLC, a controller or the plant as an FMU",
        description="Export controllers and plant for use outside ROS 2.",
    )
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", required=True)
    c = kinds.add_parser(
        "c",
        help="a controller as a self-contained folder of C99",
        description="Write a folder with a controller in C99: sources, tables, example, test vectors of a simulated "
        "weld, function block, README. The example is compiled and run before the folder is put in place.",
    )
    c.add_argument("--controller", choices=["nmpc", "decentral"], default="nmpc", help="which one (default nmpc)")
    _add_parameters(c, "parameter of the controller's node; may be repeated, e.g. temperature_aggressiveness=0.5")
    c.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    c.add_argument("--force", action="store_true", help="delete an earlier export that is there")
    c.set_defaults(run=_run_c)
    fmu = kinds.add_parser(
        "fmu",
        help="the plant or a controller as a Functional Mock-up Unit (FMI 2.0, co-simulation)",
        description="Write a Functional Mock-up Unit: FMI 2.0 for co-simulation with a fixed step of 0.1 s, with "
        "sources and a binary for this machine. Prints its variables.",
    )
    fmu.add_argument("unit", metavar="UNIT", help="plant, nmpc or decentral")
    _add_parameters(fmu, "parameter of the plant or of the controller's node; may be repeated, e.g. start.depth_mm=2.8")
    fmu.add_argument("--out", type=Path, required=True, metavar="FILE.fmu", help="file to write")
    fmu.add_argument("--force", action="store_true", help="replace the file if it exists")
    fmu.add_argument(
        "--platform",
        action="append",
        default=[],
        choices=["linux64", "win64"],
        help="also a binary for this platform, by zig's compiler; may be repeated",
    )
    fmu.set_defaults(run=_run_fmu)


def _add_parameters(kind: argparse.ArgumentParser, parameter: str) -> None:
    """Add the options that say which model, tuning and parameters are exported; ``parameter`` is a help text."""
    kind.add_argument("--model", type=Path, metavar="FILE", help="model parameters (YAML) instead of the paper's")
    kind.add_argument("--tuning", type=Path, metavar="FILE", help="tuning (YAML) instead of the default one")
    kind.add_argument("--parameter", action="append", default=[], metavar="NAME=VALUE", help=parameter)


def _model(path: Path | None) -> ModelParameters:
    return nominal() if path is None else ModelParameters.from_file(path)


def _run_c(arguments: argparse.Namespace) -> int:
    from fsw_export.c_folder import ExportError, check_folder, write_folder
    from fsw_export.c_library import decentral_sources, nmpc_sources
    from fsw_export.vectors import VectorRecorder, with_faults

    try:
        check_folder(arguments.out, arguments.force)
    except ExportError as error:
        raise CommandError(f"export c: {error}") from None
    model = _model(arguments.model)
    controller = _controller(arguments, model)
    if isinstance(controller, NmpcController):
        sources = nmpc_sources(controller.library, controller.settings)
    else:
        sources = decentral_sources(controller.library)
    with VectorRecorder(controller.library, sources.inputs, sources.outputs) as weld:
        _weld(controller, model, arguments.model)
    if weld.healthy() < _HEALTHY_SHARE * len(weld.answers):
        raise CommandError(
            f"export c: in the weld of the test vectors only {weld.healthy()} of {len(weld.answers)} proposals were "
            "healthy: this controller cannot hold this model; check model and tuning"
        )
    vectors = {"weld": weld, "faults": with_faults(weld)}
    try:
        said = write_folder(sources, vectors, _origin(arguments), arguments.out, arguments.force)
    except ExportError as error:
        raise CommandError(f"export c: {error}") from None
    print(said)
    print(f"{arguments.out}: README.md, src, test vectors")
    return 0


def _run_fmu(arguments: argparse.Namespace) -> int:
    from fsw_export import fmu
    from fsw_export.c_folder import ExportError
    from fsw_export.fmu_description import table

    if arguments.unit == "plant" and arguments.tuning is not None:
        raise CommandError("export fmu: the plant has no tuning; leave out --tuning")
    try:
        fmu.check_file(arguments.out, arguments.force)
        model = _model(arguments.model)
        content = fmu.make(arguments.unit, _parameters(arguments.unit, arguments, model), model)
        fmu.write(content, arguments.out, arguments.force, arguments.platform)
    except (ValueError, ExportError) as error:
        raise CommandError(f"export fmu: {error}") from None
    print(table(content))
    print(f"{arguments.out}: {len(content.variables)} variables, {arguments.out.stat().st_size / 1000:.0f} kB")
    return 0


def _parameters(unit: str, arguments: argparse.Namespace, model: ModelParameters) -> dict[str, Any]:
    """Parameters of a controller's node or of the plant, from model, tuning and parameters of the command line."""
    parameters = dict(assignment("--parameter", text) for text in arguments.parameter)
    if unit == "decentral":
        return _of_spindle(model) | _gains(arguments.tuning) | parameters
    for name, path in (("model_file", arguments.model), ("tuning_file", arguments.tuning)):
        if path is not None:
            parameters[name] = str(path)
    return parameters


def _controller(arguments: argparse.Namespace, model: ModelParameters) -> NmpcController | DecentralController:
    """The controller with model, tuning and parameters of the command line."""
    controller = make(arguments.controller, _parameters(arguments.controller, arguments, model))
    if isinstance(controller, NmpcController) and controller.solver is None:
        return controller
    if isinstance(controller, DecentralController):
        return controller
    raise CommandError("export: solver must be rti, the library's own")


def _of_spindle(model: ModelParameters) -> dict[str, Any]:
    """What the decentralized controller knows of the process, as parameters of its node."""
    return {
        "friction.constant": model.friction_constant_nm,
        "friction.linear": model.friction_linear_nm_per_rpm,
        "friction.quadratic": model.friction_quadratic_nm_per_rpm2,
        "spindle_inertia": model.spindle_inertia_kgm2,
        "nominal_torque": ProcessModel(model).equilibrium().outputs.process_torque_nm,
    }


def _gains(path: Path | None) -> dict[str, Any]:
    """Parameters of the decentralized controller's node from a YAML file."""
    if path is None:
        return {}
    try:
        content = load_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CommandError(f"cannot read tuning {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise CommandError(f"{path}: not valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise CommandError(f"{path}: must map names of parameters to values, e.g. depth_gain: 120.0")
    return content


def _origin(arguments: argparse.Namespace) -> str:
    """Model and tuning in words."""
    model = f"model `{arguments.model.name}`" if arguments.model is not None else "the paper's model"
    default = "default tuning" + " but for" * bool(arguments.parameter)
    tuning = f"tuning `{arguments.tuning.name}`" if arguments.tuning is not None else default
    return ", ".join([model, tuning, *(f"`{text}`" for text in arguments.parameter)])


def _weld(controller: Controller, model: ModelParameters, file: Path | None) -> None:
    """Let the controller weld on a plant that is like its model."""
    from fsw_scenario.closed_loop import ClosedLoop

    depth, temperature = model.operating_depth_mm, model.operating_temperature_c
    text = _WELD.format(
        controller=controller.name,
        model="" if file is None else file,
        depth=depth,
        deeper=depth + 0.1,
        temperature=temperature,
        hotter=temperature + 5.0,
    )
    try:
        loop = ClosedLoop(parse(text, "the weld of the test vectors"), {controller.name: controller})
    except (OperatingPointError, ParameterError) as error:
        raise CommandError(f"export: cannot weld with this model: {error}") from None
    with ProgressBar("weld of the test vectors") as bar:
        loop.run(bar)
