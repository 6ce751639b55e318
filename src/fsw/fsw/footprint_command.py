"""``fsw.py footprint``: what the depth sensors of a weld showed too much, by its footprint."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fsw.bags import data_sha256, read_weld
from fsw.command import FORCE, command, file, number, option, repeated
from fsw.console import check_new, print_table, write_json
from fsw.errors import CommandError
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.depth_channels import CHANNELS, SENSOR, ChannelHealth, DepthFusionSettings
from fsw_control.depth_footprint import (
    Footprint,
    SensorBias,
    biases,
    measured_depths,
    smoothed,
)
from fsw_control.schema.ranges import Range
from fsw_control.sensors import DEPTH, SENSORS


@command(
    "footprint",
    "bias of each depth sensor by angle, from the depths measured in the footprint of a weld",
    option("bag", type=Path, help="bag of the weld"),
    file("measured", "measured depths (CSV with the columns angle_deg and depth_mm)"),
    file("--out", "footprint (JSON; default NAME.footprint.json)"),
    number("--deviation", "MM", Range(0.0, 1.0, "mm"), "deviation of the measured depths", 0.01),
    repeated("--without", "SENSOR", "leave out a sensor, e.g. one that failed in the weld"),
    FORCE,
    description="Compare the depth sensors of a weld with its footprint, and write their biases. "
    "The plant takes the file as prior of the next weld: parameter machine.footprint_file.",
)
def compare_footprint(arguments: argparse.Namespace) -> int:
    bag: Path = arguments.bag
    out = arguments.out or Path(f"{bag.name}.footprint.json")
    check_new([out], arguments.force)
    footprint = footprint_of(
        read_weld(bag),
        *measured_depths(arguments.measured),
        (bag.name, data_sha256(bag)),
        arguments.deviation,
        tuple(arguments.without),
    )
    rows = [
        (row.sensor, f"{np.mean(row.bias_mm):.3f}", f"{np.ptp(row.bias_mm):.3f}")
        for row in footprint.sensors
    ]
    print_table(rows, ("sensor", "mean bias [mm]", "range [mm]"), words=1)
    write_json(out, footprint.model_dump())
    print(f"written: {out}")
    return 0


def footprint_of(
    signals: WeldSignals,
    at_deg: FloatArray,
    depth_mm: FloatArray,
    source: tuple[str, str],
    deviation_mm: float,
    without: tuple[str, ...] = (),
) -> Footprint:
    """Footprint of a weld; ``source`` is the name and SHA-256 of its bag.

    Raises
    ------
    CommandError
        If no depth was recorded at a measured angle.
    """
    bias_of = biases(signals.angle_deg, _samples(signals), at_deg, depth_mm)
    known = np.isfinite(bias_of["depth"])
    if not known.any():
        raise CommandError("footprint: the weld has no depth at any of the measured angles")
    at_deg, depth_mm = at_deg[known], depth_mm[known]
    sensors = []
    for name, bias in bias_of.items():
        own = bias[known]
        ok = np.isfinite(own)
        if ok.any() and name not in without:
            mean, deviation = (
                tuple(values.round(5).tolist())
                for values in smoothed(at_deg[ok], own[ok], deviation_mm, at_deg)
            )
            sensors.append(SensorBias(sensor=name, bias_mm=mean, deviation_mm=deviation))
    return Footprint(
        weld=source[0],
        sha256=source[1],
        angle_deg=tuple(at_deg.tolist()),
        depth_mm=tuple(depth_mm.tolist()),
        deviation_mm=deviation_mm,
        sensors=tuple(sensors),
    )


def _samples(signals: WeldSignals) -> dict[str, FloatArray]:
    """Samples of all depth sensors, without the deflection that the estimator takes off itself.

    What the footprint of an earlier weld has taken off is in them again: biases add up.

    Those of a channel that was not good count as missing.
    """
    force_kn = signals.force_kn if signals.drives is None else signals.drives.force_kn
    pushed = np.nan_to_num(force_kn - DepthFusionSettings().calibration_force_kn)
    samples = {"depth": signals.depth_mm + signals.footprint_bias_mm}
    for name, row in SENSORS.items():
        channel = CHANNELS.get(name.removeprefix(SENSOR))
        if row.quantity is DEPTH and row.signal in signals.optional and channel is not None:
            shown = channel.deflection_mm_per_kn * pushed
            samples[name] = signals.optional[row.signal] - shown
            if signals.fused is not None:
                good = signals.fused.health[name] == ChannelHealth.GOOD
                samples[name] = np.where(good, samples[name], np.nan)
    return samples
