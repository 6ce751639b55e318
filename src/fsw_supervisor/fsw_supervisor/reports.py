"""The arbiter's state as messages: supervisor state, list of controllers, diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from fsw_control import messages_ros as convert
from fsw_msgs.msg import ControllerHealth, SupervisorState, WeldCommand
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.controller_registry import ControllerRecord
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import Decision

#: on the wire there is no mode "start": nothing changes then, as in hold
_WIRE_MODE = {Mode.START: Mode.HOLD}


def command(decision: Decision, token: str) -> WeldCommand:
    """Command message of a decision; ``token`` tells supervisors apart and stands in the frame id."""
    message = convert.command_message(
        decision.command, decision.stamp_ns, decision.source, healthy=True, reason=decision.reason
    )
    message.header.frame_id = token
    return message


def health(arbiter: Arbiter, record: ControllerRecord) -> ControllerHealth:
    """What is known of one controller."""
    return ControllerHealth(
        name=record.name,
        healthy=record.present and record.consecutive_good > 0,
        warm=record.consecutive_good >= arbiter.settings.warm_ticks,
        latched_out=bool(record.inhibited),
        tolerated_sensors=list(record.tolerated_sensors),
        reason=arbiter.registry.obstacle(record.name),
        consecutive_good=min(record.consecutive_good, 2**32 - 1),
        missed=min(record.missed, 2**32 - 1),
        late=min(record.late, 2**32 - 1),
        rejected=min(record.rejected, 2**32 - 1),
        latency_mean=record.latency.mean_s,
        latency_max=record.latency.max_s,
        jitter=record.latency.jitter_s,
    )


def mode(arbiter: Arbiter) -> str:
    """Actual mode as the messages name it."""
    return str(_WIRE_MODE.get(arbiter.machine.mode, arbiter.machine.mode))


def state(arbiter: Arbiter, now: Time, token: str) -> SupervisorState:
    """The latched state; ``token`` as for :func:`command`."""
    message = SupervisorState(
        target_controller=arbiter.machine.target,
        actual_controller=arbiter.machine.active,
        target_mode=str(arbiter.machine.target_mode),
        actual_mode=mode(arbiter),
        reason=arbiter.machine.reason,
        requested_by=arbiter.machine.requested_by,
        since=convert.stamp_from_ns(arbiter.machine.since_ns),
        transitions=arbiter.machine.transitions,
        controllers=[health(arbiter, record) for record in arbiter.registry],
        interlocks=list(arbiter.safety.active),
    )
    message.header.stamp, message.header.frame_id = now, token
    if arbiter.last is not None:
        message.applied = command(arbiter.last, token)
    return message


def standby(now: Time, name: str, role: str, unanswered: int) -> DiagnosticArray:
    """Diagnostics of a supervisor that is not on duty.

    Parameters
    ----------
    now : Time
        Stamp.
    name : str
        Name of its node.
    role : str
        What it is at present.
    unanswered : int
        Ticks in a row that nobody has answered.
    """
    level = DiagnosticStatus.WARN if unanswered else DiagnosticStatus.OK
    message = DiagnosticArray()
    message.header.stamp = now
    message.status = [_status(role, level, f"{role}: follows the supervisor on duty", {"unanswered ticks": unanswered})]
    message.status[0].hardware_id = name
    return message


def diagnostics(
    arbiter: Arbiter, now: Time, writers: int, namesakes: Mapping[str, int], limits: tuple[float, float]
) -> DiagnosticArray:
    """Diagnostics of the arbiter, its inputs and every controller.

    Parameters
    ----------
    arbiter : Arbiter
        Whose state.
    now : Time
        Stamp.
    writers : int
        Publishers of the command topic, this one included.
    namesakes : mapping of str to int
        Publishers of each controller's proposal topic.
    limits : (float, float)
        99 % latencies [s] to warn of and to call an error.
    """
    message = DiagnosticArray()
    message.header.stamp = now
    message.status = [_arbiter_status(arbiter), _writer_status(arbiter, writers), _process_status(arbiter)]
    message.status += [
        _controller_status(arbiter, record, namesakes.get(record.name, 0), limits) for record in arbiter.registry
    ]
    return message


def _status(name: str, level: bytes, text: str, values: Mapping[str, object]) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(name=f"fsw_supervisor: {name}", level=level, message=text, hardware_id="fsw", values=pairs)


def _arbiter_status(arbiter: Arbiter) -> DiagnosticStatus:
    machine = arbiter.machine
    level, text = DiagnosticStatus.OK, f"{machine.mode}: {machine.active}" if machine.active else str(machine.mode)
    if machine.mode is not machine.target_mode or (machine.active and machine.active != machine.target):
        level, text = DiagnosticStatus.WARN, f"{text} instead of {machine.target_mode} with {machine.target}"
    if machine.mode is Mode.SAFE_STOP:
        level = DiagnosticStatus.ERROR
    latency_ms = arbiter.last.latency_s * 1e3 if arbiter.last is not None else 0.0
    return _status(
        "arbiter",
        level,
        f"{text}: {machine.reason}",
        {
            "ticks": arbiter.machine.tick,
            "commands": arbiter.commands,
            "ticks without a command": arbiter.lost_ticks,
            "own stalls": arbiter.stalls,
            "transitions": arbiter.machine.transitions,
            "last latency [ms]": f"{latency_ms:.3f}",
        },
    )


def _writer_status(arbiter: Arbiter, writers: int) -> DiagnosticStatus:
    level, text = DiagnosticStatus.OK, "only writer of the command topic"
    if writers > 1:
        level, text = DiagnosticStatus.WARN, f"{writers} publishers on the command topic"
    if arbiter.foreign_writer:
        level, text = DiagnosticStatus.ERROR, "a foreign writer sends commands"
    foreign = arbiter.watch.foreign_commands
    return _status("command topic", level, text, {"publishers": writers, "foreign commands": foreign})


def _process_status(arbiter: Arbiter) -> DiagnosticStatus:
    level, parts = DiagnosticStatus.OK, list[str]()
    if not arbiter.measuring:
        level = DiagnosticStatus.WARN
        parts.append("no measurements")
    if arbiter.safety.invalid_sensors:
        level = DiagnosticStatus.WARN
        parts.append(f"invalid sensors: {', '.join(arbiter.safety.invalid_sensors)}")
    if arbiter.safety.active:
        level = DiagnosticStatus.ERROR if arbiter.safety.tripped else DiagnosticStatus.WARN
        parts.append(", ".join(arbiter.safety.active))
    reasons: dict[str, object] = {f"{name} state": why or "good" for name, why in arbiter.safety.sensor_reasons.items()}
    return _status("process", level, "; ".join(parts) or "sensors valid, inside all limits", reasons)


def _controller_status(
    arbiter: Arbiter, record: ControllerRecord, publishers: int, limits: tuple[float, float]
) -> DiagnosticStatus:
    obstacle = arbiter.registry.obstacle(record.name)
    p99_s = record.latency.quantile_s(0.99)
    level = DiagnosticStatus.WARN if obstacle else DiagnosticStatus.OK
    text = obstacle or ("active" if record.name == arbiter.machine.active else "ready")
    if not arbiter.lockstep and p99_s >= limits[0]:
        level = DiagnosticStatus.ERROR if p99_s >= limits[1] else max(level, DiagnosticStatus.WARN)
        text = f"{text}; slow: 99 % within {p99_s * 1e3:.1f} ms"
    if record.doubled:
        level, text = DiagnosticStatus.ERROR, f"proposes more than once per tick: two controllers called {record.name}?"
    elif publishers > 1:
        level = max(level, DiagnosticStatus.WARN)
        text = f"{text}; {publishers} publishers of its proposals"
    if record.inhibited:
        level = DiagnosticStatus.ERROR
    return _status(
        f"controller {record.name}",
        level,
        text,
        {
            "good in a row": record.consecutive_good,
            "missed": record.missed,
            "late": record.late,
            "rejected": record.rejected,
            "duplicates": record.duplicates,
            "latency mean [ms]": f"{record.latency.mean_s * 1e3:.3f}",
            "latency 99 % [ms]": f"{p99_s * 1e3:.3f}",
            "latency max [ms]": f"{record.latency.max_s * 1e3:.3f}",
            "jitter [ms]": f"{record.latency.jitter_s * 1e3:.3f}",
        },
    )
