"""Declarations of the commands for a running weld; the ``*_ros`` modules implement them."""

from __future__ import annotations

import argparse
from importlib import import_module

from fsw.command import GRAPH, Command, Option, command, group, number, option, repeated, switch
from fsw_control import ranges
from fsw_control.contract import OPERATOR_MODES
from fsw_control.schema.ranges import Range
from fsw_plant.event_schema import (
    DISTURBANCE_AMPLITUDE,
    DISTURBANCE_SHAPES,
    DURATION_S,
    FAULT_DELAY_S,
    FAULT_KINDS,
    FAULT_MAGNITUDE,
)

#: ends a disturbance or a fault; ``none`` in scenarios and services
CLEAR = "clear"
_AMPLITUDES = ", ".join(
    f"{name} {allowed}" for name, (_, allowed) in DISTURBANCE_AMPLITUDE.items()
)
_MAGNITUDES = ", ".join(f"{name} {allowed}" for name, (_, allowed) in FAULT_MAGNITUDE.items())
_MAGNITUDES += f" (drift: per s), delay {FAULT_DELAY_S}"


#: of groups, ``module:function``; a command without a group is a function of ``graph_ros``
_PLACES = {
    "weld": "weld_ros:weld",
    "param": "node_ros:parameters",
    "lifecycle": "node_ros:lifecycle",
}


def _command(name: str, text: str, *options: Option) -> Command:
    """A command whose function is imported on use: other commands work without rclpy."""
    first = name.partition(" ")[0]
    module, _, function = _PLACES.get(first, f"graph_ros:{first}").partition(":")

    def run(arguments: argparse.Namespace) -> int:
        return int(getattr(import_module(f"fsw.{module}"), function)(arguments))

    return command(name, text, *GRAPH, *options)(run)


STATUS = _command("status", "running nodes, applied controller, measurements and commands")
REFERENCE = _command(
    "reference",
    "new set-points; an omitted one keeps its value",
    number("--depth", "MM", ranges.REFERENCE_DEPTH_MM, str(ranges.REFERENCE_DEPTH_MM)),
    switch("--ramp", "ramp from the set-points in force at the permitted rates; default: a step"),
    number(
        "--temperature", "C", ranges.REFERENCE_TEMPERATURE_C, str(ranges.REFERENCE_TEMPERATURE_C)
    ),
)
DISTURB = _command(
    "disturb",
    f"disturb the emulated plant; amplitudes: {_AMPLITUDES}",
    option("channel", choices=tuple(DISTURBANCE_AMPLITUDE)),
    option(
        "shape",
        choices=(*DISTURBANCE_SHAPES, CLEAR),
        help="clear (or none) ends the channel's disturbance",
    ),
    option("amplitude", type=float, nargs="?", help="in mm, degC, kN, rpm or N m; not for clear"),
    number("--duration", "S", DURATION_S, "rise time of a ramp, length of a pulse or a sine [s]"),
    number("--period", "S", DURATION_S, "of a sine [s]"),
)
FAULT = _command(
    "fault",
    f"make a sensor of the emulated plant fail; magnitudes: {_MAGNITUDES}",
    option("sensor", choices=tuple(FAULT_MAGNITUDE)),
    option("kind", choices=(*FAULT_KINDS, CLEAR), help="clear (or none) ends the sensor's fault"),
    option("magnitude", type=float, nargs="?", help="of spike, bias, drift, delay"),
    number("--duration", "S", DURATION_S, "[s]; without: until cleared", 0.0),
)
SWITCH = _command(
    "switch",
    "apply another controller",
    option("controller", help="its name, e.g. decentral; see 'controllers'"),
    switch("--strict", "refuse unless it is ready"),
    number(
        "--wait",
        "S",
        Range(0.0, 600.0, "s"),
        "maximum time to wait until it is ready, 0 to 600 s",
        5.0,
    ),
)
CONTROLLERS = _command("controllers", "the controllers in the graph and their health")
MODE = _command(
    "mode",
    "source of commands: a controller (auto), your values (manual), "
    "the last command (hold), safe stop",
    option("mode", choices=OPERATOR_MODES),
    number("--axial-force", "KN", ranges.COMMAND_FORCE_KN, f"manual: {ranges.COMMAND_FORCE_KN}"),
    number("--speed", "RPM", ranges.COMMAND_SPEED_RPM, f"manual: {ranges.COMMAND_SPEED_RPM}"),
)
ACKNOWLEDGE = _command(
    "acknowledge", "acknowledge a safe stop whose causes are gone, to permit another mode"
)

WELD = group("weld", "run a weld; hold, resume or abort it")
WELD_RUN = _command(
    "weld run",
    "run a scenario in the running graph and follow it; the weld continues if this command ends",
    option("scenario", metavar="SCENARIO", help="YAML file, or name of a shipped scenario"),
    repeated("--set", "KEY=VALUE", "replace a value of the scenario, e.g. controller=nmpc"),
)
WELD_HOLD = _command(
    "weld hold", "stop the travel of the programme and keep the set-points in force"
)
WELD_RESUME = _command("weld resume", "go back to the programme by a ramp")
WELD_ABORT = _command(
    "weld abort", "abort the weld; a safe stop is requested until the supervisor answers"
)

_NODE = option("node", metavar="NODE", help="name, e.g. fsw_nmpc; 'status' lists the nodes")
_NAME = option("name", metavar="NAME", help="of the parameter")
PARAM = group("param", "parameters of a running node: list, get, set")
PARAM_LIST = _command(
    "param list", "all parameters of a node with their values and meaning", _NODE
)
PARAM_GET = _command("param get", "value of a parameter", _NODE, _NAME)
PARAM_SET = _command(
    "param set",
    "change a parameter; the node may refuse, with a reason",
    *(_NODE, _NAME),
    option("value", metavar="VALUE", help="new value, as YAML"),
)

_MANAGED = {"metavar": "NODE", "help": "name, e.g. fsw_recorder"}
LIFECYCLE = group("lifecycle", "managed nodes (plant, gateway, recorder): list, get, set")
LIFECYCLE_LIST = _command(
    "lifecycle list",
    "the managed nodes, or the transitions that a node has now",
    option("node", nargs="?", default="", **_MANAGED),
)
LIFECYCLE_GET = _command("lifecycle get", "state of a node", option("node", **_MANAGED))
LIFECYCLE_SET = _command(
    "lifecycle set",
    "a transition of a node: configure, activate, deactivate, cleanup or shutdown",
    option("node", **_MANAGED),
    option("transition", metavar="TRANSITION", help="label, e.g. activate"),
)
