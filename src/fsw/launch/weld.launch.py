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

from fsw_control.schema.extensions import extensions
from fsw_scenario.graph import ONCE, STANDBY, Process, WeldGraph, for_standby
from fsw_scenario.launcher import ABORTED, REFUSED, RESPAWN_DELAY_S
from fsw_scenario.weld_options import WeldOptions


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the nodes follow from them."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text, choices=choices)
        for name, default, text, choices in WeldOptions.arguments()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=weld)])


def weld(context: LaunchContext) -> list[Any]:
    """Make the nodes, now that the arguments are known.

    Raises
    ------
    fsw_control.schema.models.InputError
        When an argument is wrong.
    """
    texts = {
        name: LaunchConfiguration(name).perform(context).strip()
        for name, *_ in WeldOptions.arguments()
    }
    options, folder = WeldOptions.from_texts(texts), Path(launch_config.log_dir)
    graph = options.graph(folder)
    if graph.scenario is not None:
        (folder / "scenario.yaml").write_text(graph.scenario.text, encoding="utf-8")
    files = _parameter_files(options, graph)
    return [
        LogInfo(
            msg=f"weld with {', '.join(graph.all_controllers)}; "
            f"parameters and scenario are in {folder}"
        ),
        *(_node(process, options, graph, files) for process in graph.processes),
    ]


def _parameter_files(options: WeldOptions, graph: WeldGraph) -> list[str]:
    """Parameter files of all nodes; ours fits its nodes in any namespace."""
    parameters = graph.parameter_file(graph.folder / "scenario.yaml")
    parameters.pop(STANDBY, None)  # it gets those of the first, from whatever file
    content = {
        f"/**/{name}": section
        for name, section in parameters.items()
        if section["ros__parameters"]
    }
    ours = graph.folder / "weld_parameters.yaml"
    ours.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    files = [Path(get_package_share_directory("fsw")) / "config" / "weld.yaml", ours]
    if options.params_file:
        files.append(Path(options.params_file).expanduser())
    return list(map(str, files))


def _node(process: Process, options: WeldOptions, graph: WeldGraph, files: list[str]) -> Node:
    """The action of a process."""
    point = extensions("fsw.nodes").get(process.node)
    if point is None:
        raise RuntimeError(f"{process.node}: no installed package has this node")
    parameters: list[Any] = files
    more = _end_of(process, graph)
    if process.name == "standby":
        more |= {"name": STANDBY, "exec_name": "standby"}
        parameters = [*_files_of_standby(files, graph.folder), {"standby": True}]
    return Node(
        package=point.module.partition(".")[0],
        executable=process.node,
        arguments=list(process.words),
        namespace=options.namespace or None,
        parameters=parameters,
        ros_arguments=["--log-level", options.log_level],
        output="screen",
        **more,
    )


def _files_of_standby(files: list[str], folder: Path) -> list[str]:
    """Parameters of the first supervisor, whatever file they come from."""
    copies = []
    for number, file in enumerate(files):
        copy = folder / f"standby_parameters_{number}.yaml"
        copy.write_text(for_standby(Path(file).read_text(encoding="utf-8")), encoding="utf-8")
        copies.append(str(copy))
    return copies


def _end_of(process: Process, graph: WeldGraph) -> dict[str, Any]:
    """Options of a node for its end: it ends the launch, or the node is started again."""
    if process.name not in ONCE or (process.name == "scenario" and graph.scenario is None):
        return _respawn()
    if process.name == "scenario":
        return {"on_exit": _after_player(graph.realtime)}
    return {"on_exit": [Shutdown(reason="the plant has ended")]}


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
