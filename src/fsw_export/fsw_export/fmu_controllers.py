"""The controllers as FMUs: which variables they have, and how these are the signals of their C libraries."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from fsw_control.parameters import load
from fsw_export.c_library import ControllerSources, nmpc_sources
from fsw_export.fmu_description import Content, Variable, flag, given, parameter, shown, sources
from fsw_export.signals import Signal
from fsw_model import ProcessModel
from fsw_nmpc import NmpcController

_TYPE = {"real": "Real", "int": "Integer", "bool": "Boolean"}
#: parameters of the NMPC's node that its FMU has as its own
_NMPC = (
    *("depth_aggressiveness", "temperature_aggressiveness", "calmness", "depth_priority"),
    *("force_min", "force_max", "speed_min", "speed_max", "force_step", "speed_step"),
    *("blind_limit", "max_iterations", "plan_reuse"),
)
#: signals that the FMU sets itself
_OWN = ("dt_s", "applied_force_kn", "applied_speed_rpm", "n_changes")
#: the one future set-point that the FMU takes
_KNOWN = Signal("change_valid", "bool", "", "whether the next set-point is known: the change_... signals", "n_changes")


def nmpc(model: Path | None, tuning: Path | None, values: Mapping[str, Any]) -> Content:
    """The NMPC.

    Parameters
    ----------
    model, tuning : Path, optional
        Files of model parameters and of tuning fields.
    values : mapping of str to Any
        Other parameters by their name in ``nmpc.yaml``.

    Raises
    ------
    ValueError
        If a parameter is unknown or out of range, a file cannot be used, or the solver is not the library's own.
    """
    files = {"model_file": model, "tuning_file": tuning}
    chosen = dict(values) | {name: str(path) for name, path in files.items() if path is not None}
    specs = load("fsw_nmpc", "nmpc.yaml")
    controller = NmpcController(chosen)
    if controller.solver is not None:
        raise ValueError("solver: only rti, the library's own, can be exported")
    start = ProcessModel(controller.settings.model).equilibrium()
    at = {"depth_mm": start.outputs.depth_mm, "temperature_c": start.outputs.temperature_c}
    at |= {"torque_nm": start.outputs.motor_torque_nm, "force_kn": start.force_kn, "speed_rpm": start.speed_rpm}
    parameters = [parameter(specs[name], chosen.get(name, specs[name].default)) for name in _NMPC]
    return _content(nmpc_sources(controller.library, controller.settings), parameters, at)


def _content(library: ControllerSources, parameters: list[Variable], at: Mapping[str, float]) -> Content:
    """An FMU of a library; ``at`` has the operating point, from which inputs have their start values."""
    inputs = [signal for signal in library.inputs if signal.name not in _OWN]
    if any(signal.name == "n_changes" for signal in library.inputs):
        inputs.append(_KNOWN)
    variables = [_input(signal, at) for signal in inputs]
    if any(signal.name == "acting_force_kn" for signal in inputs):
        variables += [flag("drives_valid", "Whether acting_force_kn and acting_speed_rpm are wired and good", False)]
    variables += [
        given(
            "applied_force_kn",
            "Force set-point in force until now, if it is not that of this FMU",
            "kN",
            at["force_kn"],
        ),
        given("applied_speed_rpm", "Speed set-point in force until now, likewise", "rpm", at["speed_rpm"]),
        flag("applied_valid", "Whether these are wired; otherwise what this FMU puts out counts as applied", False),
        *(shown(one.name, _text(one), _unit(one), _TYPE[one.kind]) for one in library.outputs),
        *parameters,
        Variable("start_force_kn", "parameter", "Force at the start", "kN", at["force_kn"], fixed=True),
        Variable("start_speed_rpm", "parameter", "Spindle speed at the start", "rpm", at["speed_rpm"], fixed=True),
    ]
    header = f"fmu_{library.name}.h"
    shared = sources("fmu_controller.c", "fmu_controller.h", f"fmu_{library.name}.c", header)
    code = {**library.files(), **shared, "signals.h": _signals(inputs, library.outputs)}
    return Content(f"fsw_{library.name}", _text(library.title), tuple(variables), header, code)


def _text(source: Signal | str) -> str:
    text = source if isinstance(source, str) else source.text
    return text[:1].upper() + text[1:]


def _unit(signal: Signal) -> str:
    return "K" if signal.name == "temperature_offset_c" else signal.unit  # a difference: degC has its zero elsewhere


def _input(signal: Signal, at: Mapping[str, float]) -> Variable:
    quantity = signal.name.removeprefix("reference_").removeprefix("acting_")
    if signal.kind == "bool":
        return flag(signal.name, _text(signal), signal is not _KNOWN)
    return Variable(
        signal.name,
        "input",
        _text(signal),
        signal.unit,
        0 if signal.is_int else at.get(quantity, 0.0),
        _TYPE[signal.kind],
    )


def _signals(inputs: Iterable[Signal], outputs: Iterable[Signal]) -> str:
    """``signals.h``: from the FMU's variables to the library's input, and from its output to the variables."""

    def variable(signal: Signal) -> str:
        return f"{_TYPE[signal.kind].lower()}->{signal.name}"

    def value(signal: Signal) -> str:
        return f"boolean->drives_valid ? {variable(signal)} : NAN" if signal.name[:7] == "acting_" else variable(signal)

    arguments = "fmu_reals *real, {0}fmu_integers *integer, {0}fmu_booleans *boolean) {{"
    return "\n".join(
        [
            "/* Generated from the table of signals of fsw_export. */",
            "static void give_input(controller_input *in, const " + arguments.format("const "),
            "  (void)integer;",
            *(f"  in->{signal.in_c} = {value(signal)};" for signal in inputs),
            "}",
            "",
            "static void show_output(const controller_output *out, " + arguments.format(""),
            *(f"  {variable(signal)} = out->{signal.in_c};" for signal in outputs),
            "}",
            "",
        ]
    )
