"""What the core finds here by entry points, without loading the rest.

The command that runs after the recording of a weld by a procedure and writes its record into the
bag's folder; the page of the history beside the operator's.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from fsw_control.schema.extensions import Extra
from fsw_control.schema.models import read_text

#: what writes the PDF
PDF = Extra("fsw-quality", "pdf", ("fpdf",))
_STYLE = re.compile("<style>.*?</style>", re.DOTALL)


def command(bag: str, procedure: str) -> list[str]:
    """Words of the command for a bag and a procedure's file.

    A clone gets what writes the PDF before the weld.
    """
    PDF.missing()
    words = "record", bag, "--procedure", procedure, "--out", f"{bag}/record"
    return [sys.executable, "-m", "fsw.main", *words]


def history_page(folder: Path) -> str:
    """HTML of the report that ``fsw.py history report`` has written to the folder of a history.

    Its style is the operator's page's, whose content security policy permits no other.

    Raises
    ------
    fsw_control.schema.models.InputError
        If there is no report.
    """
    text = read_text(folder / "report.html", "history")
    return _STYLE.sub('<link rel="stylesheet" href="../page/report.css">', text, count=1)
