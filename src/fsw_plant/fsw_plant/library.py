"""Binding of the plant in C (``kernel/fsw_plant.h``): settings, process, machine, sensors."""

from __future__ import annotations

from functools import lru_cache
from math import expm1, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw_control import weld
from fsw_control.c_library import CLibrary
from fsw_control.sensors import (
    DEPTH,
    DEPTH_CHANNELS,
    REQUIRED,
    SENSORS,
    TEMPERATURE,
    TORQUE,
    Sensor,
)
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import ModelParameters
from fsw_model.equations import STEP_S, delay_steps, numbers_of
from fsw_plant.config import PlantConfig
from fsw_plant.parameters import Machine

KERNEL = CLibrary("fsw_plant", Path(__file__).parent / "kernel")
#: channels of disturbances, in the order of ``fsw_plant_disturbance``, with its fields
CHANNELS = {
    "depth": "depth_mm",
    "temperature": "temperature_c",
    "torque": "torque_nm",
    "axial_force": "force_kn",
    "spindle_speed": "speed_rpm",
    "friction": "friction",
}
#: in the order of ``fsw_plant_show``
_QUANTITIES = (DEPTH, TORQUE, TEMPERATURE)
#: number of random values drawn at once: numpy is too slow for single ones
BLOCK = 1024


@lru_cache(maxsize=16)
def model_of(parameters: ModelParameters) -> Any:
    """The process with these parameters, a ``fsw_plant_model *``; all plants share it."""
    p = parameters
    risen = -expm1(-STEP_S / p.motor_lag_s)
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
        motor_risen=risen,
        motor_mean=1.0 - p.motor_lag_s / STEP_S * risen,
        dead_steps=p.dead_time_s / STEP_S,
        delay_steps=delay_steps(p),
    )


class Draws:
    """Standard normal numbers for a plant's sensors, from a random stream for each sensor.

    Each reading takes one number, whatever happens to it, so the stream depends on seed and tick
    alone.
    """

    def __init__(self, seed: int, sensors: int = len(REQUIRED)) -> None:
        # a stream of its own for each sensor, by seed and row: another sensor at the end of the
        # table, or one that is silent, leaves the noise of the others as it was
        self._generators = [
            np.random.Generator(np.random.PCG64([seed, i])) for i in range(sensors)
        ]

    def block(self) -> NDArray[np.float64]:
        """The next ``BLOCK`` numbers of each sensor, (BLOCK, sensors)."""
        drawn = [generator.standard_normal(BLOCK) for generator in self._generators]
        return np.ascontiguousarray(np.transpose(drawn))


def sensors_of(config: PlantConfig) -> tuple[str, ...]:
    """Names of the plant's sensors, in the order of the table."""
    channels = config.machine.depth_channels
    return tuple(name for name in SENSORS if channels or name not in DEPTH_CHANNELS)


def _noise(config: PlantConfig, row: Sensor) -> tuple[float, float, float]:
    """Deviation, quantisation and correlation time of a sensor's noise; 0: none."""
    if not config["noise"]:
        return 0.0, 0.0, 0.0
    stem, suffix = f"sensors.{row.stem}", row.quantity.suffix
    deviation, resolution = config[f"{stem}_noise_{suffix}"], config[f"{stem}_resolution_{suffix}"]
    return deviation, resolution, config[f"{stem}_noise_correlation_s"]


def configure(plant: Any, config: PlantConfig) -> None:
    """Set drives and sensors of a ``fsw_plant *``."""
    lib, part = KERNEL.lib, KERNEL.ffi.addressof
    limits = config.limits
    steps = (limits.force_step_kn, limits.speed_step_rpm)
    lag = config["actuators.lag_s"], config["actuators.dead_time_ticks"]
    for drive, largest_step in zip(plant.drive, steps, strict=True):
        lib.fsw_plant_drive_configure(part(drive), largest_step, *lag)
    lib.fsw_plant_probe_configure(part(plant.probe), config["sensors.temperature_lag_s"])
    names = sensors_of(config)
    plant.sensors = len(names)
    for sensor, name in zip(plant.sensor, names, strict=False):
        row = SENSORS[name]
        lib.fsw_plant_sensor_configure(part(sensor), *_noise(config, row))
        sensor.quantity = _QUANTITIES.index(row.quantity)
        mount = name if name in DEPTH_CHANNELS else config.machine.depth_sensor
        sensor.mount = MOUNTS[mount]._asdict()
    plant.torque_drop_nm_per_rpm = config["sensors.torque_drop_nm_per_rpm"]
    plant.nominal_rpm = weld.SPEED_RPM


def configure_machine(plant: Any, config: PlantConfig, seed: int) -> None:
    """Set the machine of a ``fsw_plant *`` and its copper, ahead of a start."""
    machine, own = config.machine, plant.machine
    for name in (
        *("compliance_mm_per_kn", "touch_off_kn", "runout_mm", "edge_mm", "edge_at_mm"),
        *("swelling_mm_per_mm", "swelling_from_mm"),
    ):
        setattr(own, name, getattr(machine, name))
    own.tool_mm_per_kw = machine.tool_growth_mm_per_kw
    own.canister_mm_per_kw = machine.canister_growth_mm_per_kw
    KERNEL.lib.fsw_plant_machine_configure(
        KERNEL.ffi.addressof(own), machine.tool_growth_s, machine.canister_growth_s
    )
    own.traverse_mm_per_s = config["tool.traverse_mm_per_min"] / 60.0
    own.circumference_mm = 2.0 * pi * config["canister.outer_radius_mm"]
    own.harder = machine.hardness - 1.0
    if machine.hardness_variation:
        own.wave, own.phase = hardness_waves(machine, seed, own.circumference_mm, len(own.wave))


#: stream of the random numbers of the hardness; the sensors have the first ones
_HARDNESS_STREAM = 1000


class Mount(NamedTuple):
    """Share of deflection and growth in a sensor: ``fsw_plant_mount`` in C; all chosen.

    The axial position is that of the machine: deflection, growth and edge lie between it and the
    surface. Laser and LVDTs ride beside the shoulder and miss only the growth of the tool below
    them.
    """

    deflection: float = 0.0
    tool: float = 0.0
    canister: float = 0.0
    swelling: float = 0.0
    runout: float = 0.0
    edge_here: float = 0.0
    edge_ahead: float = 0.0
    lead_mm: float = 0.0


def _rider(swelling: float, runout: float, lead_mm: float) -> Mount:
    return Mount(0.0, -0.1, 0.0, swelling, runout, -1.0, 1.0, lead_mm)


MOUNTS = {
    "ideal": Mount(),
    "depth_laser": _rider(1.0, 0.5, 45.0),
    "depth_lvdt_lead": _rider(0.0, 1.0, 60.0),
    "depth_lvdt_trail": _rider(0.3, -1.0, -60.0),
    "depth_axial": Mount(deflection=1.0, tool=-1.0, canister=-1.0, edge_here=-1.0),
}


def hardness_waves(
    machine: Machine, seed: int, circumference_mm: float, harmonics: int
) -> tuple[list[float], list[float]]:
    """Amplitudes and phases of the hardness along the circumference, by harmonic.

    The amplitudes fall beyond the length within which the hardness is similar as those of a
    first-order Gauss-Markov process.
    """
    harmonic = np.arange(1, harmonics + 1)
    # the exponential correlation's spectrum over the wave number falls as 1 / (1 + (k length)^2);
    # amplitudes are its root, scaled to the requested deviation (a sine has half its square)
    wave = 1.0 / np.hypot(1.0, 2.0 * pi * harmonic * machine.hardness_length_mm / circumference_mm)
    wave *= machine.hardness_variation / np.sqrt(0.5 * np.sum(wave**2))
    draws = np.random.Generator(np.random.PCG64([seed, _HARDNESS_STREAM]))
    return wave.tolist(), draws.uniform(0.0, 2.0 * pi, harmonics).tolist()
