"""``fsw node``: one node of the graph, where the package is installed; in the repository ``scripts/run_*.py`` do it."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from fsw.command import command, option

NODES = {
    "controller": "fsw_scenario.controller_node",
    "decentral": "fsw_decentral.decentral_node",
    "hmi": "fsw_hmi.main",
    "machine": "fsw_machine.machine_node",
    "monitor": "fsw_quality.monitor_node",
    "nmpc": "fsw_nmpc.nmpc_node",
    "plant": "fsw_plant.plant_node",
    "recorder": "fsw_recorder.recorder_node",
    "replay": "fsw_recorder.replay_node",
    "scenario": "fsw_scenario.scenario_node",
    "supervisor": "fsw_supervisor.supervisor_node",
}


@command(
    "node",
    "run one node; what follows its name goes to the node, e.g. --help or --ros-args",
    option("node", choices=sorted(NODES), metavar="NODE", help="which node"),
    option("words", nargs=argparse.REMAINDER, metavar="...", help="arguments of the node"),
)
def node(arguments: argparse.Namespace) -> int:
    sys.argv = [f"fsw node {arguments.node}", *arguments.words]  # nodes read their arguments there
    code: int = import_module(NODES[arguments.node]).main()
    return code
