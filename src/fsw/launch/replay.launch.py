"""Plays a bag into the graph; controllers named as shadows compute along, and their proposals are not applied.

A shadow sees the recorded measurements, references and commands. What it publishes goes to
shadow/<name>/proposal, status and prediction, beside what was recorded under fsw/<name>. The
launch ends when the bag is over.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from fsw_control.sensors import REQUIRED, SENSORS

TOPICS = [f"/{SENSORS[name].topic}" for name in REQUIRED]
OWN_TOPICS = ("proposal", "status", "prediction")
ARGUMENTS = {
    "bag": (None, "Bag to play: folder or file"),
    "rate": (
        "1.0",
        "Playback rate relative to the time of the weld, real or simulated; 2 plays twice as fast",
    ),
    "start_paused": ("false", "Wait for the services /fsw_replay/resume or /fsw_replay/play_next"),
    "controllers": ("", "Controllers to run as shadows, separated by commas, e.g. nmpc"),
    "params_file": ("", "Parameter file that overrides config/weld.yaml"),
    "log_level": ("info", "Log level of all nodes"),
}
TRUE, FALSE = ("true", "True"), ("false", "False")
CHOICES = {"start_paused": [*TRUE, *FALSE]}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the nodes follow from them."""
    declared = [
        DeclareLaunchArgument(
            name, default_value=default, description=description, choices=CHOICES.get(name)
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=replay)])


def replay(context: LaunchContext) -> list[Any]:
    """Make the nodes, now that the arguments are known.

    Raises
    ------
    RuntimeError
        When there is no such bag or parameter file, or another argument is wrong.
    """
    arguments = {name: LaunchConfiguration(name).perform(context).strip() for name in ARGUMENTS}
    bag = Path(arguments["bag"]).expanduser()
    if not bag.exists():
        raise RuntimeError(f"bag: there is nothing at {bag}")
    files = [str(Path(get_package_share_directory("fsw")) / "config" / "weld.yaml")]
    if arguments["params_file"]:
        files.append(str(Path(arguments["params_file"]).expanduser()))
        if not Path(files[-1]).is_file():
            raise RuntimeError(f"params_file: there is no file {files[-1]}")
    shadows = list(
        dict.fromkeys(name.strip() for name in arguments["controllers"].split(",") if name.strip())
    )
    common = {"output": "screen", "ros_arguments": ["--log-level", arguments["log_level"]]}
    shadow_nodes = [
        Node(
            package=f"fsw_{name}",
            executable=name,
            parameters=[*files, {"use_sim_time": True}],
            remappings=[(f"fsw/{name}/{topic}", f"shadow/{name}/{topic}") for topic in OWN_TOPICS],
            **common,
        )
        for name in shadows
    ]
    player = {
        "bag": ParameterValue(str(bag), value_type=str),
        "rate": _rate(arguments["rate"]),
        "start_paused": arguments["start_paused"] in TRUE,
        **({"wait_for": TOPICS} if shadows else {}),
    }
    over = [Shutdown(reason="the player has ended")]
    replay_node = Node(
        package="fsw_recorder",
        executable="replay",
        parameters=[*files, player],
        on_exit=over,
        **common,
    )
    return [*shadow_nodes, replay_node]


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0.0 < rate <= 1e6:
        raise RuntimeError(f"rate: {text!r} is not a number above 0")
    return rate
