"""Deterministic replay: the recorded build reproduces its proposals, a different one is detected."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from fsw_analysis.verify import Verification, recorded_controllers, verify
from fsw_control.contract import Command, Measurement, Proposal, Reference
from fsw_control.units import m_from_mm, n_from_kn, rad_s_from_rpm
from fsw_recorder import BagError
from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.interface_text import interface_definition, interface_hash
from fsw_test_support.sample_weld import SampleTypes

TICK_NS = 100_000_000
INITIAL = Command(80.0, 400.0)


class Integrator:
    """Moves the applied force by a share of the depth error, and remembers the sum of all errors."""

    name = "simple"
    tolerated_sensors: tuple[str, ...] = ()

    def __init__(self, gain: float = 0.3, odd_tick: int = -1) -> None:
        self.gain, self.odd_tick = gain, odd_tick
        self.total, self.ticks = 0.0, 0

    def reset(self, applied: Command) -> None:
        self.total, self.ticks = 0.0, 0

    def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
        error = reference.depth_mm - measurement.depth_mm
        self.total += error * dt_s
        self.ticks += 1
        extra = 1e-9 if self.ticks - 1 == self.odd_tick else 0.0
        force = applied.force_kn + self.gain * error + 0.01 * self.total + extra
        return Proposal(
            Command(force, applied.speed_rpm + 0.001 * (reference.temperature_c - measurement.temperature_c))
        )


def record(
    bag: Path, ticks: int = 60, jump_at: int = -1, lost_sensor_at: int = -1, space: str = "", kept: bool = False
) -> Path:
    """Bag of a run in which `Integrator` answers a made-up depth, as its node would."""
    types = SampleTypes()
    kinds = {
        "/fsw/depth": "fsw_msgs/msg/ShoulderDepth",
        "/fsw/spindle_torque": "fsw_msgs/msg/SpindleTorque",
        "/fsw/thermocouple": "sensor_msgs/msg/Temperature",
        "/fsw/reference": "fsw_msgs/msg/WeldReference",
        "/fsw/supervisor/reference": "fsw_msgs/msg/WeldReference",
        "/fsw/command": "fsw_msgs/msg/WeldCommand",
        "/fsw/simple/proposal": "fsw_msgs/msg/WeldCommand",
    }
    controller, applied = Integrator(), INITIAL
    controller.reset(applied)
    stamp, last, now = 1_000_000_000, None, 1
    with BagWriter(bag) as writer:
        for name, kind in kinds.items():
            writer.add_topic(RecordedTopic(space + name, kind, interface_definition(kind), interface_hash(kind)))
        values = {"initial_force": 80.0, "initial_speed": 400.0, "period": 0.1}
        text = yaml.safe_dump({f"{space}/fsw_simple": {"ros__parameters": values}})
        file = f"{space}/fsw_simple".strip("/").replace("/", ".")
        writer.attach(f"parameters/{file}.yaml", "application/yaml", text.encode())

        def put(topic: str, **fields: Any) -> None:
            nonlocal now
            now += 1000
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
            writer.write(space + topic, types.serialize(kinds[topic], {"header": header, **fields}), now, now)

        put("/fsw/supervisor/reference" if kept else "/fsw/reference", depth=0.0027, temperature=850.0)
        reference = Reference(0.0027 * 1e3, 850.0)
        for tick in range(ticks):
            stamp += TICK_NS + (50 * TICK_NS if tick == jump_at else 0)
            depth_m, temperature = m_from_mm(2.66 + 0.001 * (tick % 7)), 849.0 + 0.01 * (tick % 5)
            if tick == jump_at:
                controller.reset(applied)
                last = None
            put("/fsw/depth", depth=depth_m)
            put("/fsw/spindle_torque", torque=1050.0 + tick % 3)
            if tick != lost_sensor_at:
                put("/fsw/thermocouple", temperature=temperature)
            else:
                temperature = 849.0 + 0.01 * ((tick - 1) % 5)  # the last good sample stands in
            dt_s = 0.1 if last is None else (stamp - last) / 1e9
            last = stamp
            measured = Measurement(stamp * 1e-9, depth_m * 1e3, 1050.0, temperature)
            command = controller.step(measured, reference, applied, dt_s).command
            wire = {"axial_force": n_from_kn(command.force_kn), "spindle_speed": rad_s_from_rpm(command.speed_rpm)}
            put("/fsw/simple/proposal", source="simple", healthy=True, **wire)
            put("/fsw/command", source="simple", healthy=True, **wire)
            applied = Command(wire["axial_force"] * 1e-3, wire["spindle_speed"] / (3.141592653589793 / 30.0))
    return bag


def check(bag: Path, **changes: Any) -> Verification:
    return verify(bag, "simple", lambda _: Integrator(**changes))


@pytest.mark.parametrize(
    "options", [{}, {"jump_at": 20}, {"lost_sensor_at": 30}, {"space": "/hall/cell1"}, {"kept": True}]
)
def test_same_build_is_reproduced_bit_by_bit(tmp_path: Path, options: dict[str, Any]) -> None:
    result = check(record(tmp_path / "bag", **options))
    assert result.identical and result.ticks == 60 and result.notes == []
    assert result.lines() == ["simple: all 60 proposals reproduced bit by bit"]


def test_first_difference_is_found_however_small(tmp_path: Path) -> None:
    result = check(record(tmp_path / "bag"), odd_tick=33)
    assert [one.tick for one in result.differences] == [33]
    assert result.differences[0].time_s == pytest.approx(3.3)
    assert result.differences[0].force_kn == pytest.approx(1e-9, abs=2e-11) and result.differences[0].speed_rpm == 0.0
    assert "1 of 60 proposals differ" in "\n".join(result.lines()) and "tick 33" in "\n".join(result.lines())


def test_another_build_differs_from_the_start(tmp_path: Path) -> None:
    result = check(record(tmp_path / "bag"), gain=0.31)
    assert len(result.differences) == 60 and result.differences[0].tick == 0


def test_health_is_compared_too(tmp_path: Path) -> None:
    class Broken(Integrator):
        def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
            raise RuntimeError("broken")

    result = verify(record(tmp_path / "bag"), "simple", lambda _: Broken())
    assert "not healthy (controller raised RuntimeError: broken)" in result.differences[0].text


def test_bag_that_cannot_be_replayed(weld_bag: Path, tmp_path: Path, genuine: Path) -> None:
    with pytest.raises(BagError, match="has no"):
        check(genuine / "mcap_default")
    assert recorded_controllers(weld_bag) == ["decentral", "nmpc"]
    result = verify(weld_bag, "nmpc", lambda _: Integrator())
    assert not result.identical and any("no parameters" in note for note in result.notes)
