"""When there is an alarm; what it says is in ``alarms.yaml``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, nan
from typing import Any

from fsw_analysis.course import OVER
from fsw_control.contract import Reference
from fsw_control.depth_channels import ChannelHealth
from fsw_control.ranges import out_of_reach, wants_heat
from fsw_control.reason import Lack, Readiness
from fsw_control.sensors import OPTIONAL, REQUIRED
from fsw_control.stop import StopCause
from fsw_hmi.alarms import (
    ACTIONS,
    STOP_ID,
    TEXTS,
    Alarm,
    alarm,
    of_errors,
    of_interlock,
    of_limit,
    tripped,
)
from fsw_hmi.limits import Flag
from fsw_recorder.recording import Note

#: time without reports of a node after which that is an alarm
NO_REPORT_S = 3.5
#: a weld programme, too, reports once a second
NO_PROGRAMME_S = 5.0
UNDER_WAY, DONE = ("running", "held"), "done"
#: time without samples of one sensor
_NO_SAMPLE_S = 0.5
#: what is said of a sensor whose fault is over, until its value is trusted again
_AFTERWARDS = ("recovering",)
#: kinds of limits by which the weld is judged; the supervisor raises the alarms of interlocks
_OF_WELD = ("essential", "quality", "error")
#: alarms, by the beginning of their names, that keep the cause with which they began
_KEPT = ("channel:", "depth_doubt", "standby")
#: a standby that has begun to lead is no longer heard as one within this time
_UNHEARD_S = 2 * NO_REPORT_S
#: a plant reports its watchdog once a second, so later than commands come again
_WATCHDOG_S = 1.5
#: nodes whose silence other alarms tell, by alarm
_TOLD = {"measurements": ("fsw_plant", "fsw_machine"), "supervisor": ("fsw_supervisor",)}
#: parts by which supervisor and plant or gateway tell of commands that are no supervisor's
_WRITERS = ("command topic", "commands")
#: parts, behind the name of their node, that other rules cover
_OTHER_RULES = ("controller", "process", "arbiter", "watchdog", *_WRITERS)
#: parts of a gateway that say whether commands reach the machine
_GATEWAY = ("connection", "machine", "writes")
#: the part of a recorder that says whether it records
RECORDING = "recording"
#: the node that watches the weld: its warnings have causes and advice of their own
MONITOR = "fsw_monitor"
#: the node that compares the weld with its procedure, and its part that says what differs
PROCEDURE, DEVIATIONS = "fsw_procedure", "deviations"
#: a swap that was asked for takes so long: the longest wait that can be asked for, and what the
#: supervisor adds
_SWAP_S = 12.0
#: within this time a supervisor that stands by takes over (0.3 s, measured) and is heard
_TAKEOVER_S = 0.6
NO_REASON = "no reason given"


@dataclass(frozen=True, slots=True)
class Part:
    """Diagnostics of a part: ``ok``, ``warn``, ``error`` or ``stale``.

    A machine's say whether it permits commands.
    """

    level: str
    text: str
    permissive: bool | None = None
    action: str = ""  #: of the monitor: code of what to do
    code: str = ""  #: of what it says
    names: str = ""  #: what it is about, where one code stands for several


_FINE = Part("ok", "")


@dataclass(slots=True)
class Situation:
    """What the rules look at. Ages in s, None before the first."""

    state: Mapping[str, Any] | None = None  #: the supervisor's, as the page gets it
    state_age_s: float | None = None
    programme: str = ""  #: its state, as it last told
    programme_age_s: float = 0.0
    tick_age_s: float | None = None
    command_age_s: float | None = None
    #: of the last finite one by sensor
    sample_age_s: Mapping[str, float] = field(default_factory=dict)
    #: what the supervisor says of each sensor, ``good`` if nothing is wrong
    sensor_states: Mapping[str, str] = field(default_factory=dict)
    #: health of each channel of a fused depth, by sensor
    channels: Mapping[str, ChannelHealth] = field(default_factory=dict)
    #: of the newest row by column; NaN where unknown
    values: Mapping[str, float] = field(default_factory=dict)
    #: by quantity the limits that it is outside of, the worst first
    outside: Mapping[str, Sequence[Flag]] = field(default_factory=dict)
    #: the set-points that the controller which commands goes for
    attainable: Reference | None = None
    parts: Mapping[str, Mapping[str, Part]] = field(default_factory=dict)  #: by node and part
    pages: int = 1  #: servers of an operator's page in the graph
    leader: str = ""  #: identity of the supervisor that leads
    stop_waits: bool = False  #: a safe stop is in force, wherever, and is not acknowledged


class AlarmRules:
    """Says which alarms are present; how long they must last is for the list.

    ``setting`` returns a parameter of the node by its name.
    """

    def __init__(self, setting: Callable[[str], float]) -> None:
        self._setting = setting
        #: what stands in for set-points that are out of reach
        self.replaced: Reference | None = None
        self._mute_since_s: float | None = None
        self._failed = "", ""
        self._nominal = ""  # who has commanded as selected, and does so without a break
        self._faults: dict[str, str] = {}  # by sensor, the state that it began with
        self._began: dict[str, Alarm] = {}  # alarms that are present, with their first cause
        self._leader, self._led_s = "", -inf  # and since when, if another one led before
        self._programme_over = False
        #: present when a stop or the end began: it may be their effect
        self._before_stop: frozenset[str] = frozenset()

    def present(self, now: Situation, now_s: float) -> dict[str, Alarm]:
        """The alarms that are present by name; ``now_s`` on a steady clock."""
        alarms: dict[str, Alarm] = {}
        if now.programme not in OVER and self._programme_over:  # another weld
            self._leader, self._led_s = "", -inf
        self._programme_over = now.programme in OVER
        if now.leader and now.leader != self._leader:
            self._led_s = now_s if self._leader else -inf
            self._leader = now.leader
        _machine(now, alarms)
        self._measurements(now, alarms)
        self._supervisor(now, now_s, alarms)
        self._programme(now, alarms)
        _watchdog(now, alarms)
        self._values(now, alarms)
        self._reachable(now, alarms)
        self._parts(now, now_s, alarms)
        if now.pages > 1:
            alarms["other_page"] = alarm("other_page")
        for name in alarms:
            if name.startswith(_KEPT):
                alarms[name] = self._began.get(name, alarms[name])
        self._began = alarms
        return self._unexpected(now, alarms)

    def _unexpected(self, now: Situation, alarms: dict[str, Alarm]) -> dict[str, Alarm]:
        """Alarms that the state of the weld does not explain (ISA-18.2, suppressed by design)."""
        stopped = now.state if now.state and now.state["actual_mode"] == "safe_stop" else None
        expected, earlier = frozenset[str](), self._before_stop
        if now.programme == DONE and not self._measures(now):
            expected = TEXTS.expected["ended"]
        elif stopped is not None:
            # what led to the stop, or refuses its acknowledgement, is no consequence of it
            names = *stopped["tripped"], *stopped["acknowledgement_blocked_by"]
            causes = {f"interlock:{name}" for name in names}
            expected = TEXTS.expected["stopped"] - causes
        elif now.programme != DONE:
            self._before_stop = frozenset(alarms)
        return {
            name: entry
            for name, entry in alarms.items()
            if name in earlier or expected.isdisjoint((name, name.partition(":")[0]))
        }

    def reach(self, now: Situation, alarms: Mapping[str, Alarm]) -> dict[str, Any]:
        """Whether commands reach the machine, for the page: ``ok`` (None: unknown) and a text."""
        for name in ("machine", "measurements", "supervisor", "foreign"):
            if name in alarms:
                return {"ok": False, "text": alarms[name].text}
        if now.command_age_s is None or not self._measures(now):
            return {"ok": None, "text": "No commands now"}
        gates = [parts["machine"] for parts in now.parts.values() if "machine" in parts]
        text = "Commands reach the machine" + (", it permits them" if gates else "")
        return {"ok": True, "text": text}

    # ---------------------------------------------------------------- measurements and commands

    def _measures(self, now: Situation) -> bool:
        return now.tick_age_s is not None and now.tick_age_s <= self._setting("silence_s")

    def _measurements(self, now: Situation, alarms: dict[str, Alarm]) -> None:
        if now.tick_age_s is None:
            return
        if not self._measures(now):
            if "machine" not in alarms:  # without it nothing is measured
                alarms["measurements"] = alarm("measurements")
            return
        # the health of a depth channel says more than its samples do
        there = (
            name for name in OPTIONAL if name in now.sample_age_s and name not in now.channels
        )
        for name in (*REQUIRED, *there):
            state = now.sensor_states.get(name, "good")
            if state == "good" and now.sample_age_s.get(name, 0.0) > _NO_SAMPLE_S:
                state = "unusable"
            if state == "good":
                self._faults.pop(name, None)
                continue
            # the alarm tells what it began with
            if state not in _AFTERWARDS or name not in self._faults:
                self._faults[name] = state
            fault = self._faults[name]
            why = TEXTS.sensors.get(fault, fault)
            alarms[f"sensor:{name}"] = alarm("sensor", fault, name=name, why=why)
        _channels(now.channels, alarms)

    def _supervisor(self, now: Situation, now_s: float, alarms: dict[str, Alarm]) -> None:
        state, age_s = now.state, now.state_age_s
        measuring = self._measures(now)
        if not (measuring and age_s is None):
            self._mute_since_s = None
        elif self._mute_since_s is None:
            self._mute_since_s = now_s
        never = self._mute_since_s is not None and now_s - self._mute_since_s > NO_REPORT_S
        starts = state is not None and state["cause"].at_start and state["actual_mode"] == "hold"
        silent = (
            measuring and not starts and (now.command_age_s or 0.0) > self._setting("silence_s")
        )
        if never or silent or (age_s is not None and age_s > NO_REPORT_S):
            alarms["supervisor"] = alarm("supervisor")
            if standby_ready(now.parts):
                alarms["supervisor"] = replace(alarms["supervisor"], on_s=_TAKEOVER_S)
        if state is None or (age_s is not None and age_s > NO_REPORT_S):
            return
        for interlock in state["interlocks"]:
            name, level = interlock["name"], interlock["level"]
            alarms[f"interlock:{name}"] = of_interlock(name, level)
        replaced = self._mode(now, state, alarms)
        for controller in state["controllers"]:
            if controller["name"] != replaced:
                _controller(controller, alarms)

    def _mode(
        self, now: Situation, state: Mapping[str, Any], alarms: dict[str, Alarm]
    ) -> str | None:
        """Who or what commands.

        Returns the controller that another one stands in for: one alarm for one cause.
        """
        mode, target_mode = state["actual_mode"], state["target_mode"]
        actual, target = state["actual_controller"], state["target_controller"]
        why = state["reason"] or NO_REASON
        if mode == "safe_stop":
            asked = state["stop_cause"] == StopCause.OPERATOR
            why = f"asked for by {state['by']}" if asked else tripped(state) or why
            action = next_in_stop(now, state)
            cause = next((c.name.lower() for c in StopCause if c == state["stop_cause"]), "")
            stop = alarm("safe_stop", cause, why=why, action=action)
            alarms[STOP_ID] = replace(stop, trip=not asked)
        elif mode == "hold" and target_mode != "hold" and not state["cause"].at_start:
            alarms["hold"] = alarm("hold", state["cause"], why=why)
        elif mode == "auto" and actual and target and actual != target:
            lacks = (one["why"] for one in state["controllers"] if one["name"] == target)
            why = next(lacks, Readiness(Lack.UNKNOWN).why) or NO_REASON
            return self._failover(actual, target, why, alarms)
        if mode != "hold":
            self._failed = "", ""
        self._nominal = actual if mode == "auto" else ""
        return None

    def _failover(
        self, actual: str, target: str, why: str, alarms: dict[str, Alarm]
    ) -> str | None:
        """Another controller commands than the selected one, which may need time at first."""
        if actual == self._nominal:
            why = "it was asked for, and is not ready"
            failover = alarm("failover", actual=actual, target=target, why=why)
            alarms["failover"] = replace(failover, on_s=_SWAP_S)
            return None
        self._nominal = ""
        if self._failed[0] != target:  # why it was left, not what has happened since
            self._failed = target, why
        alarms["failover"] = alarm("failover", actual=actual, target=target, why=self._failed[1])
        return target

    # ---------------------------------------------------------------- the weld

    def _programme(self, now: Situation, alarms: dict[str, Alarm]) -> None:
        """A programme that is under way says so; it cannot while nothing is measured."""
        silent = now.programme in UNDER_WAY and now.programme_age_s > NO_PROGRAMME_S
        if silent and self._measures(now):
            alarms["programme"] = alarm("programme")

    def _values(self, now: Situation, alarms: dict[str, Alarm]) -> None:
        """For each value the worst limit that it violates, and a drive off its command."""
        for quantity, flags in now.outside.items() if self._measures(now) else ():
            # an interlock on the same quantity says more, but not while no supervisor is heard
            of_quantity = f"interlock:{quantity.partition('_')[0]}"
            interlocked = any(name.startswith(of_quantity) for name in alarms)
            judged = [] if interlocked else [flag for flag in flags if flag["kind"] in _OF_WELD]
            drives = [flag for flag in flags if flag["kind"] == "deviation"]
            for flag in (*judged[:1], *drives[:1]):
                # a step of the set-point takes its time
                slow = flag["kind"] == "deviation" or flag["variable"] == "temperature_error_c"
                lasts_s = self._setting(f"{'deviation' if slow else 'quality'}_persistence_s")
                kind = "quality" if flag["kind"] == "error" else flag["kind"]
                entry = replace(of_limit(kind, flag), on_s=lasts_s, off_s=lasts_s)
                alarms[f"{kind}:{flag['variable']}"] = entry

    def _reachable(self, now: Situation, alarms: dict[str, Alarm]) -> None:
        """Set-points that the controller replaces by what the drives can hold."""
        value = now.values.get
        asked = Reference(value("reference_depth_mm", nan), value("reference_temperature_c", nan))
        goal = now.attainable
        why = out_of_reach(asked, goal) if goal and self._measures(now) else None
        self.replaced = goal if why else None
        if goal is not None and why:
            action = "lower_temperature" if wants_heat(asked, goal) else "raise_temperature"
            alarms["out_of_reach"] = alarm("out_of_reach", why.code, why=why.words, action=action)

    # ---------------------------------------------------------------- the nodes

    def _parts(self, now: Situation, now_s: float, alarms: dict[str, Alarm]) -> None:
        """Errors of parts, one alarm for each node, and nodes that no longer report."""
        known = {health["name"] for health in now.state["controllers"]} if now.state else set()
        told = [node for name, nodes in _TOLD.items() if name in alarms for node in nodes]
        failed = [name for name in known if f"controller:{name}" in alarms]
        told += [*failed, *(f"fsw_{name}" for name in failed)]
        for node, parts in now.parts.items():
            if parts and all(part.level == "stale" for part in parts.values()):
                if RECORDING in parts:
                    last = parts[RECORDING]
                    ended = last.code == Note.FAILED
                    why, action = (last.text, "mend") if ended else ("", "start")
                    action = f"{action}_recorder"
                    alarms["recorder"] = alarm("recorder", last.code, why=why, action=action)
                elif node not in told:
                    alarms[f"node:{node}"] = alarm("node_silent", node=node)
                continue
            if any(parts.get(what, _FINE).level == "error" for what in _WRITERS):
                alarms["foreign"] = alarm("foreign")
            if parts.get("standby", _FINE).level == "stale":  # it leads now, or has died
                why = "taken_over" if now_s - self._led_s <= _UNHEARD_S else "lost"
                alarms["standby"] = alarm("standby", why, why=TEXTS.standby[why])
            if node == MONITOR:
                _watch(parts, alarms)
            if node == PROCEDURE and parts.get(DEVIATIONS, _FINE).level == "error":
                left = parts[DEVIATIONS]
                alarms["procedure"] = alarm("procedure", left.names or left.code, why=left.text)
            covered = (*_OTHER_RULES, *(_GATEWAY if "machine" in parts else ()))
            covered += (DEVIATIONS,) if node == PROCEDURE else ()
            bad = {what: part.text for what, part in parts.items() if part.level == "error"}
            errors = [(what, text) for what, text in bad.items() if not what.startswith(covered)]
            if errors:
                entry = of_errors(node, errors)
                own = node.startswith("fsw_") or node in known
                alarms[f"part:{node}"] = entry if own else replace(entry, priority="low")


def next_in_stop(now: Situation, state: Mapping[str, Any]) -> str:
    """Code of what to do in a safe stop; an aborted weld is not continued."""
    if not state["acknowledged"]:
        return "retract_and_acknowledge"
    return "clear_machine" if now.programme in OVER else "choose_auto"


def standby_ready(parts: Mapping[str, Mapping[str, Part]]) -> bool:
    """Whether a supervisor reports that it stands by, ready to lead.

    ``parts`` by node and part.
    """
    return any(
        of_node["standby"].level == "ok" for of_node in parts.values() if "standby" in of_node
    )


def _channels(channels: Mapping[str, ChannelHealth], alarms: dict[str, Alarm]) -> None:
    """What is wrong with the channels of a fused depth, and whether it can be relied on."""
    bad = {name: health for name, health in channels.items() if health is not ChannelHealth.GOOD}
    suspect = [name for name in bad if channels[name] is ChannelHealth.SUSPECT]
    if suspect or (bad and len(bad) == len(channels)):
        names = suspect or list(bad)
        health = bad[names[0]]
        alarms["depth_doubt"] = alarm(
            "depth_doubt", health.word, name=", ".join(names), why=health.words
        )
        return
    for name, health in bad.items():
        alarms[f"channel:{name}"] = alarm("channel", health.word, name=name, why=health.words)


def _machine(now: Situation, alarms: dict[str, Alarm]) -> None:
    """Reports of a gateway about its machine, and of a plant about missing commands."""
    for parts in now.parts.values():
        gate = parts.get("machine")
        if gate is None or gate.level == "stale":
            continue
        bad = (parts[name] for name in _GATEWAY if name in parts and parts[name].level == "error")
        if (part := next(bad, None)) is not None:
            alarms["machine"] = alarm("machine", part.code, why=part.text)
        elif gate.permissive is False:
            alarms["machine"] = alarm("machine", gate.code, why="it does not permit them")


def _watchdog(now: Situation, alarms: dict[str, Alarm]) -> None:
    """Commands are sent, but those that arrive are none that the plant accepts."""
    dogs = [parts.get("watchdog", _FINE) for parts in now.parts.values()]
    bad = [part for part in dogs if part.level == "error"]
    if bad and not {"supervisor", "measurements"} & alarms.keys():
        machine = alarm("machine", bad[0].code, why=bad[0].text)
        alarms["machine"] = replace(machine, on_s=_WATCHDOG_S)


def _controller(controller: Mapping[str, Any], alarms: dict[str, Alarm]) -> None:
    name, why = controller["name"], controller["why"] or NO_REASON
    if controller["inhibited"]:
        alarms[f"controller:{name}"] = alarm("inhibited", controller["lack"], name=name, why=why)
    elif not controller["ready"]:
        if any(f"sensor:{sensor}" in alarms for sensor in controller["missing_sensors"]):
            return  # that sensor is the cause
        alarms[f"controller:{name}"] = alarm("not_ready", controller["lack"], name=name, why=why)


def _watch(parts: Mapping[str, Part], alarms: dict[str, Alarm]) -> None:
    """What the monitor tells; its parts are named by their causes."""
    for what, part in parts.items():
        if part.level == "warn":
            # a text with fields is of another alarm, which has their values
            is_known = part.action in ACTIONS and "{" not in ACTIONS[part.action]
            action = part.action if is_known else "see_trends"
            alarms[f"watch:{what}"] = alarm("watch", what, cause=part.text, action=action)
