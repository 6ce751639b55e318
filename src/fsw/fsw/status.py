"""``fsw.py status``: what runs in the graph."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_command, health
from fsw_control import units

#: how long to go on listening when something has been heard
_SETTLE_S = 1.0


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    add_graph_command(
        commands, "status", "what runs, which controller is applied, what is measured and commanded", _run
    )


def _run(arguments: argparse.Namespace) -> int:
    from sensor_msgs.msg import Temperature

    from fsw.operator_node import nothing_there, operator  # the other commands do without rclpy
    from fsw_control.topics_ros import LATEST
    from fsw_msgs.msg import ShoulderDepth, SpindleTorque, SupervisorState, WeldCommand, WeldReference

    with operator(arguments.timeout) as visit:
        states = visit.watch(SupervisorState, "/fsw/supervisor/state", LATEST)
        set_points = visit.watch_set_points()
        stated = visit.watch(WeldReference, "/fsw/supervisor/reference", LATEST)
        commands = visit.watch(WeldCommand, "/fsw/command")
        depths = visit.watch(ShoulderDepth, "/fsw/depth")
        torques = visit.watch(SpindleTorque, "/fsw/spindle_torque")
        temperatures = visit.watch(Temperature, "/fsw/thermocouple")
        heard = (states, set_points, stated, commands, depths, torques, temperatures)
        if not visit.wait_until(lambda: any(heard)):
            raise nothing_there()
        visit.wait_until(lambda: all(heard), _SETTLE_S)
        nodes = sorted(name for name in visit.node.get_node_names() if name != "fsw_operator")
        reference = visit.in_force(set_points, depths)
    print(f"nodes        {', '.join(nodes)}")
    _print_state(states[-1] if states else None)
    rows = [
        ("depth", [units.mm_from_m(one.depth) for one in depths[-1:]], reference and reference.depth_mm, "mm"),
        ("temperature", [one.temperature for one in temperatures[-1:]], reference and reference.temperature_c, "degC"),
        ("torque", [one.torque for one in torques[-1:]], None, "N m"),
    ]
    for label, values, target, unit in rows:
        set_point = f"   set-point {target:.4g} {unit}" if target is not None else ""
        print(f"{label:<12} " + (f"{values[0]:.5g} {unit}" if values else "not measured") + set_point)
    if reference is None:
        print("set-points   none yet")
    if commands:
        force, speed = units.kn_from_n(commands[-1].axial_force), units.rpm_from_rad_s(commands[-1].spindle_speed)
        print(f"command      {force:.3f} kN, {speed:.2f} rpm from {commands[-1].source}")
    else:
        print("command      none")
    return 0


def _print_state(state: Any) -> None:
    if state is None:
        print("supervisor   none")
        return
    print(f"supervisor   {state.actual_mode}, {state.actual_controller or 'no controller'}: {state.reason}")
    if (state.target_mode, state.target_controller) != (state.actual_mode, state.actual_controller):
        print(f"  wanted     {state.target_mode}, {state.target_controller}")
    if state.actual_mode == "safe_stop":
        print(f"  the stop   {'acknowledged' if state.acknowledged else 'has to be acknowledged before it is left'}")
    for controller in state.controllers:
        print(f"  {controller.name:<10} {health(controller)}")
    if state.interlocks:
        print(f"interlocks   {', '.join(state.interlocks)}")
