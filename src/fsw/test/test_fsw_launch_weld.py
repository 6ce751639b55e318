"""Nodes and parameters of the launch file: those of the graph that the launcher starts, too."""

import pytest
import yaml

from fsw_scenario.graph import WeldGraph
from fsw_scenario.scenario_file import load
from fsw_test_support.launch_modules import launching

SCENARIO, OPEN = "reference_tracking", "open_loop_force_steps"


@pytest.fixture
def launched(monkeypatch, tmp_path):
    """Run the launch file with arguments; returns its node actions and parameters by node."""
    make = launching(monkeypatch, tmp_path)

    def launch(**arguments):
        nodes = make(**arguments)
        sections = yaml.safe_load((tmp_path / "weld_parameters.yaml").read_text()).items()
        return nodes, {
            name.rpartition("/")[2]: section["ros__parameters"] for name, section in sections
        }

    return launch


def names_of(nodes):
    return [vars(node).get("exec_name", node.executable) for node in nodes]


@pytest.mark.parametrize(
    ("arguments", "graph"),
    [
        ({}, {"standby": True}),
        ({"scenario": SCENARIO}, {"standby": True}),
        ({"scenario": SCENARIO, "standby": "false", "record": "true"}, {"record": True}),
        ({"scenario": SCENARIO, "realtime": "false"}, {"realtime": False}),
        ({"scenario": OPEN, "hmi": "true"}, {"standby": True, "companions": ["hmi"]}),
    ],
)
def test_the_launch_file_starts_the_nodes_of_the_graph(launched, tmp_path, arguments, graph):
    source = arguments.get("scenario")
    scenario = load(source) if source else None
    options = {"realtime": True, "record": False} | graph
    expected = WeldGraph(scenario, tmp_path, ["decentral", "nmpc"], **options)
    nodes, parameters = launched(**arguments)
    assert names_of(nodes) == [process.name for process in expected.processes]
    assert [node.executable for node in nodes] == [process.node for process in expected.processes]
    sections = expected.parameter_file(tmp_path / "scenario.yaml")
    plant, player = (sections[f"fsw_{name}"]["ros__parameters"] for name in ("plant", "scenario"))
    assert (parameters["fsw_plant"], parameters["fsw_scenario"]) == (plant, player)


def test_restarted_processes_and_those_that_end_the_launch(launched):
    for source in ("", SCENARIO):
        nodes, _ = launched(scenario=source, hmi="true")
        once = {node.executable for node in nodes if not vars(node).get("respawn")}
        assert once == ({"plant", "scenario"} if source else {"plant"})


def test_machine_replaces_the_plant_and_is_restarted(launched, tmp_path):
    (tmp_path / "machine.yaml").touch()
    nodes, parameters = launched(machine=str(tmp_path / "machine.yaml"))
    assert "plant" not in names_of(nodes)
    assert next(node for node in nodes if node.executable == "machine").respawn
    assert parameters["fsw_machine"]["machine_file"] == str(tmp_path / "machine.yaml")


def test_a_node_whose_package_is_not_installed_is_named(launched, monkeypatch):
    monkeypatch.setattr("fsw_control.schema.extensions.extensions", lambda _: {})
    with pytest.raises(RuntimeError, match="recorder"):
        launched(record="true")
