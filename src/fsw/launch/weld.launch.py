"""Starts a weld: plant or gateway, controllers, supervisors; if asked for, recorder, player, page.

With a scenario the launch ends when the player has played it; without one it runs until Ctrl-C and
is steered by hand. So it does in real time after the programme of a weld was aborted: the safe
stop is carried out and can be acknowledged. Without a scenario a player waits for welds as goals
of the action fsw/run_weld. Plant, gateway and recorder are managed nodes that configure and
activate themselves, unless autostart is false. Controllers, supervisors, recorder and page are
started again when they die; one that refuses its parameters ends the launch. So is the gateway,
while the machine's watchdog holds. The plant is not: a weld cannot be restarted half-way, so its
end is the end of the launch. To start a supervisor again costs a second, in which the drives hold;
so in real time a second one stands by and takes over within two ticks.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.logging import launch_config
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from fsw_control.schema.errors import InputError
from fsw_control.schema.extensions import extensions
from fsw_scenario.controllers import variants_of
from fsw_scenario.graph import ONCE, STANDBY, Process, WeldGraph, for_standby
from fsw_scenario.launcher import ABORTED, REFUSED, RESPAWN_DELAY_S
from fsw_scenario.procedure import check_signed, graph_parameters
from fsw_scenario.procedure import shipped as procedures
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, parse, shipped

ARGUMENTS = {
    "controllers": (
        "decentral,nmpc",
        "Controllers that run, separated by commas; the first is applied at the start unless the "
        "scenario swaps them; your own: MODULE:CLASS or FILE.py:CLASS",
    ),
    "machine": (
        "",
        "Machine file: the gateway to this machine runs instead of the emulated "
        "plant; empty: the plant",
    ),
    "scenario": (
        "",
        f"Scenario to play: path of a YAML file, or one of {', '.join(shipped())}; "
        "empty: control by hand",
    ),
    "record": ("false", "Whether a recorder runs"),
    "bag_dir": (
        "",
        "Folder of the bag, must not exist; empty: out/weld_<date>-<time>. "
        "A restarted recorder continues beside it, in <folder>_1",
    ),
    "procedure": (
        "",
        f"Welding procedure: YAML file, or one of {', '.join(procedures())}. "
        "Interlocks, limits of commands and the page's bands follow from it, "
        "deviations are reported on /diagnostics, and the weld's record is written into the "
        "bag's folder; empty: none",
    ),
    "require_signed": ("false", "Whether an unsigned procedure is refused"),
    "trusted": (
        "",
        "Keys whose signatures of a procedure count: public key or list of them "
        "(YAML); empty: any",
    ),
    "standby": (
        "",
        "Whether a second supervisor runs on standby and takes over when the first dies; "
        "empty: in real time",
    ),
    "heat": (
        "",
        "Heat profile of the type of weld, from fsw.py learn (YAML); "
        "the player publishes it; empty: none",
    ),
    "monitor": ("false", "Whether the monitor watches the weld and names causes and advice"),
    "model_file": ("", "Model of this machine (YAML), for the monitor; empty: the paper's"),
    "covariance_file": (
        "",
        "Covariance of that model, as `identify --covariance` writes it; "
        "empty: wide enough for a model within 10 %",
    ),
    "hmi": ("false", "Whether the operator's page is served; its address and a token are printed"),
    "hmi_port": ("8080", "Port of the operator's page; 0: any free one"),
    "realtime": ("true", "true: 10 Hz on the wall clock; false: simulated time"),
    "speed": (
        "",
        "Pace of simulated time against the wall clock, 0: lockstep; "
        "empty: lockstep unless realtime",
    ),
    "namespace": ("", "Namespace of all nodes and topics but /clock and /diagnostics"),
    "params_file": ("", "Parameter file that overrides config/weld.yaml and the scenario"),
    "autostart": (
        "true",
        "Whether the managed nodes (plant, gateway, recorder) configure and activate themselves; "
        "false: they wait for `ros2 lifecycle set`",
    ),
    "log_level": ("info", "Log level of all nodes"),
}
TRUE, FALSE = ("true", "True"), ("false", "False")
FLAG = [*TRUE, *FALSE]
LEVELS = ["debug", "info", "warn", "error", "fatal"]
CHOICES = {
    **dict.fromkeys(("record", "monitor", "hmi", "realtime", "autostart", "require_signed"), FLAG),
    "standby": ["", *FLAG],
    "log_level": [*LEVELS, *map(str.upper, LEVELS)],
}
#: programs that are managed nodes
MANAGED = ("fsw_plant", "fsw_machine", "fsw_recorder")


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the nodes follow from them."""
    declared = [
        DeclareLaunchArgument(
            name, default_value=default, description=description, choices=CHOICES.get(name)
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=weld)])


def weld(context: LaunchContext) -> list[Any]:
    """Make the nodes, now that the arguments are known.

    Raises
    ------
    RuntimeError
        When an argument is wrong.
    """
    arguments = {name: LaunchConfiguration(name).perform(context).strip() for name in ARGUMENTS}
    labels = [label.strip() for label in arguments["controllers"].split(",") if label.strip()]
    try:
        variants = variants_of(labels)
    except InputError as error:
        raise RuntimeError(f"controllers: {error}") from None
    controllers = list(variants)
    if not controllers:
        raise RuntimeError("controllers: at least one is needed, e.g. controllers:=decentral")
    speed = _speed(arguments["realtime"] in TRUE, arguments["speed"])
    standby = speed is None if arguments["standby"] == "" else arguments["standby"] in TRUE
    folder = Path(launch_config.log_dir)
    scenario = _scenario(arguments["scenario"], controllers[0])
    machine = _machine_file(arguments["machine"], speed, scenario)
    companions = [name for name in ("monitor", "hmi") if arguments[name] in TRUE]
    graph = WeldGraph(
        scenario,
        folder,
        controllers,
        realtime=speed is None,
        record=arguments["record"] in TRUE,
        standby=standby,
        parameters=variants,
        companions=[*companions, *(["procedure"] if arguments["procedure"] else [])],
        derived=_derived(arguments, machine, scenario),
        machine=bool(machine),
        speed=speed or 0.0,
        heat=Path(arguments["heat"]).expanduser() if arguments["heat"] else None,
    )
    parameters = graph.parameter_file(folder / "scenario.yaml")
    parameters.pop(STANDBY, None)  # it gets those of the first, from whatever file
    if not arguments["bag_dir"]:
        parameters["fsw_recorder"]["ros__parameters"].pop("output", None)
    if scenario is not None:
        (folder / "scenario.yaml").write_text(scenario.text, encoding="utf-8")
    node = _Nodes(arguments, _write(folder / "weld_parameters.yaml", parameters))

    return [
        LogInfo(
            msg=f"weld with {', '.join(graph.all_controllers)}; "
            f"parameters and scenario are in {folder}"
        ),
        *(node(process, **_end_of(process, graph)) for process in graph.processes),
    ]


def _end_of(process: Process, graph: WeldGraph) -> dict[str, Any]:
    """Options of a node for its end: it ends the launch, or the node is started again."""
    if process.name not in ONCE or (process.name == "scenario" and graph.scenario is None):
        return _respawn()
    if process.name == "scenario":
        return {"on_exit": _after_player(graph.realtime)}
    return {"on_exit": [Shutdown(reason="the plant has ended")]}


def _derived(
    arguments: dict[str, str], machine: str, scenario: Scenario | None
) -> dict[str, dict[str, Any]]:
    """Parameters by node that follow from the arguments; RuntimeError when one is wrong."""
    nodes = defaultdict[str, dict[str, Any]](dict, _by_procedure(arguments))
    bag = Path(arguments["bag_dir"]).expanduser() if arguments["bag_dir"] else None
    if bag is not None and arguments["record"] in TRUE and bag.exists():
        raise RuntimeError(
            f"bag_dir: {bag} exists already; choose another folder or remove this one"
        )
    if bag is not None:
        nodes["fsw_recorder"] |= {"number_if_taken": True, "output": str(bag)}
    nodes["fsw_hmi"]["port"] = _port(arguments["hmi_port"])
    on_canister = machine or (scenario is not None and scenario.on_canister)
    nodes["fsw_monitor"]["process"] = "canister" if on_canister else "paper"
    for name in ("model_file", "covariance_file"):
        if arguments[name]:
            nodes["fsw_monitor"][name] = str(Path(arguments[name]).expanduser().absolute())
    if machine:
        nodes["fsw_machine"]["machine_file"] = machine
    if arguments["autostart"] in FALSE:
        for name in MANAGED:
            nodes[name]["autostart"] = False
    return nodes


def _package_of(program: str) -> str:
    """Package that a program is of, by its entry point; RuntimeError when it is not installed."""
    point = extensions("fsw.nodes").get(program)
    if point is None:
        raise RuntimeError(f"{program}: no installed package has this node")
    return point.module.partition(".")[0]


def _respawn() -> dict[str, Any]:
    """Options of a node that is restarted when it dies, but not when it refuses its first start.

    A later refusal does not end the weld: it may pass, as a full disk does.
    """
    ended = False

    def on_exit(event: ProcessExited, _: LaunchContext) -> None:
        nonlocal ended
        first, ended = not ended, True
        if first and event.returncode == REFUSED:
            raise RuntimeError(
                f"{event.process_name} refuses its parameters or arguments; "
                "the line it printed says why"
            )

    return {"respawn": True, "respawn_delay": RESPAWN_DELAY_S, "on_exit": on_exit}


def _after_player(realtime: bool) -> Callable[[ProcessExited, LaunchContext], list[Any]]:
    """End the launch with the scenario player, except for a real-time weld in its safe stop."""

    def on_exit(event: ProcessExited, _: LaunchContext) -> list[Any]:
        if realtime and event.returncode == ABORTED:
            return [
                LogInfo(
                    msg="the programme was aborted; the other nodes keep running, Ctrl-C ends them"
                )
            ]
        return [Shutdown(reason="the scenario player has ended")]

    return on_exit


class _Nodes:
    """Makes node actions that share arguments and parameter files."""

    def __init__(self, arguments: dict[str, str], parameters: Path) -> None:
        self._namespace = arguments["namespace"] or None
        self._log_level = arguments["log_level"]
        self._folder = parameters.parent
        share = Path(get_package_share_directory("fsw"))
        self._files = [str(share / "config" / "weld.yaml"), str(parameters)]
        if arguments["params_file"]:
            file = Path(arguments["params_file"]).expanduser()
            if not file.is_file():
                raise RuntimeError(f"params_file: there is no file {file}")
            self._files.append(str(file))

    def __call__(self, process: Process, **options: Any) -> Node:
        parameters: list[Any] = self._files
        if process.name == "standby":
            options |= {"name": STANDBY, "exec_name": "standby"}
            parameters = [*self._files_of_standby(), {"standby": True}]
        return Node(
            package=_package_of(process.node),
            executable=process.node,
            arguments=list(process.words),
            namespace=self._namespace,
            parameters=parameters,
            ros_arguments=["--log-level", self._log_level],
            output="screen",
            **options,
        )

    def _files_of_standby(self) -> list[str]:
        """Parameters of the first supervisor, whatever file they come from."""
        files = []
        for number, file in enumerate(self._files):
            copy = self._folder / f"standby_parameters_{number}.yaml"
            copy.write_text(for_standby(Path(file).read_text(encoding="utf-8")), encoding="utf-8")
            files.append(str(copy))
        return files


def _scenario(source: str, controller: str) -> Scenario | None:
    if not source:
        return None
    try:
        scenario = load(Path(source).expanduser())
        if scenario.open_loop or len(scenario.controllers) > 1:
            return scenario
        return parse(scenario.text, source, [f"controller={controller}"])
    except InputError as error:
        raise RuntimeError(f"scenario: {error}") from None


def _by_procedure(arguments: dict[str, str]) -> dict[str, dict[str, Any]]:
    """Parameters by node that follow from a procedure."""
    source, required = arguments["procedure"], arguments["require_signed"] in TRUE
    if not source:
        if required:
            raise RuntimeError("require_signed: needs a procedure")
        return {}
    try:
        check_signed(
            source, [Path(arguments["trusted"])] if arguments["trusted"] else [], required
        )
        return graph_parameters(source)
    except InputError as error:
        raise RuntimeError(f"procedure: {error}") from None


def _write(path: Path, parameters: dict[str, Any]) -> Path:
    """Write a parameter file that fits its nodes in any namespace."""
    content = {
        f"/**/{name}": section
        for name, section in parameters.items()
        if section["ros__parameters"]
    }
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def _machine_file(text: str, speed: float | None, scenario: Scenario | None) -> str:
    """Path of the machine file, empty without a machine."""
    if not text:
        return ""
    if speed is not None:
        raise RuntimeError(
            "machine: a machine runs in real time; leave realtime and speed as they are"
        )
    if scenario is not None:
        raise RuntimeError(
            "machine: a scenario needs the emulated plant; control by hand, or omit machine"
        )
    file = Path(text).expanduser()
    if not file.is_file():
        raise RuntimeError(f"machine: there is no file {file}")
    return str(file.resolve())


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise RuntimeError(f"hmi_port: {text!r} is not a port, 0 to 65535")
    return int(text)


def _speed(realtime: bool, text: str) -> float | None:
    """Pace of simulated time; None: the wall clock."""
    if not text:
        return None if realtime else 0.0
    try:
        speed = float(text)
    except ValueError:
        speed = -1.0
    if not 0.0 <= speed <= 1000.0:
        raise RuntimeError(f"speed: {text!r} is not a number from 0 to 1000")
    return None if realtime and speed == 1.0 else speed
