"""Commands that talk to the running graph."""

from __future__ import annotations

import argparse
from math import nan
from typing import Any

from fsw_control import units
from fsw_control.contract import Reference
from fsw_experiment import ranges
from fsw_experiment.cli.errors import CommandError
from fsw_experiment.ranges import Range

_MODES = ("auto", "manual", "hold", "safe_stop")
_SETTLE_S = 1.0


def number_in(allowed: Range) -> Any:
    """Type of an argument: a number in a range; the error names the range."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number ({allowed})") from None
        complaint = allowed.complaint(value)
        if complaint:
            raise argparse.ArgumentTypeError(complaint)
        return value

    return number


def add_commands(commands: Any) -> None:
    """Add the commands to the parser's subcommands."""
    _add(commands, "status", _status, "what runs, which controller is applied, what is measured and commanded")
    reference = _add(commands, "reference", _reference, "new set-points; one left out stays")
    reference.add_argument(
        "--depth", metavar="MM", type=number_in(ranges.REFERENCE_DEPTH_MM), help=str(ranges.REFERENCE_DEPTH_MM)
    )
    reference.add_argument(
        "--temperature",
        metavar="C",
        type=number_in(ranges.REFERENCE_TEMPERATURE_C),
        help=str(ranges.REFERENCE_TEMPERATURE_C),
    )
    amplitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in ranges.DISTURBANCE_AMPLITUDE.items())
    disturb = _add(commands, "disturb", _disturb, f"disturb the emulated plant; amplitudes: {amplitudes}")
    disturb.add_argument("channel", choices=tuple(ranges.DISTURBANCE_AMPLITUDE))
    disturb.add_argument("shape", choices=ranges.DISTURBANCE_SHAPES, help="none clears the channel")
    disturb.add_argument("amplitude", type=float, nargs="?", default=0.0, help="in mm, degC, kN or rpm")
    disturb.add_argument("--duration", metavar="S", type=number_in(ranges.DURATION_S), default=0.0, help=_DURATION)
    disturb.add_argument("--period", metavar="S", type=number_in(ranges.DURATION_S), default=0.0, help="of a sine [s]")
    magnitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in ranges.FAULT_MAGNITUDE.items())
    magnitudes += f" (drift: per s), delay {ranges.FAULT_DELAY_S}"
    fault = _add(commands, "fault", _fault, f"make a sensor of the emulated plant fail; magnitudes: {magnitudes}")
    fault.add_argument("sensor", choices=tuple(ranges.FAULT_MAGNITUDE))
    fault.add_argument("kind", choices=ranges.FAULT_KINDS, help="none clears the sensor")
    fault.add_argument("magnitude", type=float, nargs="?", help="of spike, bias, drift, delay")
    fault.add_argument(
        "--duration", metavar="S", type=number_in(ranges.DURATION_S), default=0.0, help="[s]; without: until cleared"
    )
    switch = _add(commands, "switch", _switch, "apply another controller")
    switch.add_argument("controller", help="its name, e.g. decentral; see 'controllers'")
    switch.add_argument("--strict", action="store_true", help="refuse unless it is ready now")
    switch.add_argument(
        "--wait",
        metavar="S",
        type=number_in(Range(0.0, 600.0, "s")),
        default=5.0,
        help="longest wait until it is ready, 0 to 600 s",
    )
    _add(commands, "controllers", _controllers, "the controllers in the graph and their health")
    mode = _add(
        commands, "mode", _mode, "source of commands: a controller (auto), you (manual), the last one (hold), safe stop"
    )
    mode.add_argument("mode", choices=_MODES)
    mode.add_argument(
        "--force", metavar="KN", type=number_in(ranges.COMMAND_FORCE_KN), help=f"manual: {ranges.COMMAND_FORCE_KN}"
    )
    mode.add_argument(
        "--speed", metavar="RPM", type=number_in(ranges.COMMAND_SPEED_RPM), help=f"manual: {ranges.COMMAND_SPEED_RPM}"
    )


_DURATION = "rise time of a ramp, length of a pulse or a sine [s]"


def _add(commands: Any, name: str, run: Any, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=f"{name}: {text}.")
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=number_in(Range(0.1, 600.0, "s")),
        default=5.0,
        help="longest wait for the graph to answer, 0.1 to 600 s (default 5)",
    )
    parser.set_defaults(run=run)
    return parser


def _status(arguments: argparse.Namespace) -> int:
    from sensor_msgs.msg import Temperature

    from fsw_control import messages_ros as convert
    from fsw_control.topics_ros import LATEST
    from fsw_experiment.cli.operator_node import SetPoints, nothing_there, operator
    from fsw_msgs.msg import ShoulderDepth, SpindleTorque, SupervisorState, WeldCommand

    with operator(arguments.timeout) as visit:
        states = visit.watch(SupervisorState, "/fsw/supervisor/state", LATEST)
        set_points = SetPoints(visit)
        streams = [
            visit.watch(kind, topic)
            for kind, topic in (
                (WeldCommand, "/fsw/command"),
                (ShoulderDepth, "/fsw/depth"),
                (SpindleTorque, "/fsw/spindle_torque"),
                (Temperature, "/fsw/thermocouple"),
            )
        ]
        if not visit.wait_until(lambda: any((states, set_points, *streams))):
            raise nothing_there()
        visit.wait_until(lambda: all((states, set_points, *streams)), _SETTLE_S)
        nodes = sorted(name for name in visit.node.get_node_names() if name != "fsw_operator")
    state = states[-1] if states else None
    command, depth, torque, temperature = (stream[-1] if stream else None for stream in streams)
    reference = set_points.in_force(depth and convert.stamp_ns(depth.header.stamp))
    print(f"nodes        {', '.join(nodes)}")
    if state is None:
        print("supervisor   none")
    else:
        print(f"supervisor   {state.actual_mode}, {state.actual_controller or 'no controller'}: {state.reason}")
        if (state.target_mode, state.target_controller) != (state.actual_mode, state.actual_controller):
            print(f"  wanted     {state.target_mode}, {state.target_controller}")
        for controller in state.controllers:
            print(f"  {controller.name:<10} {_health(controller)}")
        if state.interlocks:
            print(f"interlocks   {', '.join(state.interlocks)}")
    rows = [
        ("depth", depth and units.mm_from_m(depth.depth), reference and reference.depth_mm, "mm"),
        ("temperature", temperature and temperature.temperature, reference and reference.temperature_c, "degC"),
        ("torque", torque and torque.torque, None, "N m"),
    ]
    for label, value, target, unit in rows:
        set_point = f"   set-point {target:.4g} {unit}" if target is not None else ""
        print(f"{label:<12} " + (f"{value:.5g} {unit}" if value is not None else "not measured") + set_point)
    if reference is None:
        print("set-points   none yet")
    if command is not None:
        force, speed = units.kn_from_n(command.axial_force), units.rpm_from_rad_s(command.spindle_speed)
        print(f"command      {force:.3f} kN, {speed:.2f} rpm from {command.source}")
    else:
        print("command      none")
    return 0


def _health(controller: Any) -> str:
    if controller.reason:
        return f"cannot be selected: {controller.reason}"
    return "ready" if controller.warm else "warming up"


def _reference(arguments: argparse.Namespace) -> int:
    from fsw_control import messages_ros as convert
    from fsw_control.topics_ros import LATCHED
    from fsw_experiment.cli.operator_node import SetPoints, nothing_there, operator
    from fsw_msgs.msg import ShoulderDepth, WeldReference

    if arguments.depth is None and arguments.temperature is None:
        raise CommandError("reference: give --depth, --temperature or both")
    with operator(arguments.timeout) as visit:
        depth, temperature = arguments.depth, arguments.temperature
        if depth is None or temperature is None:
            set_points = SetPoints(visit)
            depths = visit.watch(ShoulderDepth, "/fsw/depth")
            visit.wait_until(lambda: bool(set_points and depths))
            now_ns = convert.stamp_ns(depths[-1].header.stamp) if depths else None
            present = set_points.in_force(now_ns)
            if present is None:
                missing = "--depth" if depth is None else "--temperature"
                raise CommandError(f"reference: there is no set-point yet that could stay; give {missing} as well")
            depth = present.depth_mm if depth is None else depth
            temperature = present.temperature_c if temperature is None else temperature
        publisher = visit.node.create_publisher(WeldReference, "/fsw/reference", LATCHED)
        if not visit.wait_until(lambda: publisher.get_subscription_count() > 0):
            raise nothing_there()
        # Not every controller need have been found at once.
        visit.wait_until(lambda: False, 0.3)
        listeners = visit.node.count_subscribers("/fsw/reference")
        visit.wait_until(lambda: publisher.get_subscription_count() >= listeners, _SETTLE_S)
        publisher.publish(convert.reference_message(Reference(depth, temperature), 0))
        visit.wait_until(lambda: False, 0.3)
    print(f"set-points: {depth:.4g} mm, {temperature:.5g} degC")
    return 0


def _answer(response: Any) -> int:
    if not response.ok:
        raise CommandError(response.message)
    print(response.message)
    return 0


def _disturb(arguments: argparse.Namespace) -> int:
    from fsw_experiment.cli.operator_node import operator
    from fsw_msgs.srv import SetDisturbance

    _, allowed = ranges.DISTURBANCE_AMPLITUDE[arguments.channel]
    complaint = allowed.complaint(arguments.amplitude)
    if complaint:
        raise CommandError(f"disturb: amplitude {complaint}")
    to_wire = {"depth": units.m_from_mm, "axial_force": units.n_from_kn, "spindle_speed": units.rad_s_from_rpm}
    amplitude = to_wire.get(arguments.channel, float)(arguments.amplitude)
    request = SetDisturbance.Request(
        channel=arguments.channel,
        shape=arguments.shape,
        amplitude=float(amplitude),
        duration=float(arguments.duration),
        period=float(arguments.period),
    )
    with operator(arguments.timeout) as visit:
        return _answer(visit.call(SetDisturbance, "/fsw/plant/set_disturbance", request, "plant"))


def _fault(arguments: argparse.Namespace) -> int:
    from fsw_experiment.cli.operator_node import operator
    from fsw_msgs.srv import SetFault

    magnitude = 0.0 if arguments.magnitude is None else arguments.magnitude
    if arguments.kind in ("spike", "bias", "drift", "delay"):
        allowed = ranges.FAULT_DELAY_S if arguments.kind == "delay" else ranges.FAULT_MAGNITUDE[arguments.sensor][1]
        if arguments.magnitude is None:
            raise CommandError(f"fault: {arguments.kind} needs a magnitude, {allowed}")
        complaint = allowed.complaint(magnitude)
        if complaint:
            raise CommandError(f"fault: magnitude {complaint}")
        if arguments.sensor == "depth" and arguments.kind != "delay":
            magnitude = units.m_from_mm(magnitude)
    request = SetFault.Request(
        sensor=arguments.sensor, kind=arguments.kind, magnitude=float(magnitude), duration=float(arguments.duration)
    )
    with operator(arguments.timeout) as visit:
        return _answer(visit.call(SetFault, "/fsw/plant/set_fault", request, "plant"))


def _switch(arguments: argparse.Namespace) -> int:
    from builtin_interfaces.msg import Duration

    from fsw_experiment.cli.operator_node import operator
    from fsw_msgs.srv import SwitchController

    seconds = int(arguments.wait)
    request = SwitchController.Request(
        name=arguments.controller,
        strictness=SwitchController.Request.STRICT if arguments.strict else SwitchController.Request.BEST_EFFORT,
        timeout=Duration(sec=seconds, nanosec=round((arguments.wait - seconds) * 1e9)),
    )
    with operator(arguments.timeout) as visit:
        return _answer(
            visit.call(SwitchController, "/fsw/switch_controller", request, "supervisor", extra_s=arguments.wait)
        )


def _controllers(arguments: argparse.Namespace) -> int:
    from fsw_experiment.cli.operator_node import operator
    from fsw_msgs.srv import ListControllers

    with operator(arguments.timeout) as visit:
        response = visit.call(ListControllers, "/fsw/list_controllers", ListControllers.Request(), "supervisor")
    print(f"mode {response.mode}, active {response.active or 'none'}")
    for one in response.controllers:
        latency = f"latency {one.latency_mean * 1e3:.2f} ms (at most {one.latency_max * 1e3:.2f})"
        counts = f"missed {one.missed}, late {one.late}, rejected {one.rejected}"
        print(f"{one.name:<12} {_health(one)}; {latency}; {counts}")
    return 0


def _mode(arguments: argparse.Namespace) -> int:
    from fsw_experiment.cli.operator_node import operator
    from fsw_msgs.srv import SetMode

    if arguments.mode == "manual" and (arguments.force is None or arguments.speed is None):
        raise CommandError("mode manual needs --force and --speed")
    if arguments.mode != "manual" and (arguments.force is not None or arguments.speed is not None):
        raise CommandError("--force and --speed are for mode manual only")
    request = SetMode.Request(
        mode=arguments.mode,
        axial_force=units.n_from_kn(nan if arguments.force is None else arguments.force),
        spindle_speed=units.rad_s_from_rpm(nan if arguments.speed is None else arguments.speed),
    )
    with operator(arguments.timeout) as visit:
        return _answer(visit.call(SetMode, "/fsw/set_mode", request, "supervisor"))
