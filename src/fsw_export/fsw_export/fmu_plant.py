"""The plant as an FMU: which variables it has, and its process as C."""

from __future__ import annotations

from fsw_control import weld
from fsw_control.parameters import validate
from fsw_export.choice import Choice
from fsw_export.errors import ExportError
from fsw_export.fmu_description import Content, Variable, output, parameter, real, source
from fsw_export.templates import render
from fsw_model import ProcessModel, equations
from fsw_nmpc.kernel_codegen import c_text
from fsw_plant import PlantEmulator, config

#: parameters of the plant that the FMU has as its own
_FIXED = ("start.depth_mm", "start.temperature_c")
_TUNABLE = (
    "limits.force_min_kn",
    "limits.force_max_kn",
    "limits.speed_min_rpm",
    "limits.speed_max_rpm",
    "limits.force_rate_kn_per_s",
    "limits.speed_rate_rpm_per_s",
    "actuators.lag_s",
    "sensors.torque_drop_nm_per_rpm",
)


def plant(choice: Choice) -> Content:
    """The plant; its parameters are those of ``plant.yaml``: the FMU's own, ``model_file``, and factors ``model.*``.

    Raises
    ------
    ExportError, ValueError
        If a parameter is unknown or out of range, the file cannot be used, or there is no equilibrium to start from
        within the drives' limits.
    """
    if choice.parameters.get("process", "paper") != "paper":
        raise ExportError("process canister: the plant as an FMU has the paper's process only; leave out process")
    own = (*_FIXED, *_TUNABLE, "model_file")
    specs = {name: spec for name, spec in config.specs().items() if name in own or name.startswith("model.")}
    validate(specs, choice.parameters)
    chosen = config.PlantConfig.from_values(choice.parameters)
    PlantEmulator(chosen)  # checks the start
    process = ProcessModel(chosen.model)
    start = process.equilibrium()
    variables: list[Variable] = [
        real("force_kn", "Commanded axial force, held during a step", "kN", start.force_kn),
        real("speed_rpm", "Commanded spindle speed, held during a step", "rpm", start.speed_rpm),
        real("axial_force_disturbance_kn", "Disturbance force, added to the drive's force during a step", "kN", 0.0),
        real(
            "spindle_speed_disturbance_rpm",
            "Disturbance of the speed, added to the drive's speed during a step",
            "rpm",
            0.0,
        ),
        real("depth_disturbance_mm", "Added to the measured depth at the end of a step", "mm", 0.0),
        real("temperature_disturbance_k", "Added to the measured temperature at the end of a step", "K", 0.0),
        output("depth_mm", "Measured shoulder depth", "mm"),
        output("torque_nm", "Measured motor torque, including the peak while the spindle accelerates", "N m"),
        output("temperature_c", "Temperature of the stir zone, as measured by the thermocouple", "degC"),
        output("acting_force_kn", "Actual axial force, as reported by the drive", "kN"),
        output("acting_speed_rpm", "Actual spindle speed, as reported by the drive", "rpm"),
        output("process_torque_nm", "Torque of the tool on the copper", "N m"),
        output("friction_torque_nm", "Friction of motor and transmission", "N m"),
        output("power_kw", "Power of the process", "kW"),
        output("copper_temperature_c", "Temperature of the copper about the stir zone", "degC"),
        *(parameter(specs[name], chosen[name], fixed=True) for name in _FIXED),
        *(parameter(specs[name], chosen[name]) for name in _TUNABLE),
    ]
    return Content(
        "fsw_plant",
        "Friction stir welding process with its drives; no noise",
        tuple(variables),
        {"fmu_plant.c": source("fmu_plant.c"), "fmu_unit.h": source("fmu_unit_plant.h"), **process_code(process)},
    )


def process_code(process: ProcessModel) -> dict[str, str]:
    """``process.c``, the step and the outputs of the process by CasADi, and ``process.h`` with its numbers."""
    p = process.parameters
    functions = [process.step_function, process.output_function]
    numbers: dict[str, float] = {
        "PROCESS_STATES": equations.N_STATES,
        "PROCESS_POWER": equations.N_POWER,
        "PROCESS_DELAY": process.delay_steps,
        "PROCESS_FORCE_KN": p.operating_force_kn,
        "PROCESS_DEPTH_MM": p.operating_depth_mm,
        "PROCESS_TEMPERATURE_C": p.operating_temperature_c,
        "PROCESS_POWER_KW": p.operating_power_kw,
        "PROCESS_GAIN_C_PER_KW": p.thermal_gain_c_per_kw,
        "PROCESS_SOFTENING_PER_C": p.softening_per_c,
        "PROCESS_INERTIA_KGM2": p.spindle_inertia_kgm2,
        "NOMINAL_SPEED_RPM": weld.SPEED_RPM,
    }
    for function in functions:
        for size in ("arg", "res", "iw", "w"):
            numbers[f"{function.name().upper()}_{size.upper()}"] = getattr(function, f"sz_{size}")()
    header = render("process.h", numbers=numbers, functions=[function.name() for function in functions])
    return {"process.c": c_text("process", *functions), "process.h": header}
