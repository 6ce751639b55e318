"""The watch over a recorded weld.

The same monitor, tick by tick, and the time line of what it found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import yaml

from fsw_analysis.weld_signals import WeldSignals
from fsw_control.schema.yaml_text import load_yaml
from fsw_quality.diagnosis import Estimate, Finding, WatchCause
from fsw_quality.monitor import Monitor, Sample
from fsw_quality.sensor_health import LEARN_S
from fsw_recorder.errors import BagError

_PROGRESS_TICKS = 500


@dataclass(slots=True)
class Interval:
    """A finding from its begin to its end, as it was when it was surest."""

    begin_s: float
    end_s: float
    finding: Finding


@dataclass(slots=True)
class Watched:
    """What a monitor found in a weld."""

    alarms: list[Interval] = field(default_factory=list)
    others: list[Interval] = field(default_factory=list)  #: shown, and no alarm
    time_s: list[float] = field(default_factory=list)  #: of what follows, once a second
    #: torque [N m], force [kN] and temperature [degC] that neither the model nor its coefficients
    #: explain
    disturbances: list[tuple[float, float, float]] = field(default_factory=list)
    #: smoothed log likelihood ratio of the likeliest fault, by which alarms are decided
    ratios: list[float] = field(default_factory=list)
    estimates: list[list[Estimate]] = field(default_factory=list)  #: of each fault of the process
    gains: dict[str, tuple[float, float]] = field(
        default_factory=dict
    )  #: at the end, with standard errors

    def drifts(self, learnt_s: float = LEARN_S) -> tuple[float, float, float]:
        """Largest changes of the disturbances after those of the begin were learnt.

        NaN in a shorter weld.
        """
        late = np.array(self.disturbances)[np.array(self.time_s) > self.time_s[0] + learnt_s]
        if not late.size:
            return (np.nan,) * 3
        torque, force, heat = np.abs(late - late[0]).max(axis=0).tolist()
        return torque, force, heat


def process_of(signals: WeldSignals) -> str:
    """``canister`` if the scenario in the bag says so, or the bag is of a machine.

    Else ``paper``.
    """
    text = signals.attachments.get("scenario.yaml")
    if text is None:
        return "paper" if signals.truth is not None else "canister"
    try:
        plant = load_yaml(text.decode("utf-8", "replace"))["plant"]
        return "canister" if plant["process"] == "canister" else "paper"
    except (yaml.YAMLError, KeyError, TypeError):
        return "paper"


def samples(signals: WeldSignals) -> Iterator[Sample]:
    """The ticks of a weld as a monitor in the graph sees them.

    Without feedback of the drives, the commands act.
    """
    command_force, command_speed = (
        np.append([np.nan], values[:-1]) for values in (signals.force_kn, signals.speed_rpm)
    )
    drives = signals.drives
    acting = (
        (command_force, command_speed) if drives is None else (drives.force_kn, drives.speed_rpm)
    )
    columns = (
        signals.time_s,
        signals.depth_mm,
        signals.torque_nm,
        signals.temperature_c,
        *acting,
        command_force,
        command_speed,
    )
    for row in zip(*(column.tolist() for column in columns), strict=True):
        yield Sample(*row)


def watch(
    monitor: Monitor, signals: WeldSignals, progress: Callable[[float], None] | None = None
) -> Watched:
    """Let a monitor watch a recorded weld.

    Raises
    ------
    fsw_recorder.errors.BagError
        There is no weld: not one second with all that is watched.
    """
    watched, present = Watched(), dict[tuple[WatchCause, bool], Interval]()
    seconds = monitor.seconds
    for tick, sample in enumerate(samples(signals)):
        monitor.step(sample)
        if monitor.seconds != seconds:
            seconds = monitor.seconds
            _note(watched, present, monitor, sample.time_s)
        if progress is not None and tick % _PROGRESS_TICKS == 0:
            progress(tick / signals.n_ticks)
    if not watched.time_s:
        lacking = "no second with depth, torque, temperature, force and speed to watch"
        raise BagError(f"{signals.path}: no weld in it: {lacking}")
    watched.gains = monitor.gains
    return watched


def _note(
    watched: Watched,
    present: dict[tuple[WatchCause, bool], Interval],
    monitor: Monitor,
    time_s: float,
) -> None:
    watched.time_s.append(time_s)
    watched.disturbances.append(monitor.disturbances)
    watched.ratios.append(monitor.process.ratio)
    watched.estimates.append(monitor.estimates)
    now = {(finding.cause, finding.alarm): finding for finding in monitor.findings}
    for key in [key for key in present if key not in now]:
        del present[key]
    for key, finding in now.items():
        if key not in present:
            present[key] = Interval(time_s, time_s, finding)
            (watched.alarms if finding.alarm else watched.others).append(present[key])
        present[key].end_s = time_s + 1.0
        if not finding.log_likelihood < present[key].finding.log_likelihood:
            present[key].finding = finding
