"""Nodes and parameters of the launch file: those of the graph that the launcher starts, too."""

import pytest
import yaml

from fsw_control.schema.errors import InputError
from fsw_scenario.graph import WeldGraph
from fsw_scenario.scenario_file import load
from fsw_scenario.weld_options import WeldOptions
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


@pytest.mark.parametrize(
    ("texts", "realtime", "speed"),
    [
        ({}, True, 1.0),
        ({"speed": "1.0"}, True, 1.0),
        ({"speed": "0"}, False, 0.0),
        ({"speed": "2.5"}, False, 2.5),
        ({"realtime": "false"}, False, 0.0),
        ({"realtime": "False", "speed": "1.0"}, False, 1.0),
    ],
)
def test_pace_of_time(tmp_path, texts, realtime, speed):
    graph = WeldOptions.from_texts(texts).graph(tmp_path)
    assert (graph.realtime, graph.speed, graph.standby) == (realtime, speed, realtime)


@pytest.mark.parametrize(
    ("texts", "path"),
    [
        ({"speed": "fast"}, "speed"),
        ({"speed": "1001"}, "speed"),
        ({"hmi_port": "65536"}, "hmi_port"),
        ({"record": "perhaps"}, "record"),
        ({"machine": "machine.yaml", "realtime": "false"}, "machine"),
        ({"machine": "machine.yaml", "scenario": SCENARIO}, "machine"),
        ({"require_signed": "true"}, "require_signed"),
    ],
)
def test_wrong_options_are_named(texts, path):
    with pytest.raises(InputError) as caught:
        WeldOptions.from_texts(texts)
    assert [problem.path for problem in caught.value.problems] == [path]


def test_bag_of_the_recorder(tmp_path):
    recorder = WeldOptions(record=True, bag_dir=str(tmp_path / "bag")).graph(tmp_path).derived
    assert recorder["fsw_recorder"] == {
        "number_if_taken": True,
        "output": str(tmp_path / "bag"),
    }
    for options in (
        WeldOptions(record=True, bag_dir=str(tmp_path)),
        WeldOptions(controllers=" ,"),
        WeldOptions(params_file=str(tmp_path / "none.yaml")),
        WeldOptions(machine=str(tmp_path / "none.yaml")),
    ):
        with pytest.raises(InputError):
            options.graph(tmp_path)
