"""Scenarios: shipped ones, the meaning of events at ticks, and bad input."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.contract import Command, Reference
from fsw_control.schema.models import InputError
from fsw_scenario import scenario_file, timeline
from fsw_scenario.scenario import tick_of

START = Reference(2.66, 850.0)


@pytest.mark.parametrize("name", scenario_file.shipped())
def test_shipped_scenarios_are_valid(name):
    scenario = scenario_file.load(name)
    assert scenario.name == name
    assert scenario.description
    assert scenario.n_ticks > 100


def test_every_paper_figure_has_a_scenario():
    figures = {
        number for name in scenario_file.shipped() for number in scenario_file.load(name).figures
    }
    assert figures == {4, 5, 6, 7, 8, 9}


def _scenario(events, controller="decentral", duration=10.0):
    return scenario_file.parse(
        f"{{name: t, duration_s: {duration}, controller: {controller}, events: {events}}}"
    )


def test_step_takes_effect_at_the_first_tick_after_its_time():
    scenario = _scenario(
        "[{at_s: 2.0, reference: {depth_mm: 2.8}}, {at_s: 3.05, reference: {temperature_c: 860}}]"
    )
    assert timeline.references(scenario, START) == {
        0: START,
        20: Reference(2.8, 850.0),
        31: Reference(2.8, 860.0),
    }


def test_ramp_is_linear_from_its_event_to_its_goal():
    scenario = _scenario("[{at_s: 1.0, reference: {depth_mm: 2.96, over_s: 3.0}}]")
    changes = timeline.references(scenario, START)
    assert set(changes) == {0, *range(11, 41)}
    assert changes[25].depth_mm == pytest.approx(2.81)
    assert changes[40] == Reference(2.96, 850.0)


def test_interrupted_ramp_continues_from_the_present_value():
    scenario = _scenario(
        "[{at_s: 1.0, reference: {depth_mm: 2.96, over_s: 3.0}}, {at_s: 2.5, "
        "reference: {temperature_c: 851}}]"
    )
    changes = timeline.references(scenario, START)
    last = changes[max(changes)]
    assert max(changes) == 25
    assert last.depth_mm == pytest.approx(2.66 + 0.3 * 14 / 30)
    assert last.temperature_c == 851


def test_sine_swings_about_the_set_point_until_the_next_event():
    scenario = _scenario(
        "[{at_s: 1.0, reference: {sine: {depth_mm: 0.1, period_s: 4.0}}}, {at_s: 6.0, "
        "reference: {depth_mm: 2.7}}]"
    )
    changes = timeline.references(scenario, START)
    assert changes[20].depth_mm == pytest.approx(2.76)
    assert changes[40].depth_mm == pytest.approx(2.56)
    assert changes[60] == Reference(2.7, 850.0)
    assert max(changes) == 60


def test_commands_and_switches():
    scenario = _scenario("[{at_s: 2.0, command: {force_kn: 80}}]", "none")
    assert timeline.commands(scenario, Command(78.4, 400.0)) == {
        0: Command(78.4, 400.0),
        20: Command(80.0, 400.0),
    }
    switching = _scenario("[{at_s: 2.0, switch: nmpc}]")
    assert timeline.switches(switching) == {20: "nmpc"}
    assert switching.controllers == ("decentral", "nmpc")


@given(st.integers(0, 100_000))
def test_time_rounds_up_to_the_next_tick(tick):
    assert tick_of(tick * 0.1) == tick
    assert tick_of(tick * 0.1 + 0.01) == tick + 1


BAD = [
    ("a: [", "line 2"),
    ("name: x\nname: y\nduration_s: 1", "'name' is given twice"),
    ("- 1", "mapping"),
    ("name: x", "lacks duration_s"),
    ("name: x\nduration_s: -5", "outside 0.1 to 36000 s"),
    ("name: x\nduration_s: yes", "not a number"),
    ("name: x\nduration_s: .nan", "outside"),
    ("name: x\nduration_s: 5\nevnts: []", "evnts is an unknown key; did you mean events?"),
    ("name: x\nduration_s: 5\nevents: 3", "events is 3: must be a list"),
    ("name: x\nduration_s: 5\nevents: [3]", "events[0] is 3: must be a mapping"),
    ("name: x\nduration_s: 5\nevents: [{at_s: 1}]", "exactly one of"),
    ("name: x\nduration_s: 5\nevents: [{at_s: 9, switch: a}]", "outside 0 to 5 s"),
    (
        "name: x\nduration_s: 5\nevents: [{at_s: 2, switch: a}, {at_s: 1, switch: b}]",
        "events[1] is earlier",
    ),
    ("name: x\nduration_s: 5\nevents: [{at_s: 1, reference: {depth_mm: 9}}]", "1.5 to 4 mm"),
    ("name: x\nduration_s: 5\nevents: [{at_s: 1, reference: {depth: 2.7}}]", "known: depth_mm"),
    ("name: x\nduration_s: 5\nevents: [{at_s: 1, reference: {}}]", "needs depth_mm"),
    (
        "name: x\nduration_s: 5\nevents: [{at_s: 1, disturbance: {channel: depth, shape: step}}]",
        "lacks amplitude_mm",
    ),
    (
        "name: x\nduration_s: 5\nevents: [{at_s: 1, disturbance: {channel: z}}]",
        "must be 'depth', 'temperature'",
    ),
    (
        "name: x\nduration_s: 5\nevents: [{at_s: 1, fault: {sensor: depth, kind: bias}}]",
        "lacks magnitude_mm",
    ),
    (
        "name: x\nduration_s: 5\nevents: [{at_s: 1, fault: {sensor: depth, kind: nan, "
        "magnitude_mm: 1}}]",
        "does not use",
    ),
    (
        "name: x\nduration_s: 5\nevents: [{at_s: 1, command: {force_kn: 80}}]",
        "needs controller: none",
    ),
    (
        "name: x\nduration_s: 5\ncontroller: none\nevents: [{at_s: 1, switch: a}]",
        "controller is none",
    ),
    ("name: x\nduration_s: 5\nfigures: [3]", "figures[0] is 3: must be 4"),
    ("name: x\nduration_s: 5\nplant: {seed: -1}", "plant is wrong"),
    ("name: x\nduration_s: 5\nplant: {factors: {thermal: 1.1}}", "factors.thermal"),
    ("name: [x]\nduration_s: 5", "must be a valid string"),
]


@pytest.mark.parametrize(("text", "part"), BAD)
def test_bad_scenario_is_one_clear_error(text, part):
    with pytest.raises(InputError) as error:
        scenario_file.parse(text, "weld.yaml")
    assert str(error.value).startswith("weld.yaml")
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@given(st.text(max_size=80))
def test_any_text_gives_a_scenario_or_an_input_error(text):
    with pytest.raises(InputError):
        scenario_file.parse(text)


def test_overrides_reach_nested_values_and_the_text():
    scenario = scenario_file.load(
        "quick", ["plant.noise=false", "controller=nmpc", "plant.start.depth_mm=2.7"]
    )
    assert scenario.plant == {"seed": 7, "noise": False, "start.depth_mm": 2.7}
    assert scenario_file.parse(scenario.text) == scenario


@pytest.mark.parametrize("override", ["noise", "=1", "name.x=1", "plant.noise=["])
def test_bad_override_is_an_error(override):
    with pytest.raises(InputError, match="override"):
        scenario_file.load("quick", [override])


def test_missing_scenario_lists_the_shipped_ones(tmp_path):
    with pytest.raises(InputError, match="reference_tracking"):
        scenario_file.load(tmp_path / "nothing.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        scenario_file.load(tmp_path / "binary.yaml")


def test_documented_scenarios_are_valid():
    """The examples of docs/how-to/scenarios.md, the second less what excludes each other, are valid scenarios."""
    text = (Path(__file__).resolve().parents[3] / "docs" / "how-to" / "scenarios.md").read_text()
    first, example = (block.split("```")[0] for block in re.split(r"```yaml.*\n", text)[1:3])
    assert len(scenario_file.parse(first, "scenarios.md").events) == 2
    lines = [line for line in example.splitlines() if "command:" not in line]
    events = [line for line in lines if line.startswith("  - ")]
    head = "\n".join(line for line in lines if line not in events)
    events.sort(key=lambda line: float(line.split("at_s: ")[1].split(",")[0]))
    scenario = scenario_file.parse(
        head.replace("figures:", "\n".join(events) + "\nfigures:"), "scenarios.md"
    )
    assert len(scenario.events) == 6
