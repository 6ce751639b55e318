"""The plant's truth as a message."""

from __future__ import annotations

from fsw_control import units
from fsw_control.messages_ros import header
from fsw_msgs.msg import PlantState
from fsw_plant.emulator import Truth


def truth_message(truth: Truth) -> PlantState:
    """The truth in SI."""
    return PlantState(
        header=header(truth.stamp_ns),
        depth=units.m_from_mm(truth.depth_mm),
        temperature=truth.temperature_c,
        copper_temperature=truth.copper_temperature_c,
        motor_torque=truth.motor_torque_nm,
        process_torque=truth.process_torque_nm,
        friction_torque=truth.friction_torque_nm,
        process_power=units.w_from_kw(truth.process_power_kw),
        axial_force=units.n_from_kn(truth.force_kn),
        spindle_speed=units.rad_s_from_rpm(truth.speed_rpm),
        depth_disturbance=units.m_from_mm(truth.depth_disturbance_mm),
        temperature_disturbance=truth.temperature_disturbance_c,
        force_disturbance=units.n_from_kn(truth.force_disturbance_kn),
        speed_disturbance=units.rad_s_from_rpm(truth.speed_disturbance_rpm),
        watchdog=int(truth.watchdog),
        refused_commands=truth.refused_commands,
        active_faults=list(truth.active_faults),
    )
