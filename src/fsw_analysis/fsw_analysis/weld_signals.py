"""Signals of a weld: aligned arrays of shape (n_ticks,) in the paper's units, and as a table."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fsw_control.cause import Cause
from fsw_control.schema.files import replacing
from fsw_control.units import NANOSECONDS, RAD_PER_S_PER_RPM
from fsw_control.weld import TICK_NS
from fsw_recorder.errors import BagError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
TextArray = npt.NDArray[np.object_]
#: of a table of signals
Column = npt.NDArray[Any]

#: stamps below this are of simulated time, which begins at 0
SIMULATED_NS = NANOSECONDS * 10**8
MM, KN, KW, RPM = 1e3, 1e-3, 1e-3, 1.0 / RAD_PER_S_PER_RPM


def experiment_time_s(stamp_ns: IntArray) -> FloatArray:
    """Scenario time of each tick: the stamp in simulated time, else 0.1 s for the first tick."""
    simulated = stamp_ns.size and stamp_ns[0] < SIMULATED_NS
    since_ns = stamp_ns - (0 if simulated else stamp_ns[:1] - TICK_NS)
    return since_ns.astype(np.float64) * 1e-9


def of(path: str, factor: float = 1.0, kind: str = "number") -> dict[str, Any]:
    """Source of a signal: field of the message, factor to the paper's unit, kind of the field.

    Kinds are ``number``, ``text``, ``texts`` (joined with ``,``), and of no single field
    ``latency`` and ``reason``.
    """
    return {"path": path, "factor": factor, "kind": kind}


@dataclass(slots=True)
class ProposalSignals:
    """Candidate commands of one controller, and its health; NaN or empty without an answer.

    ``healthy`` is 1 or 0, ``reason`` says why not, and ``latency_s`` is from the tick's first
    recorded measurement to the recorded proposal, by receive time.
    """

    force_kn: FloatArray = field(metadata=of("axial_force", KN))
    speed_rpm: FloatArray = field(metadata=of("spindle_speed", RPM))
    healthy: FloatArray = field(metadata=of("healthy"))
    reason: TextArray = field(metadata=of("", kind="reason"))
    latency_s: FloatArray = field(metadata=of("", kind="latency"))


@dataclass(slots=True)
class StatusSignals:
    """Estimates and solver of one controller; NaN or empty without a status.

    ``healthy`` and ``selected`` are 1 or 0, ``bad_cycles`` counts ticks without an accepted result
    since the start, and ``disturbances`` has the disturbance estimates by the name the controller
    gave them (with unit), as on the wire.
    """

    depth_estimate_mm: FloatArray = field(metadata=of("depth_estimate", MM))
    temperature_estimate_c: FloatArray = field(metadata=of("temperature_estimate"))
    torque_estimate_nm: FloatArray = field(metadata=of("torque_estimate"))
    healthy: FloatArray = field(metadata=of("healthy"))
    selected: FloatArray = field(metadata=of("selected"))
    solve_time_s: FloatArray = field(metadata=of("solve_time"))
    iterations: FloatArray = field(metadata=of("iterations"))
    bad_cycles: FloatArray = field(metadata=of("bad_cycles"))
    solver_status: TextArray = field(metadata=of("solver_status", kind="text"))
    reason: TextArray = field(metadata=of("", kind="reason"))
    active_limits: TextArray = field(metadata=of("active_limits", kind="texts"))
    disturbances: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(slots=True)
class DriveSignals:
    """Inputs that act, as the drives measured them, with disturbances; NaN if missing."""

    force_kn: FloatArray = field(metadata=of("axial_force", KN))
    speed_rpm: FloatArray = field(metadata=of("spindle_speed", RPM))


@dataclass(slots=True)
class FusedSignals:
    """Channels behind a fused depth; NaN if missing."""

    deviation_mm: FloatArray  #: standard deviation of the depth
    #: by sensor, 1 at ticks whose depth rests on it, else 0
    used: dict[str, FloatArray]
    #: by sensor, code of its health (``fsw_control.depth_channels``)
    health: dict[str, FloatArray]


@dataclass(slots=True)
class TruthSignals:
    """Noise-free truth of the plant emulator; NaN or empty if missing.

    Outputs include output disturbances; force and speed are those after limits, rate limits, lag
    and input disturbance. ``copper_temperature_c`` is the first lag of the temperature,
    ``watchdog`` is 0 ok, 1 hold, 2 safe state, and ``refused_commands`` counts since the last
    reset.
    """

    depth_mm: FloatArray = field(metadata=of("depth", MM))
    temperature_c: FloatArray = field(metadata=of("temperature"))
    copper_temperature_c: FloatArray = field(metadata=of("copper_temperature"))
    motor_torque_nm: FloatArray = field(metadata=of("motor_torque"))
    process_torque_nm: FloatArray = field(metadata=of("process_torque"))
    friction_torque_nm: FloatArray = field(metadata=of("friction_torque"))
    process_power_kw: FloatArray = field(metadata=of("process_power", KW))
    force_kn: FloatArray = field(metadata=of("axial_force", KN))
    speed_rpm: FloatArray = field(metadata=of("spindle_speed", RPM))
    depth_disturbance_mm: FloatArray = field(metadata=of("depth_disturbance", MM))
    temperature_disturbance_c: FloatArray = field(metadata=of("temperature_disturbance"))
    force_disturbance_kn: FloatArray = field(metadata=of("force_disturbance", KN))
    speed_disturbance_rpm: FloatArray = field(metadata=of("speed_disturbance", RPM))
    watchdog: FloatArray = field(metadata=of("watchdog"))
    refused_commands: FloatArray = field(metadata=of("refused_commands"))
    active_faults: TextArray = field(metadata=of("active_faults", kind="texts"))


@dataclass(slots=True, repr=False)
class WeldSignals:
    """All of a recorded weld, aligned on the plant's ticks.

    A tick is one stamp of the sensor topics; every array has shape (n_ticks,). Values missing at a
    tick are NaN (numbers) or empty (text). Units are the paper's: mm, degC, N m, kN, rpm, kW, s.
    """

    path: Path  #: the bag
    stamp_ns: IntArray  #: stamp of every tick [ns], strictly increasing
    time_s: FloatArray  #: of every tick on the scenario's clock [s]: its first tick is at 0.1 s
    #: the sensors, as reported (noise, faults and all)
    depth_mm: FloatArray
    torque_nm: FloatArray
    temperature_c: FloatArray
    #: set-points in force at the tick
    reference_depth_mm: FloatArray
    reference_temperature_c: FloatArray
    #: the applied command that answers the tick
    force_kn: FloatArray
    speed_rpm: FloatArray
    #: source of the applied command, and the reason if not nominal
    command_source: TextArray
    command_reason: TextArray
    #: from the tick's first recorded measurement to the recorded command, by receive time [s]
    command_latency_s: FloatArray
    #: selection of the supervisor at the tick (held from the last message)
    actual_controller: TextArray
    actual_mode: TextArray
    #: optional sensors that the bag has, by signal of the row in ``fsw_control.sensors``, e.g.
    #: ``depth_lvdt_mm``
    optional: dict[str, FloatArray] = field(default_factory=dict)
    #: by controller name (``nmpc``, ``decentral``, …)
    proposals: dict[str, ProposalSignals] = field(default_factory=dict)
    statuses: dict[str, StatusSignals] = field(default_factory=dict)
    #: bias by the footprint of an earlier weld that was taken off the depth, and the SHA-256 of
    #: each such file
    footprint_bias_mm: FloatArray | float = 0.0
    footprints_sha256: tuple[str, ...] = ()
    fused: FusedSignals | None = None  #: None where the depth is that of one sensor
    drives: DriveSignals | None = None  #: feedback of the drives; None when the bag has none
    truth: TruthSignals | None = (
        None  #: the plant emulator's truth; None when the bag has none (a real weld)
    )
    #: the bag's attachments, e.g. ``scenario.yaml``, ``parameters/fsw_nmpc.yaml``,
    #: ``versions.json``
    attachments: dict[str, bytes] = field(default_factory=dict)
    #: custom data of the recorder, e.g. ``canister.id``, and its count of lost
    #: messages
    custom: dict[str, str] = field(default_factory=dict)
    #: messages per topic; names are those without the weld's namespace
    counts: dict[str, int] = field(default_factory=dict)
    namespace: str = ""  #: in which the weld ran; empty or e.g. ``/hall/cell1``
    #: faults of the bag that could be worked around (cut end, damaged chunk, unknown
    #: order, …)
    problems: list[str] = field(default_factory=list)
    #: name and begin [s], like ``time_s``, of each phase that a programme ran through
    phases: list[tuple[str, float]] = field(default_factory=list)
    events: list[WeldEvent] = field(default_factory=list)  #: in order of time
    #: set-points of the programme at the tick, not those in force while it is held or operated by
    #: hand; those in force where the bag has no programme
    programme_depth_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    programme_temperature_c: FloatArray = field(default_factory=lambda: np.empty(0))
    #: angle of the tool about the canister's axis, by the programme; NaN without one
    angle_deg: FloatArray = field(default_factory=lambda: np.empty(0))
    #: distance travelled along the weld; NaN without a programme
    travel_mm: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if not self.programme_depth_mm.size:
            self.programme_depth_mm = self.reference_depth_mm
            self.programme_temperature_c = self.reference_temperature_c
        if not self.angle_deg.size:
            self.angle_deg = np.full(self.n_ticks, np.nan)
        if not self.travel_mm.size:
            self.travel_mm = np.full(self.n_ticks, np.nan)

    def __repr__(self) -> str:
        return f"WeldSignals({str(self.path)!r}, {self.n_ticks} ticks, {self.duration_s:g} s)"

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return int(self.stamp_ns.size)

    @property
    def duration_s(self) -> float:
        """From the first tick to the last [s]; 0 with fewer than two ticks."""
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size else 0.0

    def phase_names(self, time_s: FloatArray | None = None) -> TextArray:
        """Phase at each tick or at other times; empty without a programme."""
        names = np.array([name for name, _ in self.phases] or [""], object)
        begins = [begin_s - 1e-6 for _, begin_s in self.phases[1:]]
        roles: TextArray = names[
            np.searchsorted(begins, self.time_s if time_s is None else time_s, side="right")
        ]
        return roles

    @property
    def operators(self) -> tuple[str, ...]:
        """Operators with requests, in order of time."""
        return tuple(dict.fromkeys(event.who for event in self.events if event.kind == "operator"))


#: by kind of event
_WORDS = {
    "phase": "phase {subject}",
    "weld": "weld {subject}",
    "swap": "{subject} commands ({why})",
    "mode": "mode {subject} ({why})",
    "takeover": "another supervisor leads",
    "interlock": "interlock {subject}, {state}",
    "interlock over": "interlock {subject}, {state}, is over",
    "operator": "{who}: {subject}: {state}",
    "alarm": "{priority} alarm {state}: {subject}",
    "alarm shelved": "{priority} alarm {state} by {who}, {detail}: {subject}",
    "procedure": "{subject} revision {revision}, SHA-256 {sha256}",
    "deviation": "{detail}",
    "estimate": "monitor: {detail}",
    "finding": "monitor: {detail}",
    "finding over": "monitor: no longer: {detail}",
    "fault": "emulated fault {subject}",
    "fault over": "emulated faults are over",
}


@dataclass(frozen=True, slots=True)
class WeldEvent:
    """Something on the time line of a weld."""

    time_s: float  #: on the clock of `WeldSignals.time_s`
    #: ``phase``, ``weld``, ``swap``, ``mode``, ``takeover``, ``interlock``, ``operator``,
    #: ``alarm``, ``procedure``, ``deviation``, ``finding``, ``estimate`` or ``fault``
    kind: str
    #: the phase, what the weld became, the controller, the mode, the interlock, what was asked
    #: for, what the alarm says, the procedure, what the monitor found or estimated, or the faults
    subject: str = ""
    #: of an interlock ``warn``, ``trip`` or ``unknown``, of a request its outcome, of an alarm
    #: what became of it
    state: str = ""
    is_over: bool = False  #: an interlock or fault ends
    cause: Cause = Cause.UNKNOWN  #: of a swap or a mode
    who: str = ""  #: the operator
    detail: str = ""  #: for people
    data: Mapping[str, str] = field(default_factory=dict)  #: more, by kind

    @property
    def text(self) -> str:
        """The event in words."""
        key = self.kind
        if self.is_over or self.state == "shelved":
            key = f"{self.kind} {'over' if self.is_over else 'shelved'}"
        facts = {
            "subject": self.subject or "no controller",
            "state": self.state,
            "who": self.who,
            "detail": self.detail,
            "why": self._why(),
        }
        words = _WORDS[key].format_map({**self.data, **facts})
        return f"{words}: {self.detail}" if self.kind == "operator" and self.detail else words

    def _why(self) -> str:
        cause = self.who or self.cause.words
        return f"{cause}: {self.detail}" if self.detail else cause


def weld_table(signals: WeldSignals) -> dict[str, Column]:
    """All signals as columns of one table; every array has shape (n_ticks,).

    Names are those of `WeldSignals`; what belongs to the drives' feedback begins with ``drives_``,
    to the plant's truth with ``truth_``, to a controller with ``<controller>_proposal_`` or
    ``<controller>_status_``.
    """
    groups: dict[str, Any] = {"": signals, "drives_": signals.drives, "truth_": signals.truth}
    groups |= {f"{name}_proposal_": group for name, group in signals.proposals.items()}
    groups |= {f"{name}_status_": group for name, group in signals.statuses.items()}
    return dict(
        column
        for prefix, group in groups.items()
        if group is not None
        for column in _columns(prefix, group)
    )


def _columns(prefix: str, group: Any) -> Iterator[tuple[str, Column]]:
    values = {item.name: getattr(group, item.name) for item in fields(group)}
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            yield prefix + name, value
    yield from values.get("optional", {}).items()
    for name, value in values.get("disturbances", {}).items():
        yield f"{prefix}disturbance {name}", value


def export_weld(signals: WeldSignals, target: Path) -> int:
    """Write all signals of a weld to a CSV file; returns the number of rows.

    Raises
    ------
    BagError
        The name does not end in ``.csv``, or the file cannot be written.
    """
    if target.suffix.lower() != ".csv":
        raise BagError(f"{target}: only CSV tables can be written; the name must end in .csv")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as part:
            write_table(weld_table(signals), part)
    except OSError as error:
        raise BagError(f"{target}: cannot be written: {error.strerror or error}") from None
    return signals.n_ticks


def write_table(table: Mapping[str, Column], target: Path) -> None:
    """Write columns as CSV.

    A missing number is an empty cell, and numbers have all their digits.
    """
    columns = [
        ["" if value != value else value for value in values.tolist()] for values in table.values()
    ]
    with target.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table)
        writer.writerows(zip(*columns, strict=True))
