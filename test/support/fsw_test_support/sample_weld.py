"""Writes the bag of a made-up weld.

Every topic of the control graph with plausible values, for tests and benchmarks.

The values follow no model; they only have the right types, units, rates and sizes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.definitions import Definitions, interface_definition, interface_hash
from fsw_recorder.topic import profile

TICK_NS = 100_000_000
START_NS = 1_700_000_000_000_000_000
LATCHED = profile(latched=True, depth=1)
TOPICS = {
    "/fsw/depth": "fsw_msgs/msg/ShoulderDepth",
    "/fsw/spindle_torque": "fsw_msgs/msg/SpindleTorque",
    "/fsw/thermocouple": "sensor_msgs/msg/Temperature",
    "/fsw/drives": "fsw_msgs/msg/DriveFeedback",
    "/fsw/plant/truth": "fsw_msgs/msg/PlantState",
    "/fsw/reference": "fsw_msgs/msg/WeldReference",
    "/fsw/nmpc/proposal": "fsw_msgs/msg/WeldCommand",
    "/fsw/nmpc/status": "fsw_msgs/msg/ControllerStatus",
    "/fsw/nmpc/prediction": "fsw_msgs/msg/Prediction",
    "/fsw/decentral/proposal": "fsw_msgs/msg/WeldCommand",
    "/fsw/decentral/status": "fsw_msgs/msg/ControllerStatus",
    "/fsw/command": "fsw_msgs/msg/WeldCommand",
    "/fsw/supervisor/state": "fsw_msgs/msg/SupervisorState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
SCENARIO = b"name: made-up weld\n"


class SampleTypes:
    """Builds and serializes messages from their definitions, without message classes.

    Parameters
    ----------
    definitions : dict of str to str, optional
        Of types that are not to be as they are installed.
    """

    def __init__(self, definitions: dict[str, str] | None = None) -> None:
        self._definitions = Definitions()
        self._texts = definitions or {}

    def serialize(self, type_name: str, values: dict[str, Any]) -> bytes:
        """Serialized message; fields not given are zero or empty."""
        definition = self._texts.get(type_name) or interface_definition(type_name)
        return self._definitions.encode(type_name, definition, values)


#: topic, values and delay of the receipt [ns]
_Sample = tuple[str, dict[str, Any], int]


def sample_messages(ticks: int) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time [ns] and serialized message of a made-up weld of ``ticks`` samples at 10 Hz."""
    types = SampleTypes()
    for tick in range(ticks):
        time_ns = START_NS + tick * TICK_NS
        stamp = {"sec": time_ns // 1_000_000_000, "nanosec": time_ns % 1_000_000_000}
        phase = tick / 50.0
        drives = {
            "axial_force": 78400.0 + 500.0 * math.sin(phase),
            "spindle_speed": 42.68 + 0.1 * math.cos(phase),
        }
        for topic, values, delay_ns in (
            *_now_and_then(tick, ticks),
            *_of_the_plant(tick, ticks, drives),
            *_of_the_controllers(tick, ticks, drives),
        ):
            data = types.serialize(TOPICS[topic], {"header": {"stamp": stamp}, **values})
            yield topic, time_ns + delay_ns, data


def _outputs(tick: int) -> tuple[float, float, float]:
    phase = tick / 50.0
    return 0.00266 + 1e-5 * math.sin(phase), 816.0 + math.cos(phase), 1052.86 + math.sin(phase)


def _now_and_then(tick: int, ticks: int) -> Iterator[_Sample]:
    if tick % 600 == 0:
        yield (
            "/fsw/reference",
            {"depth": 0.00266 + 1e-4 * (tick // 600 % 2), "temperature": 816.0},
            100_000,
        )
    if tick % 10 == 0:
        controller = "decentral" if tick < ticks // 2 else "nmpc"
        state = {
            "actual_controller": controller,
            "target_controller": controller,
            "actual_mode": "auto",
            "target_mode": "auto",
            "reason": "",
            "controllers": [
                {"name": "nmpc", "healthy": True},
                {"name": "decentral", "healthy": True},
            ],
        }
        yield "/fsw/supervisor/state", state, 200_000
        level = 1 if ticks // 3 <= tick < ticks // 3 + 50 else 0
        status = [{"name": "plant", "level": level, "message": "late" if level else "ok"}]
        yield "/diagnostics", {"status": status}, 300_000


def _of_the_plant(tick: int, ticks: int, drives: dict[str, float]) -> Iterator[_Sample]:
    depth, temperature, torque = _outputs(tick)
    yield "/fsw/depth", {"depth": depth}, 400_000
    yield "/fsw/spindle_torque", {"torque": torque}, 500_000
    yield "/fsw/thermocouple", {"temperature": temperature, "variance": 0.01}, 600_000
    yield "/fsw/drives", {**drives}, 650_000
    truth = {
        "depth": depth,
        "temperature": temperature,
        "motor_torque": torque,
        "process_power": 43600.0,
        "depth_disturbance": 5e-5 if tick >= ticks // 4 else 0.0,
        "active_faults": ["thermocouple:freeze"] if ticks // 3 <= tick < ticks // 2 else [],
    }
    yield "/fsw/plant/truth", {**truth, **drives}, 700_000


def _of_the_controllers(tick: int, ticks: int, drives: dict[str, float]) -> Iterator[_Sample]:
    depth, temperature, torque = _outputs(tick)
    for name, delay_ns in (("decentral", 1_000_000), ("nmpc", 9_000_000)):
        yield f"/fsw/{name}/proposal", {**drives, "source": name, "healthy": True}, delay_ns
        status = {
            "controller": name,
            "healthy": True,
            "depth_estimate": depth,
            "temperature_estimate": temperature,
            "torque_estimate": torque,
            "disturbance_names": ["depth [m]", "temperature [degC]"],
            "disturbances": [1e-6 * tick, -0.5],
            "solver_status": "optimal",
            "iterations": 3,
            "solve_time": 0.004,
            "active_limits": ["force_max"] if tick % 7 == 0 else [],
        }
        yield f"/fsw/{name}/status", status, delay_ns + 100_000
    times = [0.5 * step for step in range(60)]
    prediction = {
        "time": times,
        "depth": times,
        "temperature": times,
        "axial_force": times,
        "spindle_speed": times,
    }
    yield "/fsw/nmpc/prediction", prediction, 9_200_000
    source = "decentral" if tick < ticks // 2 else "nmpc"
    yield "/fsw/command", {**drives, "source": source, "healthy": True}, 9_500_000


def sample_topics() -> list[RecordedTopic]:
    """Topics of the made-up weld."""
    latched = ("/fsw/reference", "/fsw/supervisor/state")
    return [
        RecordedTopic(
            name,
            type_name,
            interface_definition(type_name),
            interface_hash(type_name),
            (LATCHED,) if name in latched else (profile(),),
        )
        for name, type_name in TOPICS.items()
    ]


def write_sample_weld(
    folder: Path, ticks: int, in_chunk: int = 5000, scenario: bytes = SCENARIO
) -> int:
    """Write a made-up weld to a bag, in chunks of ``in_chunk`` messages at most.

    Returns the number of messages.
    """
    count = 0
    with BagWriter(folder) as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        writer.attach("scenario.yaml", "application/yaml", scenario)
        for topic_name, time_ns, data in sample_messages(ticks):
            writer.write(topic_name, data, time_ns, time_ns - 50_000)
            count += 1
            if count % in_chunk == 0:
                writer.flush()
    if writer.error is not None:
        raise writer.error
    return count
