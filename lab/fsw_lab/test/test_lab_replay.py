"""Deterministic replay.

The recorded build reproduces its proposals, a different one is detected.
"""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import yaml

from fsw_analysis.messages import WeldMessages
from fsw_analysis.signals import load_weld
from fsw_control.contract import Coming, Command, Measurement, Proposal, Reference
from fsw_control.units import m_from_mm, n_from_kn, rad_s_from_rpm
from fsw_lab.replay import Replay, replay
from fsw_lab.shadow import write_shadow
from fsw_recorder import BagError
from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.definitions import interface_definition, interface_hash
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

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        ahead = [point.depth_mm for point in reference.coming][:1]
        error = sum([reference.depth_mm, *ahead]) / (1 + len(ahead)) - measurement.depth_mm
        self.total += error * dt_s
        self.ticks += 1
        extra = 1e-9 if self.ticks - 1 == self.odd_tick else 0.0
        force = applied.force_kn + self.gain * error + 0.01 * self.total + extra
        return Proposal(
            Command(
                force,
                applied.speed_rpm + 0.001 * (reference.temperature_c - measurement.temperature_c),
            )
        )


KINDS = {
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
FIRST, OTHER = Reference(0.0027 * 1e3, 850.0), Reference(0.0028 * 1e3, 855.0)


def header(at_ns: int) -> dict[str, Any]:
    return {"stamp": {"sec": at_ns // 10**9, "nanosec": at_ns % 10**9}}


class Tape:
    """Writes messages, each a microsecond later than the one before it, with the stamp of the tick."""

    def __init__(self, writer: BagWriter, space: str, begin_ns: int) -> None:
        self._writer, self._space, self._types, self._now = writer, space, SampleTypes(), begin_ns
        self.stamp = 1_000_000_000 + begin_ns // TICK_NS * TICK_NS
        for name, kind in KINDS.items():
            writer.add_topic(
                RecordedTopic(space + name, kind, interface_definition(kind), interface_hash(kind))
            )
        values = {"initial_force": 80.0, "initial_speed": 400.0, "period": 0.1}
        text = yaml.safe_dump({f"{space}/fsw_simple": {"ros__parameters": values}})
        file = f"{space}/fsw_simple".strip("/").replace("/", ".")
        writer.attach(f"parameters/{file}.yaml", "application/yaml", text.encode())

    def put(self, topic: str, at_once: bool = False, **fields: Any) -> None:
        self._now += 1000
        values = {"header": header(0 if at_once else self.stamp), **fields}
        self._writer.write(
            self._space + topic,
            self._types.serialize(KINDS[topic], values),
            self._now,
            self._now - 1,
        )

    def put_reference(
        self, reference: Reference, topic: str = "/fsw/reference", at_once: bool = False
    ) -> None:
        self.put(
            topic,
            at_once,
            depth=m_from_mm(reference.depth_mm),
            temperature=reference.temperature_c,
        )

    def announce(self, coming: Reference, at_ns: int) -> None:
        depth_m, temperature_c = m_from_mm(coming.depth_mm), coming.temperature_c
        message = {"header": header(at_ns), "depth": depth_m, "temperature": temperature_c}
        self.put("/fsw/reference_plan", references=[message])


def temperature_at(tick: int) -> float:
    return 849.0 + 0.01 * (tick % 5)


def on_wire(command: Command) -> dict[str, Any]:
    return {
        "axial_force": n_from_kn(command.force_kn),
        "spindle_speed": rad_s_from_rpm(command.speed_rpm),
    }


def followed(
    tape: Tape, tick: int, reference: Reference, late: str, stated: bool, announced: bool
) -> Reference:
    """The set-points that the controller follows in a tick, after those of the last one.

    See `record`.
    """
    if tick == 30 and late == "before the samples":
        tape.put_reference(OTHER, at_once=True)
    if tick == 31 and late:
        reference = OTHER
    if stated and tick in (0, 31):
        tape.put_reference(reference, "/fsw/simple/reference")
    if announced and tick == 19:  # before its samples; the plan holds after them
        tape.announce(OTHER, tape.stamp + 21 * TICK_NS)
    if announced and tick == 20:
        at_s = (tape.stamp + 20 * TICK_NS) / 1e9
        reference = replace(reference, coming=(Coming(at_s, OTHER.depth_mm, OTHER.temperature_c),))
    if announced and tick == 40:  # it does not come true
        reference = replace(reference, coming=())
    return reference


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
    late_command_at: int = -1,
    late_sample_at: int = -1,
) -> Path:
    """Bag of a run in which `Integrator` answers a made-up depth, as its node would.

    ``late``: at tick 30 other set-points come "before the samples" of the tick or "before its
    proposal", and the controller follows them from the next tick on; ``stated``: it says which
    ones it follows. ``announced``: from tick 20 on a change at tick 40 is announced.
    ``late_command_at``, ``late_sample_at``: the command applied before, or the thermocouple's
    sample, comes after the controller has answered this tick.
    """
    controller, applied, reference, last = Integrator(), INITIAL, FIRST, None
    held: dict[str, Any] | None = None
    controller.reset(applied)
    with BagWriter(bag) as writer:
        tape = Tape(writer, space, begin_ns)
        tape.put_reference(FIRST, "/fsw/supervisor/reference" if kept else "/fsw/reference")
        for tick in range(ticks):
            tape.stamp += TICK_NS + (50 * TICK_NS if tick == jump_at else 0)
            if tick == jump_at:
                controller.reset(applied)
                last = None
            reference = followed(tape, tick, reference, late, stated, announced)
            depth_m, temperature = m_from_mm(2.66 + 0.001 * (tick % 7)), temperature_at(tick)
            tape.put("/fsw/depth", depth=depth_m)
            tape.put("/fsw/spindle_torque", torque=1050.0 + tick % 3)
            if tick not in (lost_sensor_at, late_sample_at):
                tape.put("/fsw/thermocouple", temperature=temperature)
            else:
                temperature = temperature_at(tick - 1)  # the last good sample stands in
            if by_hand and tick == 30:
                tape.put_reference(FIRST)
            if tick == 30 and late == "before its proposal":
                tape.put_reference(OTHER, at_once=True)
            dt_s, last = 0.1 if last is None else (tape.stamp - last) / 1e9, tape.stamp
            seen = Measurement(tape.stamp * 1e-9, depth_m * 1e3, 1050.0, temperature)
            wire = on_wire(controller.step(seen, reference, applied, dt_s).command)
            tape.put("/fsw/simple/proposal", source="simple", healthy=True, **wire)
            if tick == late_sample_at:
                tape.put("/fsw/thermocouple", temperature=temperature_at(tick))
            if held:
                tape.put("/fsw/command", source="simple", healthy=True, **held)
            held = None
            if tick + 1 == late_command_at:
                held = {**wire, "header": header(tape.stamp)}
                continue
            tape.put("/fsw/command", source="simple", healthy=True, **wire)
            applied = Command(
                wire["axial_force"] * 1e-3, wire["spindle_speed"] / (3.141592653589793 / 30.0)
            )
    return bag


def check(bag: Path, kind: type[Integrator] = Integrator, **changes: Any) -> Replay:
    return replay(WeldMessages(bag), "simple", lambda _: kind(**changes))


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
        {"late_command_at": 25, "begin_ns": 2**60},
        {"late_sample_at": 25, "begin_ns": 2**60},
    ],
)
def test_same_build_is_reproduced_bit_by_bit(tmp_path: Path, options: dict[str, Any]) -> None:
    again = check(record(tmp_path / "bag", **options))
    result = again.against_own("simple")
    assert result.identical and result.ticks == 60 and again.notes == []
    assert [[word for word in line.split() if word.isdigit()] for line in result.lines()] == [
        ["60"]
    ]


def test_first_difference_is_found_however_small(tmp_path: Path) -> None:
    result = check(record(tmp_path / "bag"), odd_tick=33).against_own("simple")
    assert [difference.tick for difference in result.differences] == [33]
    assert result.differences[0].time_s == pytest.approx(4.4)  # the first stamp is 1.1 s
    assert (
        result.differences[0].force_kn == pytest.approx(1e-9, abs=2e-11)
        and result.differences[0].speed_rpm == 0.0
    )
    assert "1 of 60 proposals differ" in "\n".join(result.lines()) and "tick 33" in "\n".join(
        result.lines()
    )
    values = json.loads(json.dumps(result.values(), allow_nan=False))
    assert (values["differing"], values["first_tick"], values["speed_rpm"]["largest"]) == (
        1,
        33,
        0.0,
    )
    force = values["force_kn"]
    assert force["largest_s"] == pytest.approx(4.4) and force["mean"] == pytest.approx(
        force["largest"] / 60
    )


def test_differences_within_the_tolerance_count_as_equal(tmp_path: Path) -> None:
    again = check(record(tmp_path / "bag"), odd_tick=33)
    for tolerance, beyond in ((1e-10, 0), (1e-12, 1)):  # 1e-9 kN of some 80 kN is 1.2e-11
        result = again.against_own("simple", tolerance)
        assert not result.identical and len(result.beyond) == beyond
        assert ("1e-10" in result.lines()[0]) == (not beyond)


def test_no_tolerance_covers_health_or_what_is_not_finite(tmp_path: Path) -> None:
    class Broken(Integrator):
        def step(
            self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
        ) -> Proposal:
            return Proposal(applied, healthy=False)

    again = check(record(tmp_path / "bag"), Broken)
    assert len(again.against_own("simple", 1e9).beyond) == 60
    assert (
        again.against_applied("applied", 1e9).beyond == []
    )  # of a command only the values are compared


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize(
    ("begin", "by_hand", "noted"), [(1, True, False), (2**60, True, True), (2**60, False, False)]
)
def test_manual_set_points_in_real_time_are_reported(
    tmp_path: Path, begin: int, by_hand: bool, noted: bool, stated: bool
) -> None:
    bag = record(tmp_path / "bag", begin_ns=begin, by_hand=by_hand, stated=stated)
    assert any("by hand" in note for note in check(bag).notes) == noted


def test_bag_that_begins_in_mid_weld_is_reported(tmp_path: Path) -> None:
    """A recorder that was started again gets the set-points that the controller stated before, as they are latched."""
    with (
        BagReader(record(tmp_path / "whole", stated=True)) as reader,
        BagWriter(tmp_path / "rest") as writer,
    ):
        for topic in reader.topics().values():
            writer.add_topic(topic)
        for file in reader.attachments():
            writer.attach(file.name, file.media_type, file.data)
        depths = 0
        for record_ in reader.records():
            depths += record_.topic == "/fsw/depth"
            if depths > 20 or record_.topic.endswith("/reference"):
                writer.write(
                    record_.topic, record_.data, record_.log_time_ns, record_.publish_time_ns
                )
    again = check(tmp_path / "rest")
    result = again.against_own("simple")
    assert (result.ticks, result.identical, again.comparable) == (40, False, False)
    assert any("mid-weld" in note for note in again.notes)
    assert check(tmp_path / "whole").comparable


#: which receive times a recorder has noted instead of each right one, with the publish time
RECEIVED: dict[str, Callable[[BagRecord], list[int]]] = {
    "all twice": lambda record: [record.log_time_ns] * 2,
    "all twice, later": lambda record: [record.log_time_ns, record.log_time_ns + 1500],
    "clock set back": lambda record: [
        record.log_time_ns - (3600 * 10**9 if record.log_time_ns > 2**60 + 200_000 else 0)
    ],
    "clock set back a little": lambda record: [
        record.log_time_ns - (150_000 if record.log_time_ns > 2**60 + 200_000 else 0)
    ],
    "all the same": lambda _record: [2**60],
    "no time now and then": lambda record: [
        (0 if record.log_time_ns // 1000 % 7 == 0 else record.log_time_ns)
    ],
    "no time at last": lambda record: [
        (2**64 - 1 if record.log_time_ns // 1000 % 7 == 0 else record.log_time_ns)
    ],
}


def received(
    source: Path, bag: Path, change: Callable[[BagRecord], list[int]], published: bool = True
) -> Path:
    """A copy of a bag with other receive times; without publish times these are the same."""
    with BagReader(source) as reader, BagWriter(bag) as writer:
        for topic in reader.topics().values():
            writer.add_topic(topic)
        for file in reader.attachments():
            writer.attach(file.name, file.media_type, file.data)
        for record in reader.records():
            for log_ns in change(record):
                writer.write(
                    record.topic,
                    record.data,
                    log_ns,
                    record.publish_time_ns if published else log_ns,
                )
    return bag


@pytest.mark.parametrize("change", RECEIVED.values(), ids=RECEIVED)
def test_wrong_receive_times_change_nothing(
    tmp_path: Path, change: Callable[[BagRecord], list[int]]
) -> None:
    source = record(tmp_path / "source", begin_ns=2**60, announced=True, late_command_at=25)
    messages = WeldMessages(received(source, tmp_path / "bag", change))
    again = replay(messages, "simple", lambda _: Integrator())
    result = again.against_own("simple")
    assert (result.ticks, result.identical, len(messages.problems)) == (60, True, 1), (
        result.lines()
    )


def test_without_publish_times_wrong_receive_times_cannot_be_compared(tmp_path: Path) -> None:
    source = record(tmp_path / "source", begin_ns=2**60)
    again = check(received(source, tmp_path / "bag", RECEIVED["clock set back"], published=False))
    assert (again.comparable, again.against_own("simple").identical) == (False, False)
    assert any("go back" in note for note in again.notes)


def test_tick_that_the_plant_has_repeated_is_replayed_once(tmp_path: Path) -> None:
    """The controller has then sent the same proposal again, without another step."""
    source, proposals = record(tmp_path / "source", stated=True), count()

    def change(record: BagRecord) -> list[int]:
        own = record.topic == "/fsw/simple/proposal"
        return (
            [record.log_time_ns, record.log_time_ns + 100]
            if own and next(proposals) == 30
            else [record.log_time_ns]
        )

    result = check(received(source, tmp_path / "bag", change, published=False)).against_own(
        "simple"
    )
    assert (result.ticks, result.identical) == (60, True)


def test_another_build_differs_from_the_start(tmp_path: Path) -> None:
    result = check(record(tmp_path / "bag"), gain=0.31).against_own("simple")
    assert len(result.differences) == 60 and result.differences[0].tick == 0


def test_health_is_compared_too(tmp_path: Path) -> None:
    class Broken(Integrator):
        def step(
            self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
        ) -> Proposal:
            raise RuntimeError("broken")

    result = check(record(tmp_path / "bag"), Broken).against_own("simple")
    assert "RuntimeError: broken" in result.differences[0].text


def test_bag_that_cannot_be_replayed(weld_bag: Path, genuine: Path) -> None:
    with pytest.raises(BagError, match="has no"):
        check(genuine / "mcap_default")
    again = replay(WeldMessages(weld_bag), "nmpc", lambda _: Integrator())
    assert not again.against_own("nmpc").identical and any(
        "no parameters" in note for note in again.notes
    )


@pytest.mark.parametrize("space", ["", "/hall/cell1"])
@pytest.mark.parametrize("duration_s", [math.inf, 2.0])
def test_bag_of_a_shadow_holds_what_the_controller_was_shown(
    tmp_path: Path, space: str, duration_s: float
) -> None:
    bag = record(tmp_path / "bag", space=space)
    messages = WeldMessages(bag)
    shown = replay(
        messages,
        "simple",
        lambda _: Integrator(gain=0.5),
        changed={"period": 0.2},
        duration_s=duration_s,
    )
    ticks = 60 if duration_s == math.inf else 20
    assert len(shown.proposals) == ticks and shown.against_applied("applied").ticks == ticks
    write_shadow(shown, bag, space, tmp_path / "shadow")
    with BagReader(tmp_path / "shadow") as reader:
        info = reader.info()
    assert reader.problems == [] and reader.metadata.custom_data["shadow_of"] == "bag"
    assert (
        info.counts[f"{space}/fsw/depth"] == info.counts[f"{space}/fsw/simple/proposal"] == ticks
    )
    again = check(tmp_path / "shadow", gain=0.5)
    assert (
        again.against_own("simple").identical
        and again.notes == []
        and again.parameters["period"] == 0.2
    )
    assert load_weld(tmp_path / "shadow").n_ticks == ticks


def test_a_controller_that_was_not_in_the_weld_gets_the_ticks_of_the_sensors(
    tmp_path: Path,
) -> None:
    result = replay(
        WeldMessages(record(tmp_path / "bag", jump_at=20)), "other", lambda _: Integrator()
    )
    assert len(result.stamps) == 60 and result.parameters["initial_force"] == pytest.approx(
        80.0, abs=0.1
    )
    assert (
        result.against_own("nothing").ticks == 0 and result.against_applied("applied").ticks == 60
    )
