"""The programme of a whole weld: its phases as data, the machine that runs them, and bad input."""

import itertools
from math import pi

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.contract import Reference
from fsw_control.ramps import stair
from fsw_control.schema.models import InputError
from fsw_plant import PlantSchedule
from fsw_scenario import scenario_file, timeline
from fsw_scenario.scenario import start_reference
from fsw_scenario.weld_programme import PHASES, Phase, PhaseMachine, State, spans

WELD = [
    {"name": "dwell", "duration_s": 5.0},
    {"name": "start", "to_deg": 2.0, "set_points": [{"at_s": 1.0, "depth_mm": 2.7}]},
    {
        "name": "joint_line",
        "to_deg": 4.0,
        "set_points": [{"at_s": 2.0, "temperature_c": 819.4, "over_s": 3.0}],
    },
]


def parse(phases, **others):
    return scenario_file.parse(
        yaml.safe_dump({"name": "t", "phases": phases} | others), "weld.yaml"
    )


def changed(number, **values):
    return [phase | (values if i == number else {}) for i, phase in enumerate(WELD)]


def test_the_canister_is_welded_all_around_in_three_quarters_of_an_hour():
    scenario = scenario_file.load("canister_weld")
    assert [phase.name for phase in scenario.phases] == list(PHASES)
    joint_line = scenario.phases[3]
    assert joint_line.to_deg - joint_line.from_deg == 360.0
    assert joint_line.duration_s / 60.0 == pytest.approx(pi * 1050.0 / 86.0)
    assert 44.0 < scenario.duration_s / 60.0 < 46.0
    assert scenario.announced


def test_set_points_begin_with_their_phase():
    scenario = parse(WELD)
    start_s = 2.0 / 360.0 * pi * 1050.0 / 86.0 * 60.0
    assert spans(scenario.phases)[1] == ("start", 5.0, pytest.approx(5.0 + start_s))
    changes = timeline.references(scenario, start_reference(scenario.plant))
    assert changes[60] == Reference(2.7, 816.4)
    first, last = sorted(changes)[2], max(changes)
    assert first * 0.1 == pytest.approx(5.0 + start_s + 2.0, abs=0.1)
    assert (last - first) * 0.1 == pytest.approx(3.0, abs=0.11)
    assert changes[last] == Reference(2.7, 819.4)
    assert scenario_file.parse(scenario.text) == scenario, "with the duration in it"


BAD = [
    ([], "phases is empty"),
    (5, "phases is 5: must be a list"),
    ([WELD[1], WELD[0]], "phases[1] dwell cannot follow start"),
    ([WELD[0], WELD[0]], "phases[1] dwell cannot follow dwell"),
    (changed(0, name="plunge"), "phases[0].name is 'plunge': must be 'dwell'"),
    (changed(0, duration_s=float("nan")), "phases[0].duration_s = nan is outside"),
    (changed(0, length_mm=3.0), "phases[0] has length_mm but no to_deg"),
    (changed(1, duration_s=3.0), "phases[1] has duration_s and to_deg"),
    (changed(1, speed=86.0), "phases[1].speed is an unknown key"),
    (changed(1, speed_mm_per_min=0.0), "phases[1].speed_mm_per_min = 0 is outside 10 to 300"),
    (changed(2, from_deg=3.0), "phases[2].from_deg = 3 jumps: the previous phase ends at 2 deg"),
    (changed(2, to_deg=1.0), "phases[2].to_deg = 1 is outside 2 to 720 deg"),
    (changed(2, to_deg=721.0), "phases[2].to_deg = 721 is outside 0 to 720 deg"),
    (changed(2, to_deg=2.0), "phases[2] has a path without length"),
    (changed(2, length_mm=1.0), "phases[2].length_mm = 1 is outside 18."),
    (
        changed(1, set_points=[{"depth_mm": 2.9}]),
        "depth_mm = 2.9 jumps by 0.24 mm, more than 0.2; give over_s: 12 or more",
    ),
    (
        changed(1, set_points=[{"temperature_c": 830, "over_s": 12.0}]),
        "jumps by 13.6 degC, more than 12",
    ),
    (
        changed(1, set_points=[{"depth_mm": 5.0}]),
        "set_points[0].depth_mm = 5 is outside 1.5 to 4 mm",
    ),
    (changed(1, set_points=[{"at_s": 20.0, "depth_mm": 2.7}]), "at_s = 20 is outside 0 to 12.7"),
    (
        changed(1, set_points=[{"at_s": 9.0, "over_s": 9.0, "depth_mm": 2.7}]),
        "over_s = 9 is outside 0 to 3.7",
    ),
    (
        changed(1, set_points=[{"over_s": 5.0, "depth_mm": 2.7}, {"at_s": 4.0, "depth_mm": 2.7}]),
        "at_s = 4 is before",
    ),
    (changed(1, set_points=[{"at_s": 4.0}]), "set_points[0] needs depth_mm or temperature_c"),
]


@pytest.mark.parametrize(("phases", "part"), BAD)
def test_a_bad_programme_is_one_clear_error(phases, part):
    with pytest.raises(InputError) as error:
        parse(phases)
    assert str(error.value).startswith("weld.yaml: phases")
    assert part in str(error.value)
    assert "\n" not in str(error.value)


def test_a_ramp_is_announced_as_a_stair_about_it_and_steps_as_they_are():
    ramp = [(100 + i, Reference(2.66, 800.0 + 0.1 * i)) for i in range(101)]
    steps = [
        (10, Reference(2.7, 800.0)),
        (11, Reference(2.66, 800.0)),
        (300, Reference(2.7, 810.0)),
    ]
    plan = stair([*steps[:2], *ramp, steps[2]])
    assert [tick for tick, _ in plan] == [10, 11, *range(100, 201, 10), 300]
    assert (plan[:2], plan[-2:]) == (steps[:2], [ramp[-1], steps[2]])
    assert [reference.temperature_c for _, reference in plan[2:-2]] == pytest.approx(
        [800.5 + i for i in range(10)]
    )
    assert stair([]) == []


def test_an_event_at_an_angle_has_the_time_at_which_the_tool_first_passes():
    edge = {"disturbance": {"channel": "depth", "shape": "step", "amplitude_mm": 0.1}}
    scenario = parse(
        WELD, events=[edge | {"at_deg": 0.0}, edge | {"at_deg": 2.0}, edge | {"at_deg": 3.0}]
    )
    per_deg = pi * 1050.0 / 360.0 / 86.0 * 60.0
    times = [event.at_s for event in scenario.events if event.at_s != 6.0 and event.disturbance]
    assert times == pytest.approx([5.0, 5.0 + 2.0 * per_deg, 5.0 + 3.0 * per_deg], abs=0.051)
    assert "at_deg" not in scenario.text, "the plant does not know angles"
    for wrong, words in (
        ({"at_deg": 4.1}, r"at_deg = 4\.1 .* 0 to 4 deg"),
        ({"at_deg": 1, "at_s": 1}, "one of"),
    ):
        with pytest.raises(InputError, match=words):
            parse(WELD, events=[edge | wrong])


def test_duration_or_events_against_the_phases_are_refused():
    with pytest.raises(InputError, match=r"duration_s = 99, .* 30\.6 s"):
        parse(WELD, duration_s=99.0)
    with pytest.raises(InputError, match="give set_points"):
        parse(WELD, events=[{"at_s": 1.0, "reference": {"depth_mm": 2.7}}])


durations = st.lists(st.floats(0.1, 30.0), min_size=1, max_size=len(PHASES))
#: what happens; a number: so much later is the next tick of the process
events = st.sampled_from(
    [1, 1, 1, 15, 0, -3, 36_000, -36_000, "hold", "resume", "hold", "resume", "abort"]
)
actions = st.lists(events, max_size=200)


@given(durations, actions)
def test_phases_follow_in_order_and_only_while_running(durations, actions):
    angles = itertools.pairwise(itertools.accumulate(durations, initial=0.0))
    phases = [
        Phase.model_construct(
            name=name,
            duration_s=duration_s,
            from_deg=angle[0],
            to_deg=angle[1],
            length_mm=duration_s,
        )
        for name, duration_s, angle in zip(PHASES, durations, angles, strict=False)
    ]
    machine, number = PhaseMachine(phases), 0
    for action in actions:
        last, state = machine.progress(), machine.state
        late = isinstance(action, int) and action <= 0 and action != -36_000
        if isinstance(action, int):
            machine.follow(number + action)
            number += 0 if late else action
        else:
            done, words = getattr(machine, action)()
            allowed = {
                "hold": [State.RUNNING],
                "resume": [State.HELD],
                "abort": [State.RUNNING, State.HELD],
            }[action]
            assert done == (state in allowed)
            assert words and "\n" not in words
        now = machine.progress()
        assert PHASES.index(now.phase) >= PHASES.index(last.phase)
        assert now.angle_deg == pytest.approx(now.length_mm), (
            "both follow the path, across the phases"
        )
        moved = now.length_mm - last.length_mm
        if isinstance(action, int) and not late and state is State.RUNNING:
            assert 0.0 < moved <= 1.5 + 1e-9, "also when the clock jumps"
        else:
            assert moved == 0.0
        assert now.time_left_s + machine.tick * 0.1 == pytest.approx(sum(durations), abs=0.051)
        assert machine.state is not State.DONE or now.time_left_s == 0.0


def test_a_finished_weld_is_over():
    machine = PhaseMachine(
        [
            Phase.model_construct(name="dwell", duration_s=1.0),
            Phase.model_construct(name="start", duration_s=1.0, to_deg=5.0, length_mm=7.0),
        ]
    )
    machine.follow(99)
    assert machine.state is State.DONE
    assert (machine.progress().phase, machine.progress().angle_deg) == ("start", 5.0)
    assert machine.describe().data == {"state": "done", "phase": "start", "angle_deg": 5.0}
    assert machine.progress().length_mm == 7.0 and machine.progress().time_left_s == 0.0
    for ask in (machine.hold, machine.resume, machine.abort):
        answer = ask()
        assert (answer.ok, answer.fact.data["state"]) == (False, "done")


# ---------------------------------------------------------------- a phase that waits for a temperature


HEATED = {"plant": {"process": "canister"}}
WAITS = [{"name": "dwell", "duration_s": 5.0, "until_c": 810.0}, *WELD[1:]]


def follow(machine, ticks, temperature_c):
    """Whether the machine has jumped, by tick."""
    first = machine.tick + machine.held + 1
    return [machine.follow(number, temperature_c) for number in range(first, first + ticks)]


def test_phase_ends_after_a_second_at_its_temperature():
    scenario = parse(WAITS, **HEATED)
    machine = PhaseMachine(scenario.phases)
    assert not any(follow(machine, 10, 809.9))
    assert not any(follow(machine, 9, 810.0))
    assert not any(follow(machine, 1, 809.0))  # the dwell starts again
    assert follow(machine, 12, 811.0) == [False] * 9 + [True, False, False]
    assert (machine.tick, machine.held) == (52, -20)
    assert machine.progress().phase == "start"
    assert not any(follow(machine, 20, 811.0))  # no other phase waits
    assert machine.progress().time_left_s == pytest.approx(scenario.duration_s - 7.2)


@pytest.mark.parametrize("shown_c", [700.0, float("nan")])
def test_phase_without_its_temperature_ends_at_its_time_limit(shown_c):
    machine = PhaseMachine(parse(WAITS, **HEATED).phases)
    assert not any(follow(machine, 60, shown_c))
    assert (machine.tick, machine.held) == (60, 0)
    assert machine.progress().phase == "start"


def test_a_held_weld_does_not_jump():
    machine = PhaseMachine(parse(WAITS, **HEATED).phases)
    follow(machine, 3, 700.0)
    machine.hold()
    assert not any(follow(machine, 30, 900.0))
    machine.resume()
    assert follow(machine, 10, 900.0)[-1]


@pytest.mark.parametrize(
    ("phases", "others", "words"),
    [
        (WAITS, {}, r"phases .*until_c, .* plant"),
        (changed(1, until_c=810.0), HEATED, r"phases\[1\] .*until_c; .* dwell"),
        (changed(0, until_c=20.0), HEATED, r"phases\[0\]\.until_c = 20 .* 750 to 950"),
        (WELD, {"path": [{"at_s": 0.0, "arc_mm": 3.0}]}, "path is not"),
    ],
)
def test_impossible_wait_or_path_is_refused_in_one_line(phases, others, words):
    with pytest.raises(InputError, match=words):
        parse(phases, **others)


def test_the_tool_goes_from_the_lid_down_to_the_joint_line_and_up_again():
    path = scenario_file.load("canister_weld_heat").path
    assert path[0].axial_mm == path[2].axial_mm == pytest.approx(74.3, abs=0.1)
    assert {point.axial_mm for point in path[3:6]} == {0.0}
    assert path[-1].axial_mm == pytest.approx(74.8, abs=0.1)
    assert path[4].arc_mm - path[3].arc_mm == pytest.approx(pi * 1050.0, abs=1e-3)


def test_the_plant_reads_the_path_from_the_scenarios_text_and_the_text_can_be_read_again():
    scenario = scenario_file.load("canister_weld_heat")
    assert PlantSchedule.from_yaml(scenario.text).path == scenario.path
    assert scenario_file.parse(scenario.text).path == scenario.path
    assert PlantSchedule.from_yaml(scenario_file.load("canister_weld").text).path == ()


def test_programme_has_the_ticks_of_its_scenario():
    """A duration that rounds to a tick more than the phases is accepted; the weld ends with it."""
    scenario = parse([{"name": "dwell", "duration_s": 1.0}], duration_s=1.09)
    machine = PhaseMachine(scenario.phases, scenario.n_ticks)
    for number in range(1, 12):
        assert machine.state is State.RUNNING
        machine.follow(number)
    assert (machine.tick, machine.state) == (11, State.DONE)
