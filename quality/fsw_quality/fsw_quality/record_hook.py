"""What runs after the recording of a weld by a procedure.

The command that writes its record into the bag's folder.
"""

from __future__ import annotations

import sys

from fsw_control.schema.extensions import Extra

#: what writes the PDF
PDF = Extra("fsw-quality", "pdf", ("fpdf",))


def command(bag: str, procedure: str) -> list[str]:
    """Words of the command for a bag and a procedure's file.

    A clone gets what writes the PDF before the weld.
    """
    PDF.missing()
    words = "record", bag, "--procedure", procedure, "--out", f"{bag}/record"
    return [sys.executable, "-m", "fsw.main", *words]
