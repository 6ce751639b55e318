"""Deterministic replay: the recorded build reproduces its proposals, a different one is detected."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from fsw_analysis.verify import Verification, recorded_controllers, verify
from fsw_control.contract import Coming, Command, Measurement, Proposal, Reference
from fsw_control.units import m_from_mm, n_from_kn, rad_s_from_rpm
from fsw_recorder import BagError
from fsw_recorder.bag_reader import BagReader
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
        ahead = [one.depth_mm for one in reference.coming][:1]
        error = sum([reference.depth_mm, *ahead]) / (1 + len(ahead)) - measurement.depth_mm
        self.total += error * dt_s
        self.ticks += 1
        extra = 1e-9 if self.ticks - 1 == self.odd_tick else 0.0
        force = applied.force_kn + self.gain * error + 0.01 * self.total + extra
        return Proposal(
            Command(force, applied.speed_rpm + 0.001 * (reference.temperature_c - measurement.temperature_c))
        )


def record(
    bag: Path,
    ticks: int = 60,
    jump_at: int = -1,
    lost_sensor_at: int = -1,
    space: str = "",
    kept: bool = False,
    begin_ns: int = 1,
    by_hand: bool = False,
    late: str = "",
    stated: bool = False,
    announced: bool = False,
) -> Path:
    """Bag of a run in which `Integrator` answers a made-up depth, as its node would.

    ``late``: at tick 30 other set-points come "before the samples" of the tick or "before its proposal", and the
    controller follows them from the next tick on; ``stated``: it says which ones it follows. ``announced``: before
    tick 20 a change at tick 40 is announced.
    """
    types = SampleTypes()
    kinds = {
        "/fsw/depth": "fsw_msgs/msg/ShoulderDepth",
        "/fsw/spindle_torque": "fsw_msgs/msg/SpindleTorque",
        "/fsw/thermocouple": "sensor_msgs/msg/Temperature",
        "/fsw/reference": "fsw_msgs/msg/WeldReference",
        "/fsw/reference_plan": "fsw_msgs/msg/WeldReferencePlan",
        "/fsw/supervisor/reference": "fsw_msgs/msg/WeldReference",
        "/fsw/command": "fsw_msgs/msg/WeldCommand",
        "/fsw/simple/proposal": "fsw_msgs/msg/WeldCommand",
        "/fsw/simple/reference": "fsw_msgs/msg/WeldReference",
    }
    controller, applied = Integrator(), INITIAL
    controller.reset(applied)
    stamp, last, now = 1_000_000_000 + begin_ns // TICK_NS * TICK_NS, None, begin_ns
    with BagWriter(bag) as writer:
        for name, kind in kinds.items():
            writer.add_topic(RecordedTopic(space + name, kind, interface_definition(kind), interface_hash(kind)))
        values = {"initial_force": 80.0, "initial_speed": 400.0, "period": 0.1}
        text = yaml.safe_dump({f"{space}/fsw_simple": {"ros__parameters": values}})
        file = f"{space}/fsw_simple".strip("/").replace("/", ".")
        writer.attach(f"parameters/{file}.yaml", "application/yaml", text.encode())

        def put(topic: str, at_once: bool = False, **fields: Any) -> None:
            nonlocal now
            now += 1000
            at = 0 if at_once else stamp
            header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}}
            writer.write(space + topic, types.serialize(kinds[topic], {"header": header, **fields}), now, now - 1)

        put("/fsw/supervisor/reference" if kept else "/fsw/reference", depth=0.0027, temperature=850.0)
        reference = Reference(0.0027 * 1e3, 850.0)
        for tick in range(ticks):
            stamp += TICK_NS + (50 * TICK_NS if tick == jump_at else 0)
            depth_m, temperature = m_from_mm(2.66 + 0.001 * (tick % 7)), 849.0 + 0.01 * (tick % 5)
            if tick == jump_at:
                controller.reset(applied)
                last = None
            if tick == 30 and late == "before the samples":
                put("/fsw/reference", at_once=True, depth=0.0028, temperature=855.0)
            if stated and tick in (0, 31):
                stated_mm = reference.depth_mm if tick == 0 or not late else 0.0028 * 1e3
                put("/fsw/simple/reference", depth=m_from_mm(stated_mm), temperature=855.0 if tick and late else 850.0)
            if tick == 31 and late:
                reference = Reference(0.0028 * 1e3, 855.0)
            if announced and tick == 20:
                at = stamp + 20 * TICK_NS
                header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}}
                put("/fsw/reference_plan", references=[{"header": header, "depth": 0.0028, "temperature": 855.0}])
                reference = replace(reference, coming=(Coming(at / 1e9, 0.0028 * 1e3, 855.0),))
            if announced and tick == 40:  # it does not come true
                reference = replace(reference, coming=())
            put("/fsw/depth", depth=depth_m)
            put("/fsw/spindle_torque", torque=1050.0 + tick % 3)
            if tick != lost_sensor_at:
                put("/fsw/thermocouple", temperature=temperature)
            else:
                temperature = 849.0 + 0.01 * ((tick - 1) % 5)  # the last good sample stands in
            if by_hand and tick == 30:
                put("/fsw/reference", depth=0.0027, temperature=850.0)
            if tick == 30 and late == "before its proposal":
                put("/fsw/reference", at_once=True, depth=0.0028, temperature=855.0)
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
    "options",
    [
        {},
        {"jump_at": 20},
        {"lost_sensor_at": 30},
        {"space": "/hall/cell1"},
        {"kept": True},
        {"late": "before its proposal"},
        {"late": "before its proposal", "stated": True},
        {"late": "before the samples", "stated": True},
        {"announced": True},
    ],
)
def test_same_build_is_reproduced_bit_by_bit(tmp_path: Path, options: dict[str, Any]) -> None:
    result = check(record(tmp_path / "bag", **options))
    assert result.identical and result.ticks == 60 and result.notes == []
    assert result.lines() == ["simple: all 60 proposals reproduced bit by bit"]


def test_first_difference_is_found_however_small(tmp_path: Path) -> None:
    result = check(record(tmp_path / "bag"), odd_tick=33)
    assert [one.tick for one in result.differences] == [33]
    assert result.differences[0].time_s == pytest.approx(4.4)  # the first stamp is 1.1 s
    assert result.differences[0].force_kn == pytest.approx(1e-9, abs=2e-11) and result.differences[0].speed_rpm == 0.0
    assert "1 of 60 proposals differ" in "\n".join(result.lines()) and "tick 33" in "\n".join(result.lines())


def test_differences_within_the_tolerance_count_as_equal(tmp_path: Path) -> None:
    bag = record(tmp_path / "bag")
    for tolerance, beyond in ((1e-10, 0), (1e-12, 1)):  # 1e-9 kN of some 80 kN is 1.2e-11
        result = verify(bag, "simple", lambda _: Integrator(odd_tick=33), tolerance=tolerance)
        assert not result.identical and len(result.beyond) == beyond
        assert ("within the tolerance" in result.lines()[0]) == (not beyond)


def test_no_tolerance_covers_health_or_what_is_not_finite(tmp_path: Path) -> None:
    class Broken(Integrator):
        def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
            return Proposal(applied, healthy=False)

    result = verify(record(tmp_path / "bag"), "simple", lambda _: Broken(), tolerance=1e9)
    assert len(result.beyond) == 60


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize(("begin", "by_hand", "noted"), [(1, True, False), (2**60, True, True), (2**60, False, False)])
def test_set_points_by_hand_in_real_time_are_told(
    tmp_path: Path, begin: int, by_hand: bool, noted: bool, stated: bool
) -> None:
    bag = record(tmp_path / "bag", begin_ns=begin, by_hand=by_hand, stated=stated)
    assert any("by hand in real time" in note for note in check(bag).notes) == noted


def test_bag_that_begins_in_mid_weld_is_told(tmp_path: Path) -> None:
    """A recorder that was started again gets the set-points that the controller stated before, as they are latched."""
    with BagReader(record(tmp_path / "whole", stated=True)) as reader, BagWriter(tmp_path / "rest") as writer:
        for topic in reader.topics().values():
            writer.add_topic(topic)
        for file in reader.attachments():
            writer.attach(file.name, file.media_type, file.data)
        depths = 0
        for record_ in reader.records():
            depths += record_.topic == "/fsw/depth"
            if depths > 20 or record_.topic.endswith("/reference"):
                writer.write(record_.topic, record_.data, record_.log_time_ns, record_.publish_time_ns)
    result = check(tmp_path / "rest")
    assert (result.ticks, result.identical, result.comparable) == (40, False, False)
    assert any("mid-weld" in note for note in result.notes)
    assert check(tmp_path / "whole").comparable


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
