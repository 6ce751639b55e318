"""``fsw schema``: JSON Schema of a kind of file, for completion and checks in editors."""

from __future__ import annotations

import argparse
import json

from fsw.command import command, option
from fsw_control.schema.extensions import extensions, loaded
from fsw_control.schema.models import json_schema

#: entry points: models by kind of file
GROUP = "fsw.schemas"


def kinds() -> list[str]:
    """Kinds of files with a model in the installed distributions."""
    return list(extensions(GROUP))


def schema_text(kind: str) -> str:
    """JSON Schema of a kind of file, as JSON."""
    return json.dumps(json_schema(loaded(GROUP, kind)), indent=2) + "\n"


@command(
    "schema",
    "print the JSON Schema of a kind of file, for editors",
    option("file", choices=kinds(), metavar="FILE", help=f"kind of file: {', '.join(kinds())}"),
)
def schema(arguments: argparse.Namespace) -> int:
    print(schema_text(arguments.file), end="")
    return 0
