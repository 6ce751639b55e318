"""Turns a CasADi SX function into plain Python on floats: same operations, no call overhead of CasADi."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, cast

import casadi as ca

_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
_UNARY = {ca.OP_NEG: "-{0}", ca.OP_SQ: "{0}*{0}", ca.OP_TWICE: "2.0*{0}", ca.OP_INV: "1.0/{0}", ca.OP_ASSIGN: "{0}"}
_CALLS = {
    ca.OP_SQRT: "sqrt",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_FABS: "fabs",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
}


def python_function(function: ca.Function) -> Callable[..., tuple[float, ...]]:
    """Compile an SX function to a Python function of floats.

    Parameters
    ----------
    function : casadi.Function
        SX function; dense inputs and outputs.

    Returns
    -------
    callable
        Takes all input elements as positional floats (inputs one after the other, column by column) and returns all
        output elements as one flat tuple.

    Raises
    ------
    ValueError
        If the function uses an operation that has no Python counterpart here.
    """
    offsets = [0]
    for i in range(function.n_in()):
        offsets.append(offsets[-1] + function.nnz_in(i))
    instructions = [
        (function.instruction_id(k), function.instruction_input(k), function.instruction_output(k))
        for k in range(function.n_instructions())
    ]
    uses = _uses(instructions)
    text: dict[int, str] = {}  # what stands for the present value of each work element
    results: dict[tuple[int, int], str] = {}
    lines: list[str] = []
    for k, (op, given, into) in enumerate(instructions):
        if op == ca.OP_OUTPUT:
            results[(into[0], into[1])] = text[given[0]]
            continue
        if op == ca.OP_INPUT:
            value = f"a{offsets[given[0]] + given[1]}"
        elif op == ca.OP_CONST:
            value = repr(function.instruction_constant(k))
        elif op in _BINARY:
            value = f"({text[given[0]]} {_BINARY[op]} {text[given[1]]})"
        elif op in _UNARY:
            value = "(" + _UNARY[op].format(text[given[0]]) + ")"
        elif op in _CALLS:
            value = f"{_CALLS[op]}({', '.join(text[g] for g in given)})"
        else:
            raise ValueError(f"{function.name()}: CasADi operation {op} has no Python counterpart in fsw_model.codegen")
        # what is used once stands where it is used: a name costs as much as an addition
        if uses[k] > 1 and op not in (ca.OP_INPUT, ca.OP_CONST):
            lines.append(f"v{k} = {value}")
            value = f"v{k}"
        text[into[0]] = value
    order = [(i, j) for i in range(function.n_out()) for j in range(function.nnz_out(i))]
    arguments = ", ".join(f"a{i}" for i in range(offsets[-1]))
    body = "\n    ".join([*lines, "return (" + ", ".join(results.get(key, "0.0") for key in order) + ",)"])
    namespace: dict[str, Any] = {name: getattr(math, name) for name in ("sqrt", "exp", "log", "fabs", "pow")}
    exec(compile(f"def f({arguments}):\n    {body}\n", f"<{function.name()}>", "exec"), namespace)
    return cast("Callable[..., tuple[float, ...]]", namespace["f"])


def _uses(instructions: list[tuple[int, list[int], list[int]]]) -> list[int]:
    """How often the value that each instruction computes is read; a square reads it twice."""
    uses = [0] * len(instructions)
    computed: dict[int, int] = {}
    for k, (op, given, into) in enumerate(instructions):
        if op not in (ca.OP_INPUT, ca.OP_CONST):
            for g in given:
                uses[computed[g]] += 2 if op == ca.OP_SQ else 1
        if op != ca.OP_OUTPUT:
            computed[into[0]] = k
    return uses
