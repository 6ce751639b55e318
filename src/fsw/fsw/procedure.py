"""``fsw.py procedure``: welding procedures, checked, shown and compared."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.console import print_table
from fsw.errors import CommandError
from fsw.keys import add_private_key, private_key
from fsw.options import add_force
from fsw.outputs import check_new, write_text
from fsw_control.parameters import defaults
from fsw_control.parameters import load as load_parameters
from fsw_quality.procedure import Procedure, differences, load, shipped
from fsw_quality.procedure_limits import check_possible, node_parameters
from fsw_quality.signature import load_private, load_public, sign, signature_path, verify_file
from fsw_schema.models import content_of, validate


def add_command(commands: Any) -> None:
    """Add the command and its subcommands to the parser's."""
    parser = commands.add_parser(
        "procedure",
        help="check, sign, show and compare welding procedures",
        description="Check, sign, show and compare welding procedures: the limits that a weld must keep, as data.",
    )
    verbs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    name = f"YAML file, or one of {', '.join(shipped())}"
    for verb, run, text, files in (
        ("check", _check, "whether a procedure can be used; prints its identity and hash", ("procedure",)),
        ("show", _show, "all of a procedure, with the source of each figure", ("procedure",)),
        ("diff", _diff, "what differs between two procedures; exit code 1 when anything does", ("old", "new")),
    ):
        one = verbs.add_parser(verb, help=text, description=f"{verb}: {text}.")
        for file in files:
            one.add_argument(file, help=name)
        if verb == "check":
            text = "public key by which it must be signed; may be repeated (default: a signature is optional)"
            one.add_argument("--key", type=Path, action="append", metavar="FILE.pub", default=[], help=text)
        one.set_defaults(run=run)
    text = "sign a procedure, so that a later change is told by everything that reads it"
    signing = verbs.add_parser("sign", help=text, description=f"sign: {text}. Writes FILE.sig beside it.")
    signing.add_argument("procedure", type=Path, help="YAML file")
    add_private_key(signing)
    add_force(signing)
    signing.set_defaults(run=_sign)


def _check(arguments: argparse.Namespace) -> int:
    procedure = load(arguments.procedure)
    signer = verify_file(Path(arguments.procedure), [load_public(path) for path in arguments.key] or None)
    if arguments.key and signer is None:
        raise CommandError(f"{arguments.procedure}: is not signed; 'fsw.py procedure sign' signs it")
    node_parameters(procedure, defaults(load_parameters("fsw_supervisor", "supervisor.yaml")))
    check_possible(procedure)
    print(_identity(procedure))
    print(f"signed by key {signer.fingerprint}" if signer else "not signed")
    return 0


def _sign(arguments: argparse.Namespace) -> int:
    path: Path = arguments.procedure
    target = signature_path(path)
    check_new([target], arguments.force)
    data = path.read_bytes()
    procedure = validate(Procedure, content_of(data.decode("utf-8", "replace"), str(path)), str(path))
    write_text(target, sign(data, load_private(private_key(arguments))))
    print(f"{_identity(procedure)}\nsignature: {target}")
    return 0


def _identity(procedure: Procedure) -> str:
    return f"{procedure.id} revision {procedure.revision} of {procedure.date}, SHA-256 {procedure.sha256}"


def _show(arguments: argparse.Namespace) -> int:
    procedure = load(arguments.procedure)
    print(f"{procedure.title}\n{_identity(procedure)}\n")
    tool, machine = procedure.tool, procedure.machine
    shape = f"probe {tool.probe_length_mm:g} mm, shoulder {tool.shoulder_diameter_mm:g} mm, {tool.shoulder}"
    rows = [
        ("material", f"{procedure.material.name}, {procedure.material.thickness_mm:g} mm", procedure.material.source),
        ("joint", f"{procedure.geometry.joint}, {procedure.geometry.diameter_mm:g} mm", procedure.geometry.source),
        ("tool", f"{tool.id or 'any'}: {shape}", tool.source),
        ("machine", f"{machine.name}, {machine.traverse_mm_per_min:g} mm/min", machine.source),
    ]
    for name, point in (
        ("depth_mm", procedure.set_points.depth_mm),
        ("temperature_c", procedure.set_points.temperature_c),
    ):
        rows.append((f"set-point {name}", f"{point.value:g}, permitted {point.min:g} to {point.max:g}", point.source))
    rows += [(kind, limit.words, limit.source) for kind, limit in procedure.limits()]
    for phase in procedure.phases:
        end = f"{phase.duration_s:g} s" if phase.to_deg is None else f"to {phase.to_deg:g} deg"
        rows.append((f"phase {phase.name}", end, phase.source))
    rows += [("controller", one.name, f"parameters {one.parameters_sha256 or 'any'}") for one in procedure.controllers]
    rows += [("sensor", one.name, f"calibration due {one.calibration_due or 'not given'}") for one in procedure.sensors]
    accepted = procedure.acceptance
    swaps = "swaps on request allowed" if accepted.swaps_allowed else "a swap is for review"
    rows.append(("acceptance", f"tolerated {accepted.tolerated_s:g} s; {swaps}", accepted.source))
    print_table(rows, ("what", "figure", "source"))
    return 0


def _diff(arguments: argparse.Namespace) -> int:
    found = differences(load(arguments.old), load(arguments.new))
    if not found:
        print("no difference")
        return 0
    print_table(found, ("where", arguments.old, arguments.new))
    return 1
