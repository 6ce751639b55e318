"""Parameters of the processes of a weld."""

from pathlib import Path

import pytest
import yaml

from fsw_scenario.graph import STANDBY, WeldGraph, for_standby
from fsw_scenario.scenario_file import parse

SECTION = "{ros__parameters: {deadline_s: 0.07}}"


@pytest.mark.parametrize("key", ["fsw_supervisor", "/fsw_supervisor", "/**/fsw_supervisor", "/cell_1/fsw_supervisor"])
@pytest.mark.parametrize("quote", ["", '"', "'"])
def test_what_a_file_says_to_the_supervisor_it_says_to_the_standby(key, quote):
    text = for_standby(f"# of fsw_supervisor: all\n{quote}{key}{quote}: {SECTION}\n/**: {SECTION}\n")
    assert list(yaml.safe_load(text)) == [key.replace("fsw_supervisor", STANDBY), "/**"]


def test_sections_by_namespace_are_found_and_others_left_alone():
    text = f"cell_1:\n  fsw_supervisor: {SECTION}\n  fsw_plant: {SECTION}\n"
    text += f"{STANDBY}: {SECTION}\nmy_fsw_supervisor: {SECTION}\n"
    values = yaml.safe_load(for_standby(text))
    assert list(values) == ["cell_1", STANDBY, "my_fsw_supervisor"]
    assert list(values["cell_1"]) == [STANDBY, "fsw_plant"]


@pytest.mark.parametrize("standby", [False, True])
def test_the_first_tick_waits_for_the_standby_which_is_configured_as_the_supervisor_is(standby):
    graph = WeldGraph(parse("{name: short, duration_s: 5.0}"), Path("weld"), ("decentral", "nmpc"), standby=standby)
    nodes = {name: section["ros__parameters"] for name, section in graph.parameter_file(Path("s.yaml")).items()}
    assert nodes["fsw_plant"]["wait_for_subscribers"] == 5 + standby
    if standby:
        assert nodes[STANDBY] == nodes["fsw_supervisor"] | {"standby": True}


def test_the_monitor_is_told_which_process_it_watches_and_the_plant_does_not_wait_for_it():
    scenario = parse("{name: short, duration_s: 5.0, plant: {process: canister}}")
    graph, without = (WeldGraph(scenario, Path("weld"), ("decentral",), monitor=one) for one in (True, False))
    nodes, usual = (one.parameter_file(Path("s.yaml")) for one in (graph, without))
    assert nodes.pop("fsw_monitor")["ros__parameters"] == {"process": "canister", "use_sim_time": True}
    assert nodes == usual


def test_a_weld_by_a_procedure_has_its_limits_and_its_record(tmp_path):
    scenario = parse("{name: short, duration_s: 5.0}")
    plain = WeldGraph(scenario, tmp_path).parameter_file(tmp_path / "scenario.yaml")
    nodes = WeldGraph(scenario, tmp_path, procedure="copper_lid").parameter_file(tmp_path / "scenario.yaml")
    values = {name: section["ros__parameters"] for name, section in nodes.items()}
    assert values["fsw_supervisor"]["interlocks.depth_high.trip"] == 3.7
    assert values["fsw_recorder"]["output"] == str(tmp_path / "bag")
    assert values["fsw_recorder"]["attach"] == [values["fsw_procedure"]["procedure"]]
    assert "fsw.main record " in values["fsw_recorder"]["on_finished"][0]
    assert values["fsw_procedure"]["use_sim_time"] is True
    assert "fsw_procedure" not in plain
