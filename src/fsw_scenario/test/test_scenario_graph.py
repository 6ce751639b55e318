"""Parameters of the processes of a weld."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from fsw_scenario.graph import STANDBY, WeldGraph, for_standby
from fsw_scenario.launcher import LaunchError
from fsw_scenario.scenario_file import parse

SECTION = "{ros__parameters: {deadline_s: 0.07}}"


@pytest.mark.parametrize(
    "key", ["fsw_supervisor", "/fsw_supervisor", "/**/fsw_supervisor", "/cell_1/fsw_supervisor"]
)
@pytest.mark.parametrize("quote", ["", '"', "'"])
def test_supervisor_parameters_apply_to_the_standby(key, quote):
    text = for_standby(
        f"# of fsw_supervisor: all\n{quote}{key}{quote}: {SECTION}\n/**: {SECTION}\n"
    )
    assert list(yaml.safe_load(text)) == [key.replace("fsw_supervisor", STANDBY), "/**"]


def test_supervisor_sections_of_any_namespace_are_renamed():
    text = f"cell_1:\n  fsw_supervisor: {SECTION}\n  fsw_plant: {SECTION}\n"
    text += f"{STANDBY}: {SECTION}\nmy_fsw_supervisor: {SECTION}\n"
    values = yaml.safe_load(for_standby(text))
    assert list(values) == ["cell_1", STANDBY, "my_fsw_supervisor"]
    assert list(values["cell_1"]) == [STANDBY, "fsw_plant"]


@pytest.mark.parametrize("standby", [False, True])
def test_first_tick_waits_for_a_standby_with_the_supervisors_parameters(standby):
    graph = WeldGraph(
        parse("{name: short, duration_s: 5.0}"),
        Path("weld"),
        ("decentral", "nmpc"),
        standby=standby,
    )
    nodes = {
        name: section["ros__parameters"]
        for name, section in graph.parameter_file(Path("s.yaml")).items()
    }
    assert nodes["fsw_plant"]["wait_for_subscribers"] == 5 + standby
    if standby:
        assert nodes[STANDBY] == nodes["fsw_supervisor"] | {"standby": True}


def test_further_parameters_are_merged_and_companions_not_waited_for(
    tmp_path,
):
    scenario = parse("{name: short, duration_s: 5.0}")
    further = {"fsw_recorder": {"attach": ["limits.yaml"]}, "fsw_watch": {"process": "canister"}}
    graph = WeldGraph(scenario, tmp_path, companions=["watch"], derived=further)
    nodes, usual = (
        weld_graph.parameter_file(tmp_path / "s.yaml")
        for weld_graph in (graph, WeldGraph(scenario, tmp_path))
    )
    assert nodes.pop("fsw_watch")["ros__parameters"] == {
        "process": "canister",
        "use_sim_time": True,
    }
    assert nodes["fsw_recorder"]["ros__parameters"].pop("attach") == ["limits.yaml"]
    assert nodes == usual


class EndedWeld:
    """A launcher of processes whose weld has been played to its end.

    ``codes`` are exit codes other than 0.
    """

    def __init__(self, finished=True, **codes):
        self.children, self.codes, self.log_folder = {}, codes, Path("log")
        self.finished = finished

    def start(self, name, module, arguments=()):
        status = {"tick": 50, "finished": self.finished, "wall_s": 1.5}
        child = SimpleNamespace(
            running=False, process=SimpleNamespace(returncode=self.codes.get(name, 0))
        )
        child.status, child.last_lines, child.log = lambda: status, lambda: "", Path("log")
        self.children[name] = child
        return child

    def wait_until(self, condition, timeout_s, what, watch=None):
        assert condition()

    def stop(self, *names):
        return {name: self.codes.get(name, 0) for name in names or self.children}


def test_exit_of_a_process_after_the_weld_is_a_note(tmp_path, capsys):
    graph = WeldGraph(parse("{name: short, duration_s: 5.0}"), tmp_path)
    assert graph.run(EndedWeld(recorder=-9, supervisor=1, scenario=-14)) == 1.5
    notes = capsys.readouterr().err.splitlines()
    assert len(notes) == 3
    for name, how in (
        ("recorder", "SIGKILL"),
        ("supervisor", "exit code 1"),
        ("scenario", "SIGALRM"),
    ):
        assert any(name in note and how in note for note in notes)


def test_a_weld_is_lost_if_it_was_not_finished_or_its_bag_could_not_be_written(tmp_path):
    graph = WeldGraph(parse("{name: short, duration_s: 5.0}"), tmp_path)
    for launcher in (
        EndedWeld(recorder=1),
        EndedWeld(finished=False),
        EndedWeld(finished=False, scenario=1),
    ):
        with pytest.raises(LaunchError):
            graph.run(launcher)
