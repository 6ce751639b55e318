"""The plant as an FMU: which variables it has, and its process as C."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from fsw_control import weld
from fsw_control.parameters import describe, require_known
from fsw_export.choice import Choice, render
from fsw_export.fmu_description import Content, Variable, output, parameter, real, source
from fsw_model import ModelParameters
from fsw_plant import PlantEmulator, config
from fsw_plant.library import KERNEL, model_of
from fsw_plant.parameters import PlantParameters
from fsw_plant.process import process_model, reduced

#: parameters of the plant that the FMU has as its own
_FIXED = ("start.depth_mm", "start.temperature_c")
_OF_CANISTER = ("start.power_kw",)
#: the tool's motion, by its name at the node, is an input of the FMU
_MOTION = {
    "tool.traverse_mm_per_min": (
        "traverse_mm_per_min",
        "Traverse speed of the tool around the canister during a step; "
        "before the first one, while it is heated",
    ),
    "tool.axial_mm": (
        "axial_mm",
        "Height of the tool above the joint line, towards the lid, at the end of a step",
    ),
}
#: name, meaning and unit
_DISTURBANCES = (
    ("axial_force_disturbance_kn", "Added to the drive's force during a step", "kN"),
    ("spindle_speed_disturbance_rpm", "Added to the drive's speed during a step", "rpm"),
    ("depth_disturbance_mm", "Added to the measured depth at the end of a step", "mm"),
    ("temperature_disturbance_k", "Added to the measured temperature at the end of a step", "K"),
)
_OUTPUTS = (
    ("depth_mm", "Measured shoulder depth", "mm"),
    ("torque_nm", "Measured motor torque, with the peak while the spindle accelerates", "N m"),
    ("temperature_c", "Temperature of the stir zone, measured by the thermocouple", "degC"),
    ("acting_force_kn", "Actual axial force, as reported by the drive", "kN"),
    ("acting_speed_rpm", "Actual spindle speed, as reported by the drive", "rpm"),
    ("process_torque_nm", "Torque of the tool on the copper", "N m"),
    ("friction_torque_nm", "Friction of motor and transmission", "N m"),
    ("power_kw", "Power of the process", "kW"),
    ("copper_temperature_c", "Temperature of the copper about the stir zone", "degC"),
)
_TUNABLE = (
    "limits.force_min_kn",
    "limits.force_max_kn",
    "limits.speed_min_rpm",
    "limits.speed_max_rpm",
    "limits.force_rate_kn_per_s",
    "limits.speed_rate_rpm_per_s",
    "actuators.lag_s",
    "sensors.torque_drop_nm_per_rpm",
    "sensors.temperature_lag_s",
)


def plant(choice: Choice) -> Content:
    """The plant.

    Its parameters are those of the node: the FMU's own, ``model_file`` and ``factors.*``.

    On a canister also ``canister.*`` and the tool's first position.

    Raises
    ------
    InputError
        If a parameter is unknown or out of range, the file cannot be used, or there is no
        equilibrium to start from within the drives' limits.
    """
    on_canister = choice.parameters.get("process", "paper") == "canister"
    fixed = (*_FIXED, *(_OF_CANISTER if on_canister else ()))
    groups = ("factors.", "canister.") if on_canister else ("factors.",)
    own = {*fixed, *_TUNABLE, "model_file", "process", *(_MOTION if on_canister else ())}
    specs = {
        name: spec
        for name, spec in describe(PlantParameters).items()
        if name in own or name.startswith(groups)
    }
    require_known(specs, choice.parameters)
    chosen = config.PlantConfig.from_values(choice.parameters)
    emulator = PlantEmulator(chosen)  # checks the start
    start = emulator.applied if on_canister else process_model(chosen.model).equilibrium()
    variables: list[Variable] = [
        real("force_kn", "Commanded axial force, held during a step", "kN", start.force_kn),
        real("speed_rpm", "Commanded spindle speed, held during a step", "rpm", start.speed_rpm),
        *(real(name, text, unit, 0.0) for name, text, unit in _DISTURBANCES),
        *(output(*signal) for signal in _OUTPUTS),
        *(parameter(specs[name], chosen[name], fixed=True) for name in fixed),
        *(parameter(specs[name], chosen[name]) for name in _TUNABLE),
    ]
    if on_canister:
        variables += [
            real(name, words, specs[own].unit, chosen[own])
            for own, (name, words) in _MOTION.items()
        ]
    code = canister_code(chosen) if on_canister else process_code(chosen.model)
    return Content(
        "fsw_plant",
        "Friction stir welding process with its drives; no noise",
        tuple(variables),
        {
            "fmu_plant.c": source("fmu_plant.c"),
            **{path.name: path.read_text("utf-8") for path in KERNEL.folder.glob("*.[ch]")},
            "fmu_unit.h": source("fmu_unit_plant.h"),
            **code,
        },
    )


def process_code(
    parameters: ModelParameters, numbers: Mapping[str, float] = MappingProxyType({})
) -> dict[str, str]:
    """``process.h`` with model and numbers."""
    model = model_of(parameters)
    fields = {
        name: getattr(model, name) for name, _ in KERNEL.ffi.typeof("fsw_plant_model").fields
    }
    numbers = {"NOMINAL_SPEED_RPM": weld.SPEED_RPM, **numbers}
    return {"process.h": render("process.h", numbers=numbers, model=fields)}


def canister_code(chosen: config.PlantConfig) -> dict[str, str]:
    """The same, and ``canister.h`` with the compact canister's tables."""
    assert chosen.canister is not None
    canister = reduced(chosen.canister)
    sizes = {f"CANISTER_{name.upper()}": canister.sizes[name] for name in ("states", "even")}
    tables = {name: table.ravel().tolist() for name, table in canister.tables.items()}
    header = render("canister.h", tables=tables, sizes=canister.sizes)
    return {"canister.h": header, **process_code(chosen.model, sizes)}
