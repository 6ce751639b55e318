"""The watch over a recorded weld: the same monitor, tick by tick, and the time line of what it told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import yaml

from fsw_analysis.weld_signals import WeldSignals
from fsw_control.weld import TICK_S
from fsw_quality.diagnosis import Finding
from fsw_quality.monitor import Monitor, Sample
from fsw_recorder.errors import BagError
from fsw_schema.yaml_text import load_yaml

_PROGRESS_TICKS = 500


@dataclass(slots=True)
class Told:
    """An alarm from its begin to its end, as it was when it was surest."""

    begin_s: float
    end_s: float
    finding: Finding


@dataclass(slots=True)
class Watched:
    """What a monitor told of a weld."""

    alarms: list[Told] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)  #: of the figures, once a second
    figures: list[dict[str, float]] = field(default_factory=list)
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)  #: surest of each, with standard error
    correlations_s: dict[str, float] = field(default_factory=dict)  #: of each sensor's noise that is not white

    def largest(self) -> dict[str, float]:
        """Largest value of each figure."""
        found: dict[str, float] = {}
        for figures in self.figures:
            for name, value in figures.items():
                found[name] = max(value, found.get(name, value))
        return found

    def series(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """A figure over ``time_s``; NaN where it was not known."""
        return np.array([one.get(name, np.nan) for one in self.figures])


def process_of(signals: WeldSignals) -> str:
    """``canister`` if the scenario in the bag says so, or the bag is of a machine; else ``paper``."""
    text = signals.attachments.get("scenario.yaml")
    if text is None:
        return "paper" if signals.truth is not None else "canister"
    try:
        plant = load_yaml(text.decode("utf-8", "replace"))["plant"]
        return "canister" if plant["process"] == "canister" else "paper"
    except (yaml.YAMLError, KeyError, TypeError):
        return "paper"


def samples(signals: WeldSignals) -> Iterator[Sample]:
    """The ticks of a weld as a monitor in the graph sees them; without feedback of the drives, the commands act."""
    command_force, command_speed = (np.append([np.nan], one[:-1]) for one in (signals.force_kn, signals.speed_rpm))
    drives = signals.drives
    acting = (command_force, command_speed) if drives is None else (drives.force_kn, drives.speed_rpm)
    columns = (
        signals.time_s,
        signals.depth_mm,
        signals.torque_nm,
        signals.temperature_c,
        *acting,
        command_force,
        command_speed,
        signals.reference_depth_mm,
        signals.reference_temperature_c,
        signals.command_source,
    )
    for row in zip(*(one.tolist() for one in columns), strict=True):
        yield Sample(*row)


def watch(monitor: Monitor, signals: WeldSignals, progress: Callable[[float], None] | None = None) -> Watched:
    """Let a monitor watch a recorded weld.

    Raises
    ------
    fsw_recorder.errors.BagError
        There is no weld: not one second with all that is watched.
    """
    found, present = Watched(), dict[str, Told]()
    shown = monitor.figures
    for tick, sample in enumerate(samples(signals)):
        monitor.step(sample)
        if monitor.figures is not shown:
            shown = monitor.figures
            _note(found, present, monitor, sample.time_s)
        if progress is not None and tick % _PROGRESS_TICKS == 0:
            progress(tick / signals.n_ticks)
    if not found.time_s:
        lacking = "no second with depth, torque, temperature, force and speed to watch"
        raise BagError(f"{signals.path}: no weld in it: {lacking}")
    return found


def _note(found: Watched, present: dict[str, Told], monitor: Monitor, time_s: float) -> None:
    found.time_s.append(time_s)
    found.correlations_s = monitor.correlations_s
    found.figures.append(monitor.figures)
    now = {one.kind: one for one in monitor.findings}
    for kind in [kind for kind in present if kind not in now]:
        del present[kind]
    for kind, one in now.items():
        if kind not in present:
            present[kind] = Told(time_s, time_s, one)
            found.alarms.append(present[kind])
        present[kind].end_s = time_s + 10 * TICK_S
        if one.confidence > present[kind].finding.confidence:
            present[kind].finding = one
    blamed = any(one.of_sensor for one in monitor.findings)
    for name, (gain, error) in ({} if blamed else monitor.gains).items():
        if name not in found.gains or not error > found.gains[name][1]:
            found.gains[name] = gain, error
