"""``fsw schema``: the JSON Schema of a kind of file, by which an editor completes and checks it."""

from __future__ import annotations

import argparse
import json
from importlib import import_module

from fsw.command import command, option
from fsw_schema.models import json_schema

#: module and model of each kind of file
FILES = {
    "attestation": ("fsw_quality.attestation", "Attestation"),
    "campaign": ("fsw_campaign.definition", "Campaign"),
    "machine": ("fsw_machine.machine_file", "MachineFile"),
    "manifest": ("fsw_recorder.manifest", "Manifest"),
    "model": ("fsw_model", "ModelParameters"),
    "procedure": ("fsw_analysis.procedure", "Procedure"),
    "record": ("fsw_quality.record", "Record"),
    "scenario": ("fsw_scenario.scenario", "Scenario"),
    "tuning": ("fsw_nmpc.tuning", "Tuning"),
}


def schema_text(name: str) -> str:
    """JSON Schema of a kind of file, as JSON."""
    module, model = FILES[name]
    return json.dumps(json_schema(getattr(import_module(module), model)), indent=2) + "\n"


@command(
    "schema",
    "print the JSON Schema of a kind of file, for editors",
    option("file", choices=sorted(FILES), metavar="FILE", help=f"kind of file: {', '.join(sorted(FILES))}"),
)
def schema(arguments: argparse.Namespace) -> int:
    print(schema_text(arguments.file), end="")
    return 0
