"""The arbiter's state as messages: commands, state, health of controllers, diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt
from statistics import fmean

from builtin_interfaces.msg import Time

from fsw_control import messages_ros as convert
from fsw_control.coded import Fact, Worded, several
from fsw_control.fence import Signature
from fsw_control.reports_ros import ERROR, OK, WARN, Report
from fsw_msgs.msg import ControllerHealth, Interlock, SupervisorState, WeldCommand
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.controller_registry import ControllerRecord
from fsw_supervisor.facts import Code
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Level, Mode
from fsw_supervisor.tick import Decision

#: severity of an event as a diagnostic level
LEVELS = {Level.INFO: OK, Level.WARN: WARN, Level.ERROR: ERROR}
#: default fallbacks, which need not all run
_SHIPPED = frozenset(SupervisorParameters().fallbacks)


class Note(Worded):
    """Texts of the supervisor's diagnostics."""

    FOLLOWS = "{role}: follows the leading supervisor"
    STANDS = "{mode}: {controller}"
    ABSENT = "fallbacks that are not in the graph: {controllers}"
    INSTEAD = "instead of {mode} with {controller}"
    REASON = "{reason.words}"
    ONLY_WRITER = "only writer of the command topic"
    WRITERS = "{count} publishers on the command topic"
    FOREIGN = "a foreign writer sends commands"
    NOT_MEASURING = "no measurements"
    CLOCK_STANDS = "stamps do not advance"
    INVALID = "invalid sensors: {sensors}"
    INTERLOCK = "{interlock} {level.word}"
    WITHIN = "sensors valid, all values within limits"
    ACTIVE = "active"
    READY = "ready"
    SLOW = "slow: 99 % within {p99_ms:.1f} ms"
    NAMESAKES = "{count} publishers of its proposals"


def command(decision: Decision, signature: Signature) -> WeldCommand:
    """Command message of a decision, signed by its supervisor."""
    command, source = decision.command, decision.source
    message = convert.command_message(command, decision.stamp_ns, source, why=decision.reason)
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
        interlocks=[Interlock(name=n, level=level) for n, level in arbiter.safety.active.items()],
        acknowledgement_blocked_by=list(arbiter.operator.acknowledgement_blocked_by),
    )
    message.header.stamp = now
    convert.sign(message, signature)
    if arbiter.ticks.last is not None:
        message.applied = command(arbiter.ticks.last, signature)
    return message


def standby(role: str, unanswered: int, node: str) -> Report:
    """Diagnostics of a ``node`` on standby that has seen ``unanswered`` ticks in a row."""
    level, values = WARN if unanswered else OK, {"unanswered ticks": unanswered, "node": node}
    return Report(role, level, Fact.of(Note.FOLLOWS, role=role), values)


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
    own = _arbiter_status(arbiter), _writer_status(arbiter, writers), _process_status(arbiter)
    return [*own, *controllers]


def _arbiter_status(arbiter: Arbiter) -> Report:
    machine = arbiter.machine
    level = OK
    standing = Fact.of(Note.STANDS, mode=machine.mode, controller=machine.active or "none")
    facts = [standing]
    absent = [name for name in arbiter.settings.fallbacks if arbiter.registry.get(name) is None]
    if machine.mode is not Mode.START and not _SHIPPED.issuperset(absent):
        level = WARN
        facts.append(Fact.of(Note.ABSENT, controllers=tuple(absent)))
    replaced = machine.active and machine.active != machine.target
    if machine.mode is not machine.target_mode or replaced:
        level, target = WARN, machine.target
        facts.append(Fact.of(Note.INSTEAD, mode=machine.target_mode, controller=target))
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
    if machine.reason:
        facts.append(Fact.of(Note.REASON, reason=machine.reason))
    return Report("arbiter", level, several(facts) or standing, values)


def _writer_status(arbiter: Arbiter, writers: int) -> Report:
    level, fact = OK, Fact.of(Note.ONLY_WRITER)
    if writers > 1:
        level, fact = WARN, Fact.of(Note.WRITERS, count=writers)
    if arbiter.watch.seen_lately(arbiter.ticks.now_s):
        level, fact = ERROR, Fact.of(Note.FOREIGN)
    values = {"publishers": writers, "foreign commands": arbiter.watch.foreign_commands}
    return Report("command topic", level, fact, values)


def _process_status(arbiter: Arbiter) -> Report:
    safety, level, facts = arbiter.safety, OK, list[Fact]()
    if not arbiter.ticks.measuring:
        level, stands = WARN, arbiter.ticks.silence is Code.CLOCK_STANDS
        facts.append(Fact.of(Note.CLOCK_STANDS if stands else Note.NOT_MEASURING))
    if safety.invalid_sensors:
        level = WARN
        facts.append(Fact.of(Note.INVALID, sensors=tuple(safety.invalid_sensors)))
    if safety.active:
        level = ERROR if safety.tripped else WARN
        for name, severity in safety.active.items():
            facts.append(Fact.of(Note.INTERLOCK, interlock=name, level=severity))
    flaws = safety.sensor_flaws.items()
    reasons: dict[str, object] = {f"{name} state": why or "good" for name, why in flaws}
    reasons["held"] = ", ".join(safety.held_sensors) or "none"
    return Report("process", level, several(facts) or Fact.of(Note.WITHIN), reasons)


def _controller_status(
    arbiter: Arbiter, record: ControllerRecord, publishers: int, limits: tuple[float, float]
) -> Report:
    known = health(arbiter, record)
    latencies_s = sorted(record.latencies_s) or [0.0]
    p99_s = latencies_s[ceil(0.99 * len(latencies_s)) - 1]
    readiness, active = arbiter.registry.readiness(record.name), arbiter.machine.active
    level = WARN if readiness.lack else OK
    facts = [Fact.of(Note.ACTIVE if record.name == active else Note.READY)]
    if readiness.lack:
        facts = [Fact.of(Code.NOT_READY, controller=record.name, readiness=readiness)]
    if not arbiter.lockstep and p99_s >= limits[0]:
        level = ERROR if p99_s >= limits[1] else WARN
        facts.append(Fact.of(Note.SLOW, p99_ms=p99_s * 1e3))
    if record.doubled:
        level, facts = ERROR, [Fact.of(Code.DOUBLED, controller=record.name)]
    elif publishers > 1:
        level = max(level, WARN)
        facts.append(Fact.of(Note.NAMESAKES, count=publishers))
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
    return Report(f"controller {record.name}", level, several(facts) or facts[0], values)
