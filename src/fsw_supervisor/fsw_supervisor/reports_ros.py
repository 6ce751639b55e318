"""The arbiter's state as messages: commands, state, health of controllers, diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt
from statistics import fmean

from builtin_interfaces.msg import Time

from fsw_control import messages_ros as convert
from fsw_control.fence import Signature
from fsw_control.reports_ros import ERROR, OK, WARN, Report
from fsw_msgs.msg import ControllerHealth, Interlock, SupervisorState, WeldCommand
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.controller_registry import ControllerRecord
from fsw_supervisor.facts import Code
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.state_machine import Level, Mode
from fsw_supervisor.tick import Decision

#: severity of an event as a diagnostic level
LEVELS = {Level.INFO: OK, Level.WARN: WARN, Level.ERROR: ERROR}
#: default fallbacks, which need not all run
_SHIPPED = frozenset(ArbiterSettings.from_values({}).fallbacks)


def command(decision: Decision, signature: Signature) -> WeldCommand:
    """Command message of a decision, signed by its supervisor."""
    message = convert.command_message(
        decision.command, decision.stamp_ns, decision.source, healthy=True, why=decision.reason
    )
    convert.sign(message, signature)
    return message


def health(arbiter: Arbiter, record: ControllerRecord) -> ControllerHealth:
    """Health of a controller."""
    latencies_s, readiness = record.latencies_s or (0.0,), arbiter.registry.readiness(record.name)
    mean_s = fmean(latencies_s)
    return ControllerHealth(
        name=record.name,
        healthy=record.present and record.consecutive_good > 0,
        warm=record.consecutive_good >= arbiter.settings.warm_ticks,
        latched_out=bool(record.inhibited),
        tolerated_sensors=list(record.tolerated_sensors),
        lack=readiness.lack,
        why=convert.chain_messages(readiness.reason),
        missing_sensors=list(readiness.sensors),
        consecutive_good=record.consecutive_good,
        required_good=arbiter.settings.warm_ticks,
        missed=record.missed,
        late=record.late,
        rejected=record.rejected,
        latency_mean=mean_s,
        latency_max=max(latencies_s),
        jitter=sqrt(fmean((value - mean_s) ** 2 for value in latencies_s)),
    )


def state(arbiter: Arbiter, now: Time, signature: Signature) -> SupervisorState:
    """The latched state, signed as a :func:`command`."""
    machine = arbiter.machine
    standing = machine.standing
    message = SupervisorState(
        target_controller=machine.target,
        actual_controller=standing.controller,
        target_mode=str(machine.target_mode),
        actual_mode=standing.mode,
        why=convert.chain_messages(standing.reason),
        cause=standing.cause,
        who=standing.who,
        since=convert.stamp_from_ns(machine.since_ns),
        transitions=machine.transitions,
        controllers=[health(arbiter, record) for record in arbiter.registry],
        interlocks=[
            Interlock(name=name, level=level) for name, level in arbiter.safety.active.items()
        ],
    )
    message.header.stamp = now
    convert.sign(message, signature)
    if arbiter.ticks.last is not None:
        message.applied = command(arbiter.ticks.last, signature)
    return message


def standby(role: str, unanswered: int, node: str) -> Report:
    """Diagnostics of a ``node`` on standby that has seen ``unanswered`` ticks in a row."""
    level, values = WARN if unanswered else OK, {"unanswered ticks": unanswered, "node": node}
    return Report(role, level, f"{role}: follows the leading supervisor", values)


def diagnostics(
    arbiter: Arbiter, writers: int, namesakes: Mapping[str, int], limits: tuple[float, float]
) -> list[Report]:
    """Diagnostics of the arbiter, its inputs and every controller.

    ``writers`` counts the publishers of the command topic, this one included, ``namesakes`` the
    publishers of each controller's proposals; ``limits`` are the 99 % latencies [s] for warnings
    and errors.
    """
    controllers = [
        _controller_status(arbiter, record, namesakes.get(record.name, 0), limits)
        for record in arbiter.registry
    ]
    return [
        _arbiter_status(arbiter),
        _writer_status(arbiter, writers),
        _process_status(arbiter),
        *controllers,
    ]


def _arbiter_status(arbiter: Arbiter) -> Report:
    machine = arbiter.machine
    level, text = OK, f"{machine.mode}: {machine.active}" if machine.active else str(machine.mode)
    absent = [name for name in arbiter.settings.fallbacks if arbiter.registry.get(name) is None]
    if machine.mode is not Mode.START and not _SHIPPED.issuperset(absent):
        level, text = WARN, f"{text}; fallbacks that are not in the graph: {', '.join(absent)}"
    if machine.mode is not machine.target_mode or (
        machine.active and machine.active != machine.target
    ):
        level, text = WARN, f"{text} instead of {machine.target_mode} with {machine.target}"
    if machine.mode is Mode.SAFE_STOP:
        level = ERROR
    latency_ms = arbiter.ticks.last.latency_s * 1e3 if arbiter.ticks.last is not None else 0.0
    values = {
        "ticks": machine.tick,
        "commands": arbiter.ticks.commands,
        "ticks without a command": arbiter.ticks.lost,
        "own stalls": arbiter.ticks.stalls,
        "transitions": machine.transitions,
        "fallbacks not in the graph": ", ".join(absent),
        "last latency [ms]": f"{latency_ms:.3f}",
    }
    return Report("arbiter", level, f"{text}: {machine.reason.words}", values)


def _writer_status(arbiter: Arbiter, writers: int) -> Report:
    level, text = OK, "only writer of the command topic"
    if writers > 1:
        level, text = WARN, f"{writers} publishers on the command topic"
    if arbiter.watch.seen_lately(arbiter.ticks.now_s):
        level, text = ERROR, "a foreign writer sends commands"
    foreign = arbiter.watch.foreign_commands
    return Report(
        "command topic", level, text, {"publishers": writers, "foreign commands": foreign}
    )


def _process_status(arbiter: Arbiter) -> Report:
    safety, level, parts = arbiter.safety, OK, list[str]()
    if not arbiter.ticks.measuring:
        level = WARN
        parts.append(
            "stamps do not advance"
            if arbiter.ticks.silence is Code.CLOCK_STANDS
            else "no measurements"
        )
    if safety.invalid_sensors:
        level = WARN
        parts.append(f"invalid sensors: {', '.join(safety.invalid_sensors)}")
    if safety.active:
        level = ERROR if safety.tripped else WARN
        parts += [f"{name} {level.word}" for name, level in safety.active.items()]
    reasons: dict[str, object] = {
        f"{name} state": why or "good" for name, why in safety.sensor_flaws.items()
    }
    reasons["held"] = ", ".join(safety.held_sensors) or "none"
    return Report(
        "process", level, "; ".join(parts) or "sensors valid, all values within limits", reasons
    )


def _controller_status(
    arbiter: Arbiter, record: ControllerRecord, publishers: int, limits: tuple[float, float]
) -> Report:
    known = health(arbiter, record)
    latencies_s = sorted(record.latencies_s) or [0.0]
    p99_s = latencies_s[ceil(0.99 * len(latencies_s)) - 1]
    lacks = arbiter.registry.readiness(record.name).words(record.name)
    level = WARN if lacks else OK
    text = lacks or ("active" if record.name == arbiter.machine.active else "ready")
    if not arbiter.lockstep and p99_s >= limits[0]:
        level = ERROR if p99_s >= limits[1] else WARN
        text = f"{text}; slow: 99 % within {p99_s * 1e3:.1f} ms"
    if record.doubled:
        level, text = (
            ERROR,
            f"proposes more than once per tick: two controllers called {record.name}?",
        )
    elif publishers > 1:
        level = max(level, WARN)
        text = f"{text}; {publishers} publishers of its proposals"
    if record.inhibited:
        level = ERROR
    values = {
        "good in a row": record.consecutive_good,
        "missed": record.missed,
        "late": record.late,
        "rejected": record.rejected,
        "duplicates": record.duplicates,
        "latency mean [ms]": f"{known.latency_mean * 1e3:.3f}",
        "latency 99 % [ms]": f"{p99_s * 1e3:.3f}",
        "latency max [ms]": f"{known.latency_max * 1e3:.3f}",
        "jitter [ms]": f"{known.jitter * 1e3:.3f}",
    }
    return Report(f"controller {record.name}", level, text, values)
