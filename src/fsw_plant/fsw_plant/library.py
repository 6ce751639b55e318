"""Binding of the plant in C (``kernel/fsw_plant.h``): settings and process for the library."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from fsw_control import weld
from fsw_control.c_library import CLibrary
from fsw_control.sensors import REQUIRED
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import ModelParameters
from fsw_model.equations import delay_steps, numbers_of
from fsw_plant.config import PlantConfig
from fsw_plant.lag import lag_risen
from fsw_plant.sensors import noise_of

KERNEL = CLibrary("fsw_plant", Path(__file__).parent / "kernel")
#: channels of disturbances, in the order of ``fsw_plant_disturbance``, with its fields
CHANNELS = {
    "depth": "depth_mm",
    "temperature": "temperature_c",
    "torque": "torque_nm",
    "axial_force": "force_kn",
    "spindle_speed": "speed_rpm",
}


@lru_cache(maxsize=16)
def model_of(parameters: ModelParameters) -> Any:
    """The process with these parameters, a ``fsw_plant_model *``; all plants share it."""
    p = parameters
    return KERNEL.new(
        "fsw_plant_model",
        numbers=numbers_of(p).tolist(),
        force_kn=p.operating_force_kn,
        depth_mm=p.operating_depth_mm,
        temperature_c=p.operating_temperature_c,
        power_kw=p.operating_power_kw,
        gain_c_per_kw=p.thermal_gain_c_per_kw,
        softening_per_c=p.softening_per_c,
        inertia_nm_s_per_rpm=p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM,
        motor_risen=lag_risen(p.motor_lag_s),
        delay_steps=delay_steps(p),
    )


def configure(plant: Any, config: PlantConfig) -> None:
    """Set drives and sensors of a ``fsw_plant *``."""
    lib, part = KERNEL.lib, KERNEL.ffi.addressof
    limits = config.limits
    steps = (limits.force_step_kn, limits.speed_step_rpm)
    for drive, largest_step in zip(plant.drive, steps, strict=True):
        lib.fsw_plant_drive_configure(part(drive), largest_step, *config.drives)
    lib.fsw_plant_probe_configure(part(plant.probe), config["sensors.temperature_lag_s"])
    noises = noise_of(config)
    for sensor, name in zip(plant.sensor, REQUIRED, strict=True):
        lib.fsw_plant_sensor_configure(part(sensor), *noises[name])
    plant.torque_drop_nm_per_rpm = config["sensors.torque_drop_nm_per_rpm"]
    plant.nominal_rpm = weld.SPEED_RPM
