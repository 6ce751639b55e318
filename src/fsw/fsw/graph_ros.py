"""Commands for a running weld that need a single service, and ``status``."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from fsw.console import print_table
from fsw.errors import CommandError, program
from fsw.graph import CLEAR
from fsw.operator_node import ask, graph_text, operator
from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.cause import Severity
from fsw_control.diagnostic_names import local_name
from fsw_control.reason import Reason
from fsw_control.reports_ros import OK
from fsw_control.schema.models import validate
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import SupervisorState, WeldCommand, WeldReference
from fsw_msgs.srv import (
    ListControllers,
    OperatorRequest,
    SetMode,
    SetReference,
    SwitchController,
)
from fsw_plant.event_schema import DISTURBANCE_AMPLITUDE, WITH_MAGNITUDE, DisturbanceEntry
from fsw_plant.event_schema import fault as checked_fault
from fsw_plant.services_ros import SERVICES, event_request

#: listening time after the first message
_SETTLE_S = 1.0
#: nodes report once a second; time limit for discovery and a report
_REPORT_S = 2.5
_SILENT = "measures and reports nothing; is it active? See"


def reference(arguments: argparse.Namespace) -> int:
    """Set new set-points."""
    depth, temperature = arguments.depth, arguments.temperature
    if depth is None and temperature is None:
        raise CommandError("reference: give --depth, --temperature or both")
    request = convert.set_reference_request(depth, temperature, arguments.ramp)
    return ask(arguments, SetReference, "fsw/set_reference", request)


def disturb(arguments: argparse.Namespace) -> int:
    """Disturb the emulated plant."""
    shape = "none" if arguments.shape == CLEAR else arguments.shape
    key, allowed = DISTURBANCE_AMPLITUDE[arguments.channel]
    if shape == "none" and arguments.amplitude is not None:
        raise CommandError(f"disturb: {arguments.shape} takes no amplitude")
    if shape != "none" and arguments.amplitude is None:
        raise CommandError(
            f"disturb: {shape} needs an amplitude, {allowed}; clear ends a disturbance"
        )
    entry = {"channel": arguments.channel, "shape": shape, key: arguments.amplitude}
    entry |= {"duration_s": arguments.duration, "period_s": arguments.period}
    return ask(
        arguments,
        *SERVICES[True],
        event_request(validate(DisturbanceEntry, entry, "disturb").event(0.0)),
    )


def fault(arguments: argparse.Namespace) -> int:
    """Fault a sensor of the emulated plant."""
    kind = "none" if arguments.kind == CLEAR else arguments.kind
    if (kind in WITH_MAGNITUDE) != (arguments.magnitude is not None):
        needs = "needs a" if kind in WITH_MAGNITUDE else "takes no"
        raise CommandError(f"fault: {arguments.kind} {needs} magnitude")
    event = checked_fault(arguments.sensor, kind, arguments.magnitude or 0.0, arguments.duration)
    return ask(arguments, *SERVICES[False], event_request(event))


def switch(arguments: argparse.Namespace) -> int:
    """Switch to another controller."""
    request = convert.switch_request(arguments.controller, arguments.wait, arguments.strict)
    return ask(
        arguments, SwitchController, "fsw/switch_controller", request, extra_s=arguments.wait
    )


def mode(arguments: argparse.Namespace) -> int:
    """Set the source of commands."""
    manual, inputs = arguments.mode == "manual", (arguments.axial_force, arguments.speed)
    if manual and None in inputs:
        raise CommandError("mode manual needs --axial-force and --speed")
    if not manual and inputs != (None, None):
        raise CommandError("--axial-force and --speed are for mode manual only")
    return ask(arguments, SetMode, "fsw/set_mode", convert.mode_request(arguments.mode, *inputs))


def acknowledge(arguments: argparse.Namespace) -> int:
    """Acknowledge a safe stop whose causes are gone."""
    return ask(arguments, OperatorRequest, "fsw/acknowledge")


def controllers(arguments: argparse.Namespace) -> int:
    """List the controllers in the graph."""
    with operator(arguments) as node:
        response = node.call(ListControllers, "fsw/list_controllers", ListControllers.Request())
    print(f"mode {response.mode}, active {response.active or 'none'}")
    header = (
        "controller",
        "state",
        "latency, mean [ms]",
        "largest [ms]",
        "missed",
        "late",
        "rejected",
    )
    rows = [
        (
            row.name,
            health(row),
            f"{row.latency_mean * 1e3:.2f}",
            f"{row.latency_max * 1e3:.2f}",
            str(row.missed),
            str(row.late),
            str(row.rejected),
        )
        for row in response.controllers
    ]
    print_table(rows, header, words=2)
    return 0


def health(controller: Any) -> str:
    """Whether a controller can be selected, as a text."""
    if lacks := convert.readiness(controller).words(controller.name):
        return f"cannot be selected: {lacks}"
    return "ready" if controller.warm else "not ready yet"


def status(arguments: argparse.Namespace) -> int:
    """Show what runs in the graph."""
    with operator(arguments) as node:
        states = node.watch(SupervisorState, "fsw/supervisor/state", LATEST)
        set_points = node.watch_set_points()
        stated = node.watch(WeldReference, "fsw/supervisor/reference", LATEST)
        commands = node.watch(WeldCommand, "fsw/command")
        sensors = node.watch_sensors(SENSORS)
        depths = sensors["depth"]
        reports = node.watch(DiagnosticArray, "/diagnostics")
        received = (states, set_points, stated, commands, *(sensors[name] for name in REQUIRED))
        if not node.wait_until(lambda: any(received)):
            raise CommandError(
                f"no weld graph on {graph_text(node)}: "
                "start it, or set ROS_DOMAIN_ID or --namespace"
            )
        node.wait_until(
            lambda: all(received) and _publishers(node.node) <= node.node_names(), _SETTLE_S
        )
        space = node.node.get_namespace()
        if not depths:
            node.wait_until(
                lambda: depths or latest_reports(reports, space, _measuring(node.node)), _REPORT_S
            )
        sources = _measuring(node.node)
        # hidden nodes, e.g. that of the ros2 command, begin with an underscore
        shown = node.node_names() - {"fsw_operator"}
        nodes = sorted(name for name in shown if not name.startswith("_"))
        reference = node.set_points_in_force(set_points, depths)
    rows = [("nodes", ", ".join(nodes)), *_supervisor_rows(states[-1] if states else None)]
    rows += source_rows(bool(depths), sources, latest_reports(reports, space, sources))
    for name, messages in sensors.items():
        if not messages and name not in REQUIRED:
            continue
        row = SENSORS[name]
        unit, target = row.quantity.unit, getattr(reference, row.signal, None)
        text = "not measured"
        if messages:
            text = f"{convert.sensor_value(name, messages[-1]):.5g} {unit}"
        if target is not None:
            text += f"   set-point {target:.4g} {unit}"
        rows.append((row.label.lower(), text))
    if reference is None:
        rows.append(("set-points", "none yet"))
    command = "none"
    if commands:
        force = units.kn_from_n(commands[-1].axial_force)
        speed = units.rpm_from_rad_s(commands[-1].spindle_speed)
        command = f"{force:.3f} kN, {speed:.2f} rpm from {commands[-1].source}"
    print_table([*rows, ("command", command)])
    return 0


def _publishers(node: Any) -> set[str]:
    """Names of the nodes whose topics this command shows."""
    topics = ("fsw/supervisor/state", "fsw/command")
    return _measuring(node) | {
        info.node_name for topic in topics for info in node.get_publishers_info_by_topic(topic)
    }


def _measuring(node: Any) -> set[str]:
    """Names of the nodes that publish measurements (plant or gateway), active or not."""
    return {publisher.node_name for publisher in node.get_publishers_info_by_topic("fsw/depth")}


def latest_reports(reports: Iterable[Any], namespace: str, nodes: set[str]) -> dict[str, Any]:
    """Latest diagnostics of these nodes by name (``NODE: PART``), without other welds'."""
    named = (
        (local_name(status.name, status.hardware_id, namespace), status)
        for array in reports
        for status in array.status
    )
    return {name: status for name, status in named if name and name.partition(": ")[0] in nodes}


def source_rows(
    measured: bool, sources: Collection[str], latest: Mapping[str, Any]
) -> list[tuple[str, str]]:
    """Problems reported by plant or gateway, and why nothing is measured.

    Parameters
    ----------
    measured : bool
        Whether a measurement has arrived.
    sources : collection of str
        Nodes that publish measurements.
    latest : mapping
        Their latest ``DiagnosticStatus`` by name.
    """
    rows = [(name, last.message) for name, last in sorted(latest.items()) if last.level != OK]
    if not measured and not sources:
        rows.append(
            ("measurements", f"no plant or gateway offers any; see {program()} lifecycle list")
        )
    elif not measured:
        heard = {name.partition(": ")[0] for name in latest}
        rows += [
            (name, f"{_SILENT} {program()} lifecycle get {name}")
            for name in sorted({*sources} - heard)
        ]
    return rows


def _supervisor_rows(state: Any) -> list[tuple[str, str]]:
    if state is None:
        return [("supervisor", "none")]
    why = Reason.of_messages(state.why).words
    rows = [
        ("supervisor", f"{state.actual_mode}, {state.actual_controller or 'no controller'}: {why}")
    ]
    if (state.target_mode, state.target_controller) != (
        state.actual_mode,
        state.actual_controller,
    ):
        rows.append(("  requested", f"{state.target_mode}, {state.target_controller}"))
    if state.actual_mode == "safe_stop":
        needed = "acknowledged" if not state.stop.stopped else "acknowledge it before another mode"
        rows.append(("  safe stop", needed))
    rows += [(f"  {controller.name}", health(controller)) for controller in state.controllers]
    if state.interlocks:
        active = (f"{lock.name} {Severity(lock.level).word}" for lock in state.interlocks)
        rows.append(("interlocks", ", ".join(active)))
    return rows
