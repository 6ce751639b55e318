"""The equations of :mod:`fsw_model.equations` as CasADi functions, and as C.

Plant and controllers run C that is generated from them, so that a weld does not need CasADi.
"""

from __future__ import annotations

import re
import tempfile
import textwrap
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca

from fsw_model import equations
from fsw_model.equations import (
    COPPER,
    CREEP,
    FAST,
    MOTOR,
    N_POWER,
    N_STATES,
    SLOW,
    SPANS_S,
    STEP_S,
    TOOL,
    depth_mm,
    depth_modes,
    friction_torque_nm,
    mode_numbers,
    numbers_of,
    power_kw,
    process_torque_nm,
    thermal_block,
    thermal_numbers,
)
from fsw_model.parameters import ModelParameters, nominal


def output_function(p: ModelParameters, *numbers: ca.SX) -> ca.Function:
    """CasADi function (x, force_kn, speed_rpm) -> outputs of the process.

    If ``p`` has the entries of a vector of numbers instead of floats, that is a further argument.
    """
    x = ca.SX.sym("x", N_STATES)
    force, speed = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")
    found = equations.outputs(p, x, force, speed)
    names = ["x", "force_kn", "speed_rpm", *(["numbers"] * len(numbers))]
    return ca.Function(
        "process_outputs", [x, force, speed, *numbers], list(found.values()), names, list(found)
    )


def dynamics_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, arriving_kw, force_kn, speed_rpm) -> dx/dt; the power is delayed."""
    x = ca.SX.sym("x", N_STATES)
    arriving, force, speed = (
        ca.SX.sym("arriving_kw"),
        ca.SX.sym("force_kn"),
        ca.SX.sym("speed_rpm"),
    )
    poles, gains = depth_modes(p)
    a, b = thermal_block(p)
    depth = depth_mm(p, x[CREEP], x[SLOW], x[FAST], x[TOOL])
    modes = ca.DM(poles) * x[:3] + ca.DM(gains) * (force - p.operating_force_kn)  # (17), (25)
    thermal = ca.DM(a) @ x[COPPER : TOOL + 1] + ca.DM(b) * arriving  # (16)
    static = process_torque_nm(p, force, depth) + friction_torque_nm(p, speed)
    motor = (static - x[MOTOR]) / p.motor_lag_s  # (18)
    names = ["x", "arriving_kw", "force_kn", "speed_rpm"]
    return ca.Function(
        "dynamics",
        [x, arriving, force, speed],
        [ca.vertcat(modes, thermal, motor)],
        names,
        ["dx_dt"],
    )


def slopes_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, arriving_kw, (force, speed)) -> slopes of dx/dt, power and outputs.

    In the order of the first six fields of :class:`fsw_model.process.Linearisation`.
    """
    x, inputs, arriving = ca.SX.sym("x", N_STATES), ca.SX.sym("u", 2), ca.SX.sym("arriving")
    dynamics = dynamics_function(p)(x, arriving, inputs[0], inputs[1])
    shown = output_function(p)(x, inputs[0], inputs[1])
    outputs, power = ca.vertcat(shown[0], shown[1], shown[3]), shown[6]
    return ca.Function(
        "slopes",
        [x, arriving, inputs],
        [
            ca.jacobian(dynamics, x), ca.jacobian(dynamics, inputs),
            ca.jacobian(dynamics, arriving), ca.jacobian(power, x),
            ca.jacobian(power, inputs), ca.jacobian(outputs, x),
        ],
    )  # fmt: skip


def step_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, older power (4), newer power (4), force, speed) -> next step.

    The results are (x next, power (4), depth). ``older`` and ``newer`` are the powers of the two
    past steps that arrive during this one (``thermal_step``); the returned power goes to the end
    of that queue. The dead time is at least a step, so the temperature within the step is known
    beforehand, and the step is explicit. The linear blocks are exact. In (18) only the process
    torque is approximated, by the parabola through its values at start, middle and end; the depth
    jump that settles with the fast pole is separated from it and passed through (18) exactly, to
    first order in the jump.
    """
    matrices = {name: ca.sparsify(ca.DM(m)) for name, m in thermal_numbers(p).items()}
    numbers = mode_numbers(p) | matrices
    x = ca.SX.sym("x", N_STATES)
    older, newer = ca.SX.sym("older_kw", N_POWER), ca.SX.sym("newer_kw", N_POWER)
    force, speed = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")
    warm = _warmed(numbers, x, older, newer)
    x_next, power, depth = _stepped(p, numbers, x, warm, force, speed)
    names = ["x", "older_kw", "newer_kw", "force_kn", "speed_rpm"]
    return ca.Function(
        "process_step",
        [x, older, newer, force, speed],
        [x_next, power, depth],
        names,
        ["x_next", "power_kw", "depth_mm"],
    )


def _warmed(numbers: Mapping[str, Any], x: ca.SX, older: ca.SX, newer: ca.SX) -> ca.SX:
    """Tool in the middle of a step, copper and tool at its end, by (16)."""

    def later(name: str) -> ca.SX:
        kept = numbers[f"kept_{name}"] @ ca.vertcat(x[COPPER], x[TOOL])
        return kept + numbers[f"older_{name}"] @ older + numbers[f"newer_{name}"] @ newer

    return ca.vertcat(later("half")[1], later("whole"))


def general_functions() -> tuple[ca.Function, ...]:
    """Temperatures after a step, by two models; the step; outputs.

    The last argument of each is :func:`numbers_of`. The temperatures are (tool in the middle,
    copper and tool at the end): by (16), from the powers of two past steps, or by the tool's lag
    alone, from another model's copper at start and end as the tool meets it. That includes the
    dead time and is linear within the step, which the lag follows exactly; the copper in ``x`` is
    not changed. The step also gives its mean power.
    """
    p = nominal()
    vector = ca.SX.sym("numbers", len(numbers_of(p)))
    entries = iter(ca.vertsplit(vector))
    fields = cast(
        ModelParameters, SimpleNamespace(**dict(zip(p.model_dump(), entries, strict=False)))
    )
    numbers: dict[str, Any] = dict(zip(mode_numbers(p), entries, strict=False))
    for name, matrix in thermal_numbers(p).items():
        rows, columns = matrix.shape
        numbers[name] = ca.vertcat(
            *(ca.horzcat(*(next(entries) for _ in range(columns))) for _ in range(rows))
        )
    x, warm = ca.SX.sym("x", N_STATES), ca.SX.sym("warm_c", 3)
    past, copper = [ca.SX.sym(name, N_POWER) for name in ("older", "newer")], ca.SX.sym("met_c", 2)
    inputs = [ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")]
    rate, lag = (copper[1] - copper[0]) / STEP_S, fields.tool_lag_s
    behind = x[TOOL] - copper[0] + rate * lag
    middle, end = (
        copper[0] + rate * (span_s - lag) + behind * ca.exp(-span_s / lag)
        for span_s in SPANS_S.values()
    )
    x_next, power, depth = _stepped(fields, numbers, x, warm, *inputs)
    faded = fields.motor_lag_s / STEP_S * (1.0 - numbers["motor_kept"])
    mean = (
        fields.operating_power_kw + power[0] + power[1] / 2.0 + power[2] / 3.0 + power[3] * faded
    )
    parts: dict[str, tuple[list[ca.SX], list[ca.SX]]] = {
        "process_heat": ([x, *past], [_warmed(numbers, x, *past)]),
        "process_met": ([x, copper], [ca.vertcat(middle, x[COPPER], end)]),
        "process_step": ([x, warm, *inputs], [x_next, power, depth, mean]),
    }
    made = (ca.Function(name, [*ins, vector], ca.cse(outs)) for name, (ins, outs) in parts.items())
    return (*made, output_function(fields, vector))


def _stepped(
    p: ModelParameters,
    numbers: Mapping[str, Any],
    x: ca.SX,
    warm: ca.SX,
    force: ca.SX,
    speed: ca.SX,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """State and depth after a step, and power in it.

    ``numbers`` are :func:`mode_numbers`; ``warm`` is the tool in the middle, then copper and tool
    at the end.
    """
    creep, slow, fast, _, tool, motor = ca.vertsplit(x)
    pushed = force - p.operating_force_kn  # (25)
    settled = numbers["settled_mm_per_kn"] * pushed  # steady state of the fast mode

    def later(name: str, tool_then: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Modes creep and slow, and the depth after the fast mode has settled."""
        slow_then = numbers[f"slow_kept_{name}"] * slow + numbers[f"slow_{name}"] * pushed
        creep_then = creep + numbers[f"creep_{name}"] * pushed
        return creep_then, slow_then, depth_mm(p, creep_then, slow_then, settled, tool_then)

    *_, depth_middle = later("half", warm[0])
    creep_end, slow_end, depth_end = later("whole", warm[2])
    depth_start = depth_mm(p, creep, slow, settled, tool)
    start, middle, end = (
        process_torque_nm(p, force, d) for d in (depth_start, depth_middle, depth_end)
    )
    friction = friction_torque_nm(p, speed)

    # (18): motor torque = q0 + q1 (s/h) + q2 (s/h)^2 + rest exp(-s / lag)
    lag = numbers["motor_lag_steps"]
    q2 = 2.0 * start - 4.0 * middle + 2.0 * end
    q1 = -3.0 * start + 4.0 * middle - end - 2.0 * lag * q2
    q0 = start + friction - lag * q1
    depth_symbol = ca.SX.sym("depth")
    by_depth = ca.substitute(
        ca.gradient(process_torque_nm(p, force, depth_symbol), depth_symbol),
        depth_symbol,
        depth_start,
    )
    jump = by_depth * (1.0 + p.softening_per_c * tool) * (fast - settled)
    rest = motor - q0 + jump / numbers["jump_ratio"]
    motor_end = q0 + q1 + q2 + rest * numbers["motor_kept"]
    fast_end = settled + (fast - settled) * numbers["fast_kept"]
    power = power_kw(ca.vertcat(q0 - friction, q1, q2, rest), speed)
    power[0] -= p.operating_power_kw  # (24)
    return (
        ca.vertcat(creep_end, slow_end, fast_end, warm[1:], motor_end),
        power,
        depth_end,
    )


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
