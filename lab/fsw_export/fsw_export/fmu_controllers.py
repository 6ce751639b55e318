"""The controllers as FMUs.

Which variables they have, and how these are the signals of their C libraries.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf

from fsw_control.parameters import describe, validate
from fsw_decentral import DecentralController
from fsw_decentral.parameters import DecentralParameters, Gains
from fsw_export.choice import Choice, render
from fsw_export.fmu_description import Content, Variable, boolean, output, parameter, real, source
from fsw_export.signals import Signal
from fsw_export.sources import ControllerSources, sources_of
from fsw_model import ProcessModel
from fsw_nmpc import NmpcController
from fsw_nmpc.parameters import NmpcParameters
from fsw_nmpc.tuning import MOVE_COSTS, WALKS

#: the limits' parameters of both nodes, and their names in the libraries' tunings
_LIMITS = {
    "force_min": "force_min_kn",
    "force_max": "force_max_kn",
    "speed_min": "speed_min_rpm",
    "speed_max": "speed_max_rpm",
    "force_step": "force_step_kn",
    "speed_step": "speed_step_rpm",
    "blind_limit": "blind_limit_s",
}
#: parameters of the decentralized controller's node, and where they are in the library's tuning
_DECENTRAL = {name: name for name in Gains.model_fields} | {
    **_LIMITS,
    "friction.constant": "friction[0]",
    "friction.linear": "friction[1]",
    "friction.quadratic": "friction[2]",
    "spindle_inertia": "spindle_inertia_kgm2",
    "nominal_torque": "nominal_torque_nm",
}
_TYPE = {"real": "Real", "int": "Integer", "bool": "Boolean"}
#: parameters of the NMPC's node that its FMU has as its own
_KNOBS, _COUNTS = (
    ("depth_aggressiveness", "temperature_aggressiveness", "calmness"),
    ("max_iterations", "plan_reuse"),
)
_NMPC = (*_KNOBS, *_LIMITS, *_COUNTS)
#: signals that the FMU sets itself
_OWN = ("dt_s", "applied_force_kn", "applied_speed_rpm", "n_changes")
#: the one future set-point that the FMU takes
_KNOWN = Signal(
    "change_valid",
    "whether the next set-point is known: the change_... signals",
    "bool",
    "n_changes",
)
_DRIVES_VALID = "Whether acting_force_kn and acting_speed_rpm are connected and valid"
_APPLIED = "{} set-point in force until now, if it is not that of this FMU"
_APPLIED_VALID = "Whether these are connected; otherwise this FMU's own output counts as applied"


def nmpc(choice: Choice) -> Content:
    """The NMPC; its parameters are those of the node.

    Raises
    ------
    InputError
        If a parameter is unknown or out of range, or a file cannot be used.
    """
    specs = describe(NmpcParameters)
    values = validate(NmpcParameters, choice.parameters)
    sources = sources_of(NmpcController(values))
    tune = render(
        "tune_nmpc.h", move_costs=MOVE_COSTS, walks=WALKS, reals=_LIMITS, integers=_COUNTS
    )
    return _content(
        sources, [parameter(specs[name], values[name]) for name in _NMPC], choice, tune
    )


def decentral(choice: Choice) -> Content:
    """The decentralized controller.

    Its parameters are those of the node, but the tuning becomes gains.

    Raises
    ------
    InputError
        If a parameter is unknown or out of range.
    """
    specs = describe(DecentralParameters)
    values = validate(DecentralParameters, choice.parameters)
    controller = DecentralController(values)
    values |= dict(controller.gains)
    parameters = []
    for name, spec in specs.items():
        if name in _DECENTRAL:
            low, high = spec.range or (-inf, inf)
            allowed = (max(low, 0.0), high) if hasattr(controller.gains, name) else (low, high)
            parameters.append(parameter(replace(spec, range=allowed), values[name]))
    return _content(
        sources_of(controller), parameters, choice, render("tune_decentral.h", fields=_DECENTRAL)
    )


def _content(
    library: ControllerSources, parameters: list[Variable], choice: Choice, tune: str
) -> Content:
    """An FMU of a library.

    Inputs start at the model's operating point, ``tune`` is the C code of its parameters.
    """
    start = ProcessModel(choice.model).equilibrium()
    at = {"depth_mm": start.outputs.depth_mm, "temperature_c": start.outputs.temperature_c}
    at |= {
        "torque_nm": start.outputs.motor_torque_nm,
        "force_kn": start.force_kn,
        "speed_rpm": start.speed_rpm,
    }
    own = {variable.name: variable for variable in parameters}
    is_nmpc = library.name == "nmpc"
    inputs = [signal for signal in library.inputs if signal.name not in _OWN]
    inputs += [_KNOWN] if is_nmpc else []
    variables = [
        *(_input(signal, at) for signal in inputs),
        *((boolean("drives_valid", _DRIVES_VALID, False),) if is_nmpc else ()),
        real("applied_force_kn", _APPLIED.format("Force"), "kN", at["force_kn"]),
        real("applied_speed_rpm", _APPLIED.format("Speed"), "rpm", at["speed_rpm"]),
        boolean("applied_valid", _APPLIED_VALID, False),
        *(output(row.name, _text(row), _unit(row), _TYPE[row.kind]) for row in library.outputs),
        *parameters,
        *(
            replace(
                own[f"{name}_max"],
                name=f"start_{name}_{unit}",
                description=f"{name.capitalize()} at the start",
                start=at[f"{name}_{unit}"],
                fixed=True,
            )
            for name, unit in (("force", "kn"), ("speed", "rpm"))
        ),
    ]
    code = library.files() | {
        "fmu_controller.c": source("fmu_controller.c"),
        "fmu_unit.h": render(
            "fmu_unit.h", prefix=library.prefix, has_model="model" in library.structs
        ),
        "signals.h": render("signals.h", inputs=inputs, outputs=library.outputs),
        "tune.h": tune,
    }
    return Content(f"fsw_{library.name}", _text(library.title), tuple(variables), code)


def _text(source: Signal | str) -> str:
    text = source if isinstance(source, str) else source.text
    return text[:1].upper() + text[1:]


def _unit(signal: Signal) -> str:
    # a difference: degC has its zero elsewhere
    return "K" if signal.name == "temperature_offset_c" else signal.unit


def _input(signal: Signal, at: Mapping[str, float]) -> Variable:
    quantity = signal.name.removeprefix("reference_").removeprefix("acting_")
    if signal.kind == "bool":
        return boolean(signal.name, _text(signal), signal is not _KNOWN)
    return real(signal.name, _text(signal), signal.unit, at.get(quantity, 0.0))
