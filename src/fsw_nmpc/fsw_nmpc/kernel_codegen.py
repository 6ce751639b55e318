"""Writes the kernel's generated files: the torque function and the struct of the tuning.

Run ``python -m fsw_nmpc.kernel_codegen`` after a change of the torque equations (19)-(22) or of
the tuning's fields.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import casadi as ca

from fsw_model import ModelParameters, equations
from fsw_model.functions import plain_c
from fsw_nmpc import tuning_struct
from fsw_nmpc.library import TORQUE_PARAMETERS


def torque_function() -> ca.Function:
    """CasADi function (force_kn, depth_mm, parameters (6)) -> (torque N m, by force, by depth)."""
    force, depth = ca.SX.sym("force_kn"), ca.SX.sym("depth_mm")
    par = ca.SX.sym("parameters", len(TORQUE_PARAMETERS))
    named = SimpleNamespace(**{name: par[i] for i, name in enumerate(TORQUE_PARAMETERS)})
    torque = equations.process_torque_nm(cast(ModelParameters, named), force, depth)
    out = ca.vertcat(torque, ca.gradient(torque, force), ca.gradient(torque, depth))
    return ca.Function("fsw_torque_casadi", [force, depth, par], [ca.cse(out)])


def generate() -> str:
    """The C99 text of the torque function."""
    return plain_c(
        "fsw_model/equations.py", "fsw_nmpc/kernel_codegen.py", "internal.h", torque_function()
    )


def files() -> dict[Path, str]:
    """The generated files with their content."""
    folder = Path(__file__).parent / "kernel"
    return {folder / "torque.c": generate(), folder / "fsw_nmpc_tuning.h": tuning_struct.header()}


if __name__ == "__main__":
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path.name}", file=sys.stderr)
