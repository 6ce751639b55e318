"""What commissioning does in the graph.

Listen, weld a scenario while recording it, set a controller's parameters.
"""

from __future__ import annotations

import argparse
import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter, parameter_value_to_python

from fsw.errors import CommandError
from fsw.graph_ros import health
from fsw.node_ros import client_of
from fsw.operator_node import Operator, domain_text, operator
from fsw.weld_ros import abort, follow
from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.cause import Severity
from fsw_control.contract import SAFE_STOP
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_control.topics_ros import LATEST, subscribe_sensors
from fsw_control.weld import TICK_S
from fsw_lab.commissioning import Guard, Heard
from fsw_msgs.action import RunWeld
from fsw_msgs.msg import DriveFeedback, SupervisorState, WeldCommand, WeldReference
from fsw_scenario.launcher import Launcher
from fsw_scenario.weld_programme import State

_RECORDER = "fsw_commission_recorder"
#: what must be recorded before anything moves
_RECORDED = (
    *(SENSORS[name].topic for name in REQUIRED),
    "fsw/drives",
    "fsw/command",
    "fsw/reference",
)


def listen(arguments: argparse.Namespace, ticks: int) -> Heard:
    """Listen to so many ticks; CommandError when there is no such graph."""
    with operator(arguments) as node:
        states = node.watch(SupervisorState, "fsw/supervisor/state", LATEST)
        set_points = node.watch_set_points()
        node.watch(WeldReference, "fsw/supervisor/reference", LATEST)
        commands = node.watch(WeldCommand, "fsw/command")
        drives = node.watch(DriveFeedback, "fsw/drives")
        sensors = node.watch_sensors()
        heard = {"commands": commands, "drives": drives, **sensors}
        patience_s = node.timeout_s + 2.0 * ticks * TICK_S
        if not node.wait_until(
            lambda: states and all(len(log) >= ticks for log in heard.values()), patience_s
        ):
            counts = ", ".join(f"{len(log)} of {name}" for name, log in heard.items())
            late = f"{ticks} ticks did not come within {patience_s:g} s on {domain_text()}"
            raise CommandError(f"{late}: {counts}; does the graph run there?")
        reference = node.set_points_in_force(set_points, sensors["depth"])
    state = states[-1]
    names = {item.name for item in state.controllers}
    commanded = [convert.command(message) for message in commands]
    force_kn = sum(command.force_kn for command in commanded) / len(commanded)
    speed_rpm = sum(command.speed_rpm for command in commanded) / len(commanded)
    return Heard(
        time_s=[1e-9 * convert.stamp_ns(msg.header.stamp) for msg in sensors["depth"]],
        **{
            SENSORS[name].signal: [convert.sensor_value(name, msg) for msg in sensors[name]]
            for name in REQUIRED
        },
        force_kn=[units.kn_from_n(drive.axial_force) - force_kn for drive in drives],
        speed_rpm=[units.rpm_from_rad_s(drive.spindle_speed) - speed_rpm for drive in drives],
        reference=None if reference is None else (reference.depth_mm, reference.temperature_c),
        mode=state.actual_mode,
        controller=state.actual_controller,
        ready=[item.name for item in state.controllers if health(item) == "ready"],
        interlocks={lock.name: Severity(lock.level) for lock in state.interlocks},
        held=[
            convert.reason(msg).words or msg.source for msg in commands if msg.source not in names
        ],
    )


def weld(arguments: argparse.Namespace, text: str, bag: Path, guard: Guard) -> None:
    """Weld a scenario and record it; the weld is aborted when the guard says so, and by Ctrl-C.

    Raises
    ------
    CommandError
        When it was not welded to its end.
    """
    domain = int(os.environ.get("ROS_DOMAIN_ID") or "0")
    names = [
        "-r",
        f"__node:={_RECORDER}",
        *(["-r", f"__ns:=/{name}"] if (name := arguments.namespace) else []),
    ]
    with Launcher(bag.parent / "log", domain) as launcher:
        words = ["--ros-args", "-p", f"output:={bag}", *names]
        launcher.start("recorder", "recorder", words)
        why, outcome = welded(arguments, text, guard, launcher)
        code = launcher.stop("recorder")["recorder"]
    if outcome is None:
        raise CommandError(
            f"{why}; the scenario player does not report the end of the weld: fsw.py "
            "weld abort ends it"
        )
    if why:
        raise CommandError(f"{why}; {outcome.verdict}: {outcome.message}")
    if outcome.verdict != State.DONE:
        raise CommandError(f"{outcome.verdict}: {outcome.message}")
    if code != 0:
        raise CommandError(
            "the recorder ended with exit code "
            f"{code}: {launcher.children['recorder'].last_lines()}"
        )


def welded(
    arguments: argparse.Namespace, text: str, guard: Guard, launcher: Launcher
) -> tuple[str, Any]:
    """Why the weld was aborted, and its result, if it has ended."""
    stopped: list[str] = []

    def take(sensor: str, value: float) -> None:
        if why := guard.take(sensor, value):
            stopped.append(why)

    try:
        with operator(arguments) as node:
            _must_control(node)
            launcher.wait_until(
                lambda: _is_recorded(node), arguments.timeout + 60.0, "the recorder"
            )
            subscribe_sensors(node.node, lambda name, _, value: take(SENSORS[name].stem, value))
            outcome = follow(node, RunWeld.Goal(scenario=text), lambda: stopped)
            return stopped[0] if stopped else "", outcome
    except KeyboardInterrupt:
        ends = (signal.SIGINT, signal.SIGTERM)
        before = [
            signal.signal(end, signal.SIG_IGN) for end in ends
        ]  # a second one does not keep the weld going
        try:
            with operator(arguments) as node:
                text = aborted(node)
        finally:
            for end, handler in zip(ends, before, strict=True):
                signal.signal(end, handler)
        raise KeyboardInterrupt(text) from None


def _must_control(node: Operator) -> None:
    """CommandError unless a controller commands.

    An experiment must not begin in the safe stop that ended the last.
    """
    states = node.watch(SupervisorState, "fsw/supervisor/state", LATEST)
    if not node.wait_until(lambda: states):
        raise CommandError(f"no supervisor is heard on {domain_text()}; does the graph run there?")
    if (mode := states[-1].actual_mode) != "auto":
        back = "fsw.py acknowledge, then " if mode == SAFE_STOP else ""
        raise CommandError(
            f"the supervisor is in mode {mode}, so nothing was moved; {back}fsw.py mode auto first"
        )


def aborted(node: Operator) -> str:
    """Abort whatever weld there is; returns what has come of it, in words."""
    try:
        # Twice: a player that was held up takes a goal and what cancels it in any order, so the
        # first may be too early.
        was_welding = abort(node) or abort(node)
    except CommandError as error:
        return f"{error}; a weld may still run or begin; fsw.py weld abort ends it"
    return (
        "the weld was aborted, and the safe stop is requested"
        if was_welding
        else "no weld was under way"
    )


def _is_recorded(node: Operator) -> bool:
    """Whether the recorder listens to all that is needed."""
    node.wait_until(lambda: True)
    return all(
        any(end.node_name == _RECORDER for end in node.node.get_subscriptions_info_by_topic(topic))
        for topic in _RECORDED
        if node.node.count_publishers(topic)
    )


def set_parameters(arguments: argparse.Namespace, name: str, values: Mapping[str, Any]) -> None:
    """Set parameters of a node, all or none; CommandError when it refuses."""
    with operator(arguments) as node:
        client = client_of(node, name)
        future = client.set_parameters_atomically(
            [Parameter(key, value=value) for key, value in values.items()]
        )
        result = node.answer(future, name).result
    if not result.successful:
        raise CommandError(f"{name} refuses its tuning: {result.reason or 'without a reason'}")


def parameter(arguments: argparse.Namespace, node_name: str, name: str) -> Any:
    """The value of a parameter of a node."""
    with operator(arguments) as node:
        [value] = node.answer(client_of(node, node_name).get_parameters([name]), node_name).values
    return parameter_value_to_python(value)
