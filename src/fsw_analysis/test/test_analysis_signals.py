"""Signals come out of a bag aligned, in the paper's units, whatever its state."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fsw_analysis.signals import load_weld
from fsw_analysis.weld_signals import WeldSignals, export_weld, weld_table
from fsw_recorder import BagError
from fsw_recorder.bag_writer import BagWriter
from fsw_test_support.sample_weld import (
    START_NS,
    TICK_NS,
    SampleTypes,
    sample_messages,
    sample_topics,
)


@pytest.fixture(scope="module")
def signals(weld_bag: Path) -> WeldSignals:
    return load_weld(weld_bag)


def test_units_and_alignment(signals: WeldSignals) -> None:
    assert str(signals.n_ticks) in repr(signals) and len(repr(signals)) < 300
    assert signals.n_ticks == 300 and signals.problems == []
    assert np.array_equal(signals.stamp_ns, START_NS + TICK_NS * np.arange(300))
    assert signals.duration_s == pytest.approx(29.9)
    phase = np.arange(300) / 50.0
    assert signals.depth_mm == pytest.approx(2.66 + 0.01 * np.sin(phase), rel=1e-12)
    assert signals.torque_nm == pytest.approx(1052.86 + np.sin(phase), rel=1e-12)
    assert signals.temperature_c == pytest.approx(816.0 + np.cos(phase), rel=1e-12)
    assert signals.force_kn == pytest.approx(78.4 + 0.5 * np.sin(phase), rel=1e-12)
    assert signals.speed_rpm == pytest.approx(
        (42.68 + 0.1 * np.cos(phase)) * 30.0 / np.pi, rel=1e-12
    )
    assert signals.reference_depth_mm == pytest.approx(
        2.66
    ) and signals.reference_temperature_c == pytest.approx(816.0)
    assert signals.command_latency_s == pytest.approx(0.0091)
    assert set(signals.command_source[:150]) == {"decentral"} and set(
        signals.command_source[150:]
    ) == {"nmpc"}
    assert signals.actual_controller[0] == "decentral" and signals.actual_controller[-1] == "nmpc"
    assert signals.attachments == {"scenario.yaml": b"name: made-up weld\n"}
    assert signals.counts["/fsw/depth"] == 300


def test_controllers_and_truth(signals: WeldSignals) -> None:
    assert set(signals.proposals) == set(signals.statuses) == {"nmpc", "decentral"}
    status = signals.statuses["nmpc"]
    assert status.disturbances["depth [m]"] == pytest.approx(1e-6 * np.arange(300))
    assert status.solve_time_s == pytest.approx(0.004) and set(status.solver_status) == {"optimal"}
    assert status.active_limits[7] == "force_max" and status.active_limits[8] == ""
    assert signals.proposals["nmpc"].force_kn == pytest.approx(signals.force_kn)
    assert signals.proposals["nmpc"].latency_s == pytest.approx(0.0086)
    assert signals.drives is not None
    assert signals.drives.force_kn == pytest.approx(signals.force_kn)
    assert signals.drives.speed_rpm == pytest.approx(signals.speed_rpm)
    assert signals.truth is not None
    assert signals.truth.process_power_kw == pytest.approx(43.6)
    assert signals.truth.depth_disturbance_mm[-1] == pytest.approx(0.05)
    assert signals.truth.active_faults[120] == "thermocouple:freeze"


def rewrite(bag: Path, keep: object) -> Path:
    assert callable(keep)
    with BagWriter(bag) as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        seen: dict[str, int] = {}
        for name, time_ns, data in sample_messages(50):
            seen[name] = seen.get(name, -1) + 1
            for kept in keep(seen[name], name, data):
                writer.write(name, kept, time_ns, time_ns)
    return bag


def test_missing_sensor_samples_are_nan(tmp_path: Path) -> None:
    bag = rewrite(
        tmp_path / "bag", lambda i, name, data: [] if name == "/fsw/depth" and i % 2 else [data]
    )
    loaded = load_weld(bag)
    assert loaded.n_ticks == 50
    assert np.isnan(loaded.depth_mm).tolist() == [bool(tick % 2) for tick in range(50)]
    assert not np.isnan(loaded.torque_nm).any()


def test_duplicates_and_damaged_messages(tmp_path: Path) -> None:
    def keep(index: int, name: str, data: bytes) -> list[bytes]:
        if name == "/fsw/depth" and index % 5 == 3:
            return [data[:11]]
        return [data, data] if name == "/fsw/spindle_torque" else [data]

    loaded = load_weld(rewrite(tmp_path / "bag", keep))
    assert loaded.n_ticks == 50 and not np.isnan(loaded.torque_nm).any()
    assert any("/fsw/depth" in problem and "damaged" in problem for problem in loaded.problems)


def test_first_message_of_a_stamp_counts(tmp_path: Path) -> None:
    latest = {name: data for name, _, data in sample_messages(50)}
    no_tick = ("/fsw/reference", "/fsw/supervisor/state", "/diagnostics")

    def with_another(_: int, name: str, data: bytes) -> list[bytes]:
        return (
            [data] if name in no_tick else [data, data[:12] + latest[name][12:]]
        )  # the first 12 bytes: the stamp

    once = weld_table(load_weld(rewrite(tmp_path / "once", lambda _, name, data: [data])))
    twice = weld_table(load_weld(rewrite(tmp_path / "twice", with_another)))
    assert list(once) == list(twice)
    for name, values in once.items():
        np.testing.assert_array_equal(twice[name], values, name)


def test_weld_without_truth_and_controllers(tmp_path: Path) -> None:
    sensors = ("/fsw/depth", "/fsw/spindle_torque", "/fsw/thermocouple")
    loaded = load_weld(
        rewrite(tmp_path / "bag", lambda _, name, data: [data] if name in sensors else [])
    )
    assert loaded.truth is None and loaded.proposals == {}
    assert np.isnan(loaded.force_kn).all() and set(loaded.command_source) == {""}


def test_foreign_and_empty_bags(genuine: Path, tmp_path: Path) -> None:
    assert load_weld(genuine / "sqlite3").n_ticks == 44  # it has /fsw/thermocouple
    bag = rewrite(
        tmp_path / "foreign", lambda _, name, data: [data] if name == "/diagnostics" else []
    )
    with pytest.raises(BagError, match=r"not the bag of a weld.*it has /diagnostics"):
        load_weld(bag)
    BagWriter(tmp_path / "empty").close()
    with pytest.raises(BagError, match="no messages"):
        load_weld(tmp_path / "empty")


def test_csv(signals: WeldSignals, tmp_path: Path) -> None:
    assert export_weld(signals, tmp_path / "new" / "weld.csv") == 300
    with (tmp_path / "new" / "weld.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 300 and set(rows[0]) == set(weld_table(signals))
    assert [float(row["depth_mm"]) for row in rows] == signals.depth_mm.tolist()
    assert rows[120]["truth_active_faults"] == "thermocouple:freeze"
    assert rows[3]["nmpc_status_disturbance depth [m]"] == repr(
        signals.statuses["nmpc"].disturbances["depth [m]"][3].item()
    )


def test_export_refusals(signals: WeldSignals, tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"\.csv"):
        export_weld(signals, tmp_path / "weld.xlsx")
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written"):
        export_weld(signals, tmp_path / "file" / "weld.csv")


def test_set_points_whose_sender_had_left_are_those_that_the_supervisor_keeps(
    tmp_path: Path,
) -> None:
    kept = "/fsw/supervisor/reference"
    with BagWriter(tmp_path / "bag") as writer:
        for topic in sample_topics():
            writer.add_topic(replace(topic, name=topic.name.replace("/fsw/reference", kept)))
        for name, time_ns, data in sample_messages(50):
            if name != "/fsw/reference":
                writer.write(name, data, time_ns, time_ns)
            elif time_ns < START_NS + TICK_NS:
                writer.write(kept, data, time_ns, time_ns)
    signals = load_weld(tmp_path / "bag")
    assert signals.reference_depth_mm == pytest.approx(
        2.66
    ) and signals.reference_temperature_c == pytest.approx(816.0)
    assert signals.problems == []


def in_namespaces(bag: Path, *namespaces: str) -> Path:
    """A short weld, once in each namespace."""
    with BagWriter(bag) as writer:
        for space in namespaces:
            for topic in sample_topics():
                writer.add_topic(replace(topic, name=space + topic.name))
            for name, time_ns, data in sample_messages(20):
                writer.write(space + name, data, time_ns, time_ns)
    return bag


def test_weld_in_a_namespace_reads_as_without(tmp_path: Path) -> None:
    spaced = load_weld(in_namespaces(tmp_path / "spaced", "/hall/cell1"))
    plain = load_weld(in_namespaces(tmp_path / "plain", ""))
    np.testing.assert_array_equal(weld_table(spaced)["depth_mm"], weld_table(plain)["depth_mm"])
    assert list(spaced.proposals) == list(plain.proposals)
    assert set(spaced.actual_controller) == set(plain.actual_controller)


def test_several_welds_in_one_bag_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="several welds, in /cell1, /cell2"):
        load_weld(in_namespaces(tmp_path / "both", "/cell1", "/cell2"))


def test_fused_depth_lists_its_channels(tmp_path: Path, signals: WeldSignals) -> None:
    """Of the ticks that say so; a depth of one sensor says nothing."""
    assert signals.fused is None
    types = SampleTypes()
    with BagWriter(tmp_path / "bag") as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        for name, time_ns, data in sample_messages(30):
            if name == "/fsw/depth" and time_ns >= START_NS + 10 * TICK_NS:
                stamp_ns = time_ns - 400_000
                stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
                values = {"depth": 2.66e-3, "standard_deviation": 2e-5, "channels_used": 0b1101}
                values |= {"footprint_bias": 1e-4, "footprint": "f" * 64}
                health = np.array([0, 5, 0, 0], np.uint8)
                values |= {"header": {"stamp": stamp}, "channel_health": health}
                data = types.serialize("fsw_msgs/msg/ShoulderDepth", values)
            writer.write(name, data, time_ns, time_ns)
    loaded = load_weld(tmp_path / "bag")
    assert loaded.footprints_sha256 == ("f" * 64,)
    assert list(loaded.footprint_bias_mm) == pytest.approx([0.0] * 10 + [0.1] * 20)
    fused = loaded.fused
    assert fused is not None
    assert fused.deviation_mm[10:] == pytest.approx(0.02)
    assert np.isnan(fused.health["depth_laser"][:10]).all()
    assert set(fused.health["depth_lvdt_lead"][10:]) == {5.0}
    assert fused.used["depth_lvdt_lead"].sum() == 0.0
    assert fused.used["depth_axial"].sum() == 20.0
