"""The operator's short visit to the graph: watches topics, calls services."""

from __future__ import annotations

import argparse
import contextlib
import os
import time
from collections.abc import Callable, Iterator
from math import nan
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Temperature
from std_srvs.srv import Trigger

from fsw.errors import CommandError
from fsw.operate import CLEAR
from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.contract import Reference
from fsw_control.references import ReferenceQueue
from fsw_control.references_ros import reference_queue, subscribe_references
from fsw_control.topics_ros import LATEST, STREAM
from fsw_msgs.msg import ShoulderDepth, SpindleTorque, SupervisorState, WeldCommand, WeldReference
from fsw_msgs.srv import ListControllers, SetDisturbance, SetFault, SetMode, SetReference, SwitchController
from fsw_plant.event_schema import Place, read_disturbance
from fsw_plant.events import DisturbanceError
from fsw_scenario import ranges

#: how long to go on listening when something has been heard
_SETTLE_S = 1.0


class Operator:
    """Calls services and watches topics, each with a time limit."""

    def __init__(self, node: Node, timeout_s: float) -> None:
        self.node = node
        self.timeout_s = timeout_s

    def wait_until(self, condition: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Spin until a condition holds; False when it takes too long."""
        end = time.monotonic() + (self.timeout_s if timeout_s is None else timeout_s)
        while not condition():
            if time.monotonic() > end:
                return False
            rclpy.spin_once(self.node, timeout_sec=0.05)
        return True

    def call(self, service: Any, name: str, request: Any, extra_s: float = 0.0) -> Any:
        """Call a service.

        Raises
        ------
        CommandError
            When no node offers it or none answers in time.
        """
        who = {"plant": "plant", "weld": "scenario player"}.get(name.split("/")[2], "supervisor")
        client = self.node.create_client(service, name)
        if not self.wait_until(client.service_is_ready):
            raise CommandError(f"no node offers {name} on {domain_text()}: is the {who} running there?")
        future = client.call_async(request)
        if not self.wait_until(future.done, self.timeout_s + extra_s):
            raise CommandError(f"{name} did not answer within {self.timeout_s + extra_s:g} s: is the {who} stuck?")
        return future.result()

    def watch(self, kind: Any, topic: str, profile: QoSProfile = STREAM) -> list[Any]:
        """A list that gets every message of a topic while this object spins."""
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, profile)
        return received

    def watch_set_points(self) -> ReferenceQueue:
        """Set-points as they were sent and as the supervisor keeps them, while this object spins."""
        queue = reference_queue(self.node)
        subscribe_references(self.node, queue)
        return queue

    def in_force(self, set_points: ReferenceQueue, depths: list[ShoulderDepth]) -> Reference | None:
        """The set-points that hold at the last measurement, or else now; None if there are none."""
        if depths:
            return set_points.at(convert.stamp_ns(depths[-1].header.stamp))
        return set_points.at(self.node.get_clock().now().nanoseconds)


def domain_text() -> str:
    """The ROS domain in words."""
    return f"ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}"


def _nothing_there() -> CommandError:
    return CommandError(f"no weld graph on {domain_text()}: start it, or set ROS_DOMAIN_ID")


@contextlib.contextmanager
def operator(timeout_s: float) -> Iterator[Operator]:
    """Join the graph as ``fsw_operator`` for as long as the context lasts."""
    try:
        rclpy.init(args=[])
    except RuntimeError as error:  # the environment is wrong, e.g. ROS_DOMAIN_ID
        raise CommandError(str(error)) from None
    node = rclpy.create_node("fsw_operator")
    try:
        yield Operator(node, timeout_s)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def status(arguments: argparse.Namespace) -> int:
    """Print what runs, which controller is applied, what is measured and commanded."""
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
            raise _nothing_there()
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


def _print_state(state: SupervisorState | None) -> None:
    if state is None:
        print("supervisor   none")
        return
    print(f"supervisor   {state.actual_mode}, {state.actual_controller or 'no controller'}: {state.reason}")
    if (state.target_mode, state.target_controller) != (state.actual_mode, state.actual_controller):
        print(f"  wanted     {state.target_mode}, {state.target_controller}")
    if state.actual_mode == "safe_stop":
        print(f"  the stop   {'acknowledged' if state.acknowledged else 'has to be acknowledged before it is left'}")
    for controller in state.controllers:
        print(f"  {controller.name:<10} {_health(controller)}")
    if state.interlocks:
        print(f"interlocks   {', '.join(state.interlocks)}")


def _health(controller: Any) -> str:
    if controller.reason:
        return f"cannot be selected: {controller.reason}"
    return "ready" if controller.warm else "not ready yet"


def reference(arguments: argparse.Namespace) -> int:
    """Send new set-points."""
    depth, temperature = arguments.depth, arguments.temperature
    if depth is None and temperature is None:
        raise CommandError("reference: give --depth, --temperature or both")
    request = SetReference.Request(
        depth=nan if depth is None else units.m_from_mm(depth),
        temperature=nan if temperature is None else temperature,
        ramp=arguments.ramp,
    )
    return _ask(arguments, SetReference, "/fsw/set_reference", request)


def _ask(arguments: argparse.Namespace, service: Any, name: str, request: Any, extra_s: float = 0.0) -> int:
    """Call a service that answers with ``ok`` and a message."""
    with operator(arguments.timeout) as visit:
        response = visit.call(service, name, request, extra_s)
    if not response.ok:
        raise CommandError(response.message)
    print(response.message)
    return 0


def disturb(arguments: argparse.Namespace) -> int:
    """Disturb the emulated plant."""
    shape = "none" if arguments.shape == CLEAR else arguments.shape
    key, allowed = ranges.DISTURBANCE_AMPLITUDE[arguments.channel]
    if shape == "none" and arguments.amplitude is not None:
        raise CommandError(f"disturb: {arguments.shape} takes no amplitude")
    if shape != "none" and arguments.amplitude is None:
        raise CommandError(f"disturb: {shape} needs an amplitude, {allowed}; clear ends a disturbance")
    given = {key: arguments.amplitude, "duration_s": arguments.duration, "period_s": arguments.period}
    entry = {name: value for name, value in given.items() if value is not None}
    try:
        wanted = read_disturbance({"channel": arguments.channel, "shape": shape} | entry, Place("disturb", shape), 0.0)
    except DisturbanceError as error:
        raise CommandError(str(error)) from None
    to_wire = {"depth": units.m_from_mm, "axial_force": units.n_from_kn, "spindle_speed": units.rad_s_from_rpm}
    request = SetDisturbance.Request(
        channel=arguments.channel,
        shape=shape,
        amplitude=to_wire.get(arguments.channel, float)(wanted.amount),
        duration=wanted.duration_s,
        period=wanted.period_s,
    )
    return _ask(arguments, SetDisturbance, "/fsw/plant/set_disturbance", request)


def fault(arguments: argparse.Namespace) -> int:
    """Make a sensor of the emulated plant fail."""
    magnitude = 0.0 if arguments.magnitude is None else arguments.magnitude
    if arguments.kind not in ranges.WITH_MAGNITUDE and arguments.magnitude is not None:
        raise CommandError(f"fault: {arguments.kind} takes no magnitude")
    if arguments.kind in ranges.WITH_MAGNITUDE:
        allowed = ranges.FAULT_DELAY_S if arguments.kind == "delay" else ranges.FAULT_MAGNITUDE[arguments.sensor][1]
        if arguments.magnitude is None:
            raise CommandError(f"fault: {arguments.kind} needs a magnitude, {allowed}")
        complaint = allowed.complaint(magnitude)
        if complaint:
            raise CommandError(f"fault: magnitude {complaint}")
        if arguments.sensor == "depth" and arguments.kind != "delay":
            magnitude = units.m_from_mm(magnitude)
    request = SetFault.Request(
        sensor=arguments.sensor,
        kind="none" if arguments.kind == CLEAR else arguments.kind,
        magnitude=magnitude,
        duration=arguments.duration,
    )
    return _ask(arguments, SetFault, "/fsw/plant/set_fault", request)


def switch(arguments: argparse.Namespace) -> int:
    """Apply another controller."""
    seconds = int(arguments.wait)
    request = SwitchController.Request(
        name=arguments.controller,
        strictness=SwitchController.Request.STRICT if arguments.strict else SwitchController.Request.BEST_EFFORT,
        timeout=Duration(sec=seconds, nanosec=round((arguments.wait - seconds) * 1e9)),
    )
    return _ask(arguments, SwitchController, "/fsw/switch_controller", request, extra_s=arguments.wait)


def controllers(arguments: argparse.Namespace) -> int:
    """Print the controllers in the graph and their health."""
    with operator(arguments.timeout) as visit:
        response = visit.call(ListControllers, "/fsw/list_controllers", ListControllers.Request())
    print(f"mode {response.mode}, active {response.active or 'none'}")
    for one in response.controllers:
        latency = f"latency {one.latency_mean * 1e3:.2f} ms (at most {one.latency_max * 1e3:.2f})"
        counts = f"missed {one.missed}, late {one.late}, rejected {one.rejected}"
        print(f"{one.name:<12} {_health(one)}; {latency}; {counts}")
    return 0


def mode(arguments: argparse.Namespace) -> int:
    """Choose the source of commands."""
    manual, given = arguments.mode == "manual", (arguments.force, arguments.speed)
    if manual and None in given:
        raise CommandError("mode manual needs --force and --speed")
    if not manual and given != (None, None):
        raise CommandError("--force and --speed are for mode manual only")
    request = SetMode.Request(
        mode=arguments.mode,
        axial_force=units.n_from_kn(arguments.force) if manual else nan,
        spindle_speed=units.rad_s_from_rpm(arguments.speed) if manual else nan,
    )
    return _ask(arguments, SetMode, "/fsw/set_mode", request)


def acknowledge(arguments: argparse.Namespace) -> int:
    """Acknowledge a safe stop, so that it may be left."""
    return _trigger(arguments, "/fsw/acknowledge")


def weld(arguments: argparse.Namespace) -> int:
    """Hold, resume or abort the programme of a whole weld."""
    return _trigger(arguments, f"/fsw/weld/{arguments.action}")


def _trigger(arguments: argparse.Namespace, name: str) -> int:
    """Call a service that takes nothing."""
    with operator(arguments.timeout) as visit:
        response = visit.call(Trigger, name, Trigger.Request())
    if not response.success:
        raise CommandError(response.message)
    print(response.message)
    return 0
