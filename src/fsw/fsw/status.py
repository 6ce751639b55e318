"""``fsw.py status``: what runs in the graph."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.console import print_table
from fsw.errors import CommandError
from fsw.operate import add_graph_command, health
from fsw_control import units

#: how long to go on listening after the first message
_SETTLE_S = 1.0


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    add_graph_command(commands, "status", "running nodes, applied controller, measurements and commands", _run)


def _run(arguments: argparse.Namespace) -> int:
    from sensor_msgs.msg import Temperature

    from fsw.operator_node import domain_text, operator  # the other commands do without rclpy
    from fsw_control.topics_ros import LATEST
    from fsw_msgs.msg import ShoulderDepth, SpindleTorque, SupervisorState, WeldCommand, WeldReference

    with operator(arguments.timeout, arguments.namespace) as node:
        states = node.watch(SupervisorState, "fsw/supervisor/state", LATEST)
        set_points = node.watch_set_points()
        stated = node.watch(WeldReference, "fsw/supervisor/reference", LATEST)
        commands = node.watch(WeldCommand, "fsw/command")
        depths = node.watch(ShoulderDepth, "fsw/depth")
        torques = node.watch(SpindleTorque, "fsw/spindle_torque")
        temperatures = node.watch(Temperature, "fsw/thermocouple")
        received = (states, set_points, stated, commands, depths, torques, temperatures)
        if not node.wait_until(lambda: any(received)):
            where = f"{domain_text()}, namespace {node.node.get_namespace()}"
            raise CommandError(f"no weld graph on {where}: start it, or set ROS_DOMAIN_ID or --namespace")
        node.wait_until(lambda: all(received) and _publishers(node.node) <= node.node_names(), _SETTLE_S)
        # hidden ones, e.g. that of the ros2 command, begin with an underscore
        shown = (name for name in node.node_names() if name != "fsw_operator" and not name.startswith("_"))
        nodes = sorted(shown)
        reference = node.set_points_in_force(set_points, depths)
    rows = [("nodes", ", ".join(nodes)), *_supervisor_rows(states[-1] if states else None)]
    for label, values, target, unit in (
        ("depth", [units.mm_from_m(one.depth) for one in depths], reference and reference.depth_mm, "mm"),
        ("temperature", [one.temperature for one in temperatures], reference and reference.temperature_c, "degC"),
        ("torque", [one.torque for one in torques], None, "N m"),
    ):
        measured = f"{values[-1]:.5g} {unit}" if values else "not measured"
        rows.append((label, measured if target is None else f"{measured}   set-point {target:.4g} {unit}"))
    if reference is None:
        rows.append(("set-points", "none yet"))
    command = "none"
    if commands:
        force, speed = units.kn_from_n(commands[-1].axial_force), units.rpm_from_rad_s(commands[-1].spindle_speed)
        command = f"{force:.3f} kN, {speed:.2f} rpm from {commands[-1].source}"
    print_table([*rows, ("command", command)])
    return 0


def _publishers(node: Any) -> set[str]:
    """Names of the nodes whose topics this command shows."""
    topics = ("fsw/depth", "fsw/supervisor/state", "fsw/command")
    return {publisher.node_name for topic in topics for publisher in node.get_publishers_info_by_topic(topic)}


def _supervisor_rows(state: Any) -> list[tuple[str, str]]:
    if state is None:
        return [("supervisor", "none")]
    rows = [("supervisor", f"{state.actual_mode}, {state.actual_controller or 'no controller'}: {state.reason}")]
    if (state.target_mode, state.target_controller) != (state.actual_mode, state.actual_controller):
        rows.append(("  requested", f"{state.target_mode}, {state.target_controller}"))
    if state.actual_mode == "safe_stop":
        needed = "acknowledged" if state.acknowledged else "acknowledge it before another mode"
        rows.append(("  safe stop", needed))
    rows += [(f"  {controller.name}", health(controller)) for controller in state.controllers]
    if state.interlocks:
        rows.append(("interlocks", ", ".join(state.interlocks)))
    return rows
