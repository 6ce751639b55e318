"""The plant's truth and readings as messages, in SI."""

from __future__ import annotations

from collections.abc import Callable

from sensor_msgs.msg import Temperature

from fsw_control import units
from fsw_control.messages_ros import (
    NANOSECONDS,
    depth_message,
    drives_message,
    temperature_message,
    torque_message,
)
from fsw_msgs.msg import DriveFeedback, PlantState, ShoulderDepth, SpindleTorque
from fsw_plant.emulator import Reading, Truth


class TruthMessage:
    """The truth as a message; one object for all ticks."""

    def __init__(self) -> None:
        self.message = PlantState()

    def fill(self, truth: Truth) -> PlantState:
        """Put a tick's truth into the message."""
        message = self.message
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(truth.stamp_ns, NANOSECONDS)
        message.depth = units.m_from_mm(truth.depth_mm)
        message.temperature = truth.temperature_c
        message.copper_temperature = truth.copper_temperature_c
        message.motor_torque = truth.motor_torque_nm
        message.process_torque = truth.process_torque_nm
        message.friction_torque = truth.friction_torque_nm
        message.process_power = units.w_from_kw(truth.process_power_kw)
        message.axial_force = units.n_from_kn(truth.force_kn)
        message.spindle_speed = units.rad_s_from_rpm(truth.speed_rpm)
        message.depth_disturbance = units.m_from_mm(truth.depth_disturbance_mm)
        message.temperature_disturbance = truth.temperature_disturbance_c
        message.force_disturbance = units.n_from_kn(truth.force_disturbance_kn)
        message.speed_disturbance = units.rad_s_from_rpm(truth.speed_disturbance_rpm)
        message.watchdog = int(truth.watchdog)
        message.refused_commands = truth.refused_commands
        message.active_faults = list(truth.active_faults)
        return message


def reading_messages(
    reading: Reading,
) -> tuple[DriveFeedback, list[ShoulderDepth], list[SpindleTorque], list[Temperature]]:
    """What drives and sensors send at a tick, as messages."""
    return (
        drives_message(reading.drives, reading.stamp_ns),
        [depth_message(sample.value, sample.stamp_ns) for sample in reading.depth_mm],
        [torque_message(sample.value, sample.stamp_ns) for sample in reading.torque_nm],
        [temperature_message(sample.value, sample.stamp_ns) for sample in reading.temperature_c],
    )


#: from the wire's unit to the plant's, by channel of a disturbance
FROM_WIRE: dict[str, Callable[[float], float]] = {
    "depth": units.mm_from_m,
    "temperature": float,
    "axial_force": units.kn_from_n,
    "spindle_speed": units.rpm_from_rad_s,
}
