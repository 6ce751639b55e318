"""C99 code of CasADi functions, for the kernels."""

from __future__ import annotations

import re
import tempfile
import textwrap
from pathlib import Path

import casadi as ca

#: CasADi's version in the generated text; others generate different code
WRITER = f"Written by CasADi {ca.CasadiMeta.version()}."


def c_text(name: str, *functions: ca.Function) -> str:
    """C text of CasADi functions, as in a file ``<name>.c``."""
    generator = ca.CodeGenerator(
        name, {"casadi_int": "int", "casadi_real": "double", "with_header": False}
    )
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        return Path(generator.generate(f"{folder}/")).read_text(encoding="utf-8")


def plain_c(source: str, writer: str, header: str, *functions: ca.Function) -> str:
    """C text of ``int NAME(const double **arg, double **res)`` without CasADi's wrappers.

    Its header comment names ``source`` and the generator ``writer``; it includes ``header``.
    """
    text = c_text("functions", *functions)
    bodies = re.findall(r"static int casadi_f\d+\(.*?\) \{\n(.*?)\n\}\n", text, re.DOTALL)
    square = re.search(r"casadi_real casadi_sq\(.*?\n", text)
    if len(bodies) != len(functions) or square is None:
        raise RuntimeError("CasADi writes its functions in another way than this script knows")
    code = f"static {square[0]}"
    for function, body in zip(functions, bodies, strict=True):
        # all arguments and results are always given
        body = re.sub(r"arg\[\d+\]\? (\S+) : 0", r"\1", body)
        body = re.sub(r"if \(res\[\d+\]!=0\) ", "", body)
        packed = textwrap.fill(
            " ".join(body.split()), 97, initial_indent="  ", subsequent_indent="  "
        )
        code += f"\nint {function.name()}(const double **arg, double **res) {{\n{packed}\n}}\n"
    return (
        f"/* Generated from {source} by {writer}; do not edit. */\n"
        f"/* {WRITER} */\n"
        f'#include "{header}"\n\n' + code.replace("casadi_real", "double")
    )
