"""``fsw.py procedure``: welding procedures, checked, shown and compared."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

from fsw.command import (
    FORCE,
    PRIVATE_KEY,
    REQUIRE_SIGNED,
    TRUSTED,
    command,
    group,
    option,
    private_key,
    trusted_keys,
)
from fsw.console import check_new, print_table, write_text
from fsw_analysis.procedure import Procedure
from fsw_control.schema.files import read_regular
from fsw_control.schema.models import content_of, validate
from fsw_recorder.signature import Purpose, sign, signature_path
from fsw_scenario.procedure import (
    check_possible,
    differences,
    load,
    node_parameters,
    shipped,
    signer_of,
)

PROCEDURE = group(
    "procedure",
    "check, sign, show and compare welding procedures",
    "Check, sign, show and compare welding procedures: the limits that a weld must keep, as data.",
)
_NAME = f"YAML file, or one of {', '.join(shipped())}"


@command(
    "procedure check",
    "whether a procedure can be used; prints its identity and hash",
    option("procedure", help=_NAME),
    TRUSTED,
    REQUIRE_SIGNED,
)
def check(arguments: argparse.Namespace) -> int:
    procedure = load(arguments.procedure)
    signer = signer_of(
        arguments.procedure, trusted_keys(arguments) or None, arguments.require_signed
    )
    node_parameters(procedure)
    check_possible(procedure)
    print(_identity(procedure))
    print(f"signed by {signer.words}" if signer else "not signed")
    return 0


@command(
    "procedure sign",
    "sign a procedure, so that every command that reads it detects a later change",
    option("procedure", type=Path, help="YAML file"),
    PRIVATE_KEY,
    FORCE,
    description="sign: write FILE.sig, by which every command detects a later change.",
)
def signed(arguments: argparse.Namespace) -> int:
    path: Path = arguments.procedure
    target = signature_path(path)
    check_new([target], arguments.force)
    data = read_regular(path)
    procedure = validate(
        Procedure, content_of(data.decode("utf-8", "replace"), str(path)), str(path)
    )
    write_text(
        target, sign(data, path.name, Purpose.PROCEDURE, private_key(arguments), datetime.now(UTC))
    )
    print(f"{_identity(procedure)}\nsignature: {target}")
    return 0


def _identity(procedure: Procedure) -> str:
    return (
        f"{procedure.id} revision {procedure.revision} of {procedure.date}, "
        f"SHA-256 {procedure.sha256}"
    )


@command(
    "procedure show",
    "all of a procedure, with the source of each figure",
    option("procedure", help=_NAME),
)
def show(arguments: argparse.Namespace) -> int:
    procedure = load(arguments.procedure)
    print(f"{procedure.title}\n{_identity(procedure)}\n")
    material, joint = procedure.material, procedure.geometry
    tool, machine = procedure.tool, procedure.machine
    probe, shoulder = f"probe {tool.probe_length_mm:g} mm", f"{tool.shoulder_diameter_mm:g} mm"
    shape = f"{probe}, shoulder {shoulder}, {tool.shoulder}"
    rows = [
        ("material", f"{material.name}, {material.thickness_mm:g} mm", material.source),
        ("joint", f"{joint.joint}, {joint.diameter_mm:g} mm", joint.source),
        ("tool", f"{tool.id or 'any'}: {shape}", tool.source),
        ("machine", f"{machine.name}, {machine.traverse_mm_per_min:g} mm/min", machine.source),
    ]
    for name in ("depth_mm", "temperature_c"):
        point = getattr(procedure.set_points, name)
        words = f"{point.value:g}, permitted {point.min:g} to {point.max:g}"
        rows.append((f"set-point {name}", words, point.source))
    rows += [(kind, limit.words, limit.source) for kind, limit in procedure.limits()]
    for phase in procedure.phases:
        end = f"{phase.duration_s:g} s" if phase.to_deg is None else f"to {phase.to_deg:g} deg"
        rows.append((f"phase {phase.name}", end, phase.source))
    rows += [
        ("controller", row.name, f"parameters {row.parameters_sha256 or 'any'}")
        for row in procedure.controllers
    ]
    rows += [
        ("sensor", row.name, f"calibration due {row.calibration_due or 'not given'}")
        for row in procedure.sensors
    ]
    data = procedure.weld_data
    rows += [("weld data", *row) for row in data.labelled] if data else []
    accepted = procedure.acceptance
    swaps = "swaps on request allowed" if accepted.swaps_allowed else "a swap is for review"
    rows.append(("acceptance", f"tolerated {accepted.tolerated_s:g} s; {swaps}", accepted.source))
    print_table(rows, ("what", "figure", "source"))
    return 0


@command(
    "procedure diff",
    "what differs between two procedures; exit code 1 when anything does",
    option("old", help=_NAME),
    option("new", help=_NAME),
)
def diff(arguments: argparse.Namespace) -> int:
    old, new = load(arguments.old), load(arguments.new)
    changes = differences(old, new)
    if not changes:
        print("no difference")
        return 0
    print_table(changes, ("where", arguments.old, arguments.new))
    if (old.id, old.revision) == (new.id, new.revision):
        note = f"note: both are {old.id} revision {old.revision}: give one a new revision"
        print(note, file=sys.stderr)
    return 1
