"""What analysis gets from the bag of a weld: aligned arrays in the paper's units."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
TextArray = npt.NDArray[np.object_]

#: set-points; the latter where recording began after their sender had left
REFERENCE_TOPICS = ("/fsw/reference", "/fsw/supervisor/reference")


@dataclass(slots=True)
class ProposalSignals:
    """What one controller would have applied; every array has shape (n_ticks,).

    Attributes
    ----------
    force_kn, speed_rpm : FloatArray
        Proposed axial force [kN] and spindle speed [rpm]; NaN where no proposal answers the tick.
    healthy : FloatArray
        1 healthy, 0 not healthy, NaN no proposal.
    reason : TextArray
        Why not healthy; empty when nominal or missing.
    latency_s : FloatArray
        From the tick's first recorded measurement to the recorded proposal, by receive time [s].
    """

    force_kn: FloatArray
    speed_rpm: FloatArray
    healthy: FloatArray
    reason: TextArray
    latency_s: FloatArray


@dataclass(slots=True)
class StatusSignals:
    """How one controller was doing; every array has shape (n_ticks,).

    Attributes
    ----------
    depth_estimate_mm, temperature_estimate_c, torque_estimate_nm : FloatArray
        Estimates; NaN where missing.
    healthy, selected : FloatArray
        1, 0 or NaN (no status at the tick).
    solve_time_s, iterations, bad_cycles : FloatArray
        Solver effort per tick and ticks without an accepted result since start.
    solver_status, reason, active_limits : TextArray
        Text per tick; several active limits are joined with ``,``.
    disturbances : dict[str, FloatArray]
        Disturbance estimates by the name the controller gave them (with unit), as on the wire.
    """

    depth_estimate_mm: FloatArray
    temperature_estimate_c: FloatArray
    torque_estimate_nm: FloatArray
    healthy: FloatArray
    selected: FloatArray
    solve_time_s: FloatArray
    iterations: FloatArray
    bad_cycles: FloatArray
    solver_status: TextArray
    reason: TextArray
    active_limits: TextArray
    disturbances: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(slots=True)
class TruthSignals:
    """Noise-free truth of the plant emulator; every array has shape (n_ticks,), NaN where missing.

    Attributes
    ----------
    depth_mm, temperature_c, motor_torque_nm, process_torque_nm, friction_torque_nm, process_power_kw : FloatArray
        Outputs, including output disturbances.
    force_kn, speed_rpm : FloatArray
        Handles after limits, rate limits, lag and input disturbance.
    depth_disturbance_mm, temperature_disturbance_c, force_disturbance_kn, speed_disturbance_rpm : FloatArray
        Disturbances that act at the tick.
    watchdog : FloatArray
        0 ok, 1 hold, 2 safe state.
    refused_commands : FloatArray
        Commands refused since the last reset.
    active_faults : TextArray
        Sensor faults that act at the tick, joined with ``,``.
    """

    depth_mm: FloatArray
    temperature_c: FloatArray
    motor_torque_nm: FloatArray
    process_torque_nm: FloatArray
    friction_torque_nm: FloatArray
    process_power_kw: FloatArray
    force_kn: FloatArray
    speed_rpm: FloatArray
    depth_disturbance_mm: FloatArray
    temperature_disturbance_c: FloatArray
    force_disturbance_kn: FloatArray
    speed_disturbance_rpm: FloatArray
    watchdog: FloatArray
    refused_commands: FloatArray
    active_faults: TextArray


@dataclass(frozen=True, slots=True)
class WeldEvent:
    """Something that happened once.

    Attributes
    ----------
    time_s : float
        Seconds since the first tick.
    kind : str
        ``reference``, ``controller``, ``mode``, ``fault``, ``disturbance``, ``watchdog``, ``switch_request`` or
        ``diagnostic``.
    text : str
        What happened, in words.
    """

    time_s: float
    kind: str
    text: str


@dataclass(slots=True)
class WeldSignals:
    """All of a recorded weld, aligned on the plant's ticks.

    A tick is one stamp of the sensor topics; every array has shape (n_ticks,). Values missing at a tick are NaN
    (numbers) or empty (text). Units are the paper's: mm, degC, N m, kN, rpm, kW, s.

    Attributes
    ----------
    path : Path
        The bag.
    stamp_ns : IntArray
        Stamp of every tick [ns], strictly increasing.
    time_s : FloatArray
        ``stamp_ns`` relative to the first tick [s].
    depth_mm, torque_nm, temperature_c : FloatArray
        The sensors, as reported (noise, faults and all).
    reference_depth_mm, reference_temperature_c : FloatArray
        Set-points in force at the tick (held from the last message).
    force_kn, speed_rpm : FloatArray
        The applied command that answers the tick.
    command_source, command_reason : TextArray
        Who computed the applied command, and why if not nominal.
    command_latency_s : FloatArray
        From the tick's first recorded measurement to the recorded command, by receive time [s].
    actual_controller, actual_mode : TextArray
        What the supervisor had selected at the tick (held from the last message).
    proposals : dict[str, ProposalSignals]
        By controller name (``nmpc``, ``decentral``, …).
    statuses : dict[str, StatusSignals]
        By controller name.
    truth : TruthSignals or None
        The plant emulator's truth; None when the bag has none (a real weld).
    events : list[WeldEvent]
        In order of time.
    attachments : dict[str, bytes]
        The bag's attachments, e.g. ``scenario.yaml``, ``parameters.yaml``, ``versions.json``.
    counts : dict[str, int]
        Messages per topic.
    problems : list[str]
        What was wrong with the bag and could be worked around (cut end, damaged chunk, undecodable message, …).
    """

    path: Path
    stamp_ns: IntArray
    time_s: FloatArray
    depth_mm: FloatArray
    torque_nm: FloatArray
    temperature_c: FloatArray
    reference_depth_mm: FloatArray
    reference_temperature_c: FloatArray
    force_kn: FloatArray
    speed_rpm: FloatArray
    command_source: TextArray
    command_reason: TextArray
    command_latency_s: FloatArray
    actual_controller: TextArray
    actual_mode: TextArray
    proposals: dict[str, ProposalSignals] = field(default_factory=dict)
    statuses: dict[str, StatusSignals] = field(default_factory=dict)
    truth: TruthSignals | None = None
    events: list[WeldEvent] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return int(self.stamp_ns.size)

    @property
    def duration_s(self) -> float:
        """From the first tick to the last [s]; 0 with fewer than two ticks."""
        return float(self.time_s[-1]) if self.time_s.size else 0.0
