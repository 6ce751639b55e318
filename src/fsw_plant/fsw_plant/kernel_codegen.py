"""Writes the process's equations as C, ``kernel/equations.c``.

Run ``python -m fsw_plant.kernel_codegen`` after a change of the equations.
"""

from __future__ import annotations

from pathlib import Path

from fsw_model.functions import general_functions, plain_c

PATH = Path(__file__).parent / "kernel" / "equations.c"


def generate() -> str:
    """The C99 text."""
    names = "fsw_model/equations.py", "fsw_plant/kernel_codegen.py", "equations.h"
    return plain_c(*names, *general_functions())


if __name__ == "__main__":
    PATH.write_text(generate(), encoding="utf-8")
