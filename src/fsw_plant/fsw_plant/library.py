"""Binding of the plant in C (``kernel/fsw_plant.h``): settings and process for the library."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from fsw_control import weld
from fsw_control.c_library import CLibrary
from fsw_control.sensors import REQUIRED
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import Equilibrium, ModelParameters
from fsw_model.equations import delay_steps, numbers_of
from fsw_plant.config import PlantConfig
from fsw_plant.lag import lag_left, lag_mean, lag_risen
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
        inertia_nm_s_per_rpm=p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM,
        motor_risen=lag_risen(p.motor_lag_s),
        delay_steps=delay_steps(p),
    )


def configure(plant: Any, config: PlantConfig) -> None:
    """Set drives and sensors of a ``fsw_plant *``."""
    lag_s, dead_ticks = config.drives
    limits = config.limits
    steps = (limits.force_step_kn, limits.speed_step_rpm)
    for drive, largest_step in zip(plant.drive, steps, strict=True):
        drive.largest_step, drive.left, drive.mean = largest_step, lag_left(lag_s), lag_mean(lag_s)
        KERNEL.lib.fsw_plant_drive_delay(KERNEL.ffi.addressof(drive), dead_ticks)
    lag_s = config["sensors.temperature_lag_s"]
    plant.probe.left, plant.probe.mean = lag_left(lag_s), lag_mean(lag_s)
    plant.probe.is_slow = lag_s > 0.0
    noises = noise_of(config)
    for sensor, name in zip(plant.sensor, REQUIRED, strict=True):
        noise = noises[name]
        sensor.deviation, sensor.resolution = noise.deviation, noise.resolution
        sensor.kept = noise.autocorrelation
    plant.torque_drop_nm_per_rpm = config["sensors.torque_drop_nm_per_rpm"]
    plant.nominal_rpm = weld.SPEED_RPM


def begin(plant: Any, model: Any, start: Equilibrium) -> None:
    """Put a ``fsw_plant *`` at rest where a weld starts; its settings stay."""
    arriving_kw = start.state.power[0][0] if start.state.power else 0.0
    inputs = (start.force_kn, start.speed_rpm)
    KERNEL.lib.fsw_plant_begin(plant, model, start.state.x, arriving_kw, inputs)
