"""Drives, sensors, disturbances, faults, watchdog, command checks and stamps, each alone."""

from itertools import pairwise
from math import exp, inf, isnan, nan, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control import Command, Limits
from fsw_control.command_gate import REASONS, CommandGate
from fsw_control.parameters import defaults
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_model.equations import numbers_of
from fsw_model.functions import WRITER
from fsw_plant import PlantConfig, PlantEmulator, kernel_codegen
from fsw_plant.emulator import Watchdog, WatchdogState
from fsw_plant.events import Disturbance, Fault, Sample
from fsw_plant.library import KERNEL, Draws, model_of, sensors_of
from fsw_plant.pace import JUMP_NS, NUDGE_NS, Lockstep, TickStamps
from fsw_plant.parameters import PlantParameters
from fsw_plant.reports_ros import truth_message

TICK_NS = 100_000_000
DEFAULTS = PlantConfig.from_values({})


@pytest.mark.skipif(
    WRITER not in kernel_codegen.PATH.read_text(encoding="utf-8"),
    reason="another version of CasADi writes the same equations in another way",
)
def test_equations_in_c_are_those_of_the_model():
    assert kernel_codegen.PATH.read_text(encoding="utf-8") == kernel_codegen.generate()


def test_library_takes_all_numbers_of_a_model():
    assert len(model_of(DEFAULTS.model).numbers) == len(numbers_of(DEFAULTS.model))


class Actuator:
    """A drive of the library."""

    def __init__(self, position, largest_step, lag_s, dead_time_ticks=0):
        self.drive = KERNEL.new("fsw_plant_drive", position=position, setpoint=position)
        self.configure(largest_step, lag_s, dead_time_ticks)

    def configure(self, largest_step, lag_s, dead_time_ticks=0):
        KERNEL.lib.fsw_plant_drive_configure(self.drive, largest_step, lag_s, dead_time_ticks)

    def advance(self, target):
        return KERNEL.lib.fsw_plant_drive_advance(self.drive, target)

    position = property(lambda self: self.drive.position)
    setpoint = property(lambda self: self.drive.setpoint)


class Probe:
    """A probe of the library, in a plant whose process has a temperature."""

    def __init__(self, lag_s, start_c):
        self.plant = KERNEL.new("fsw_plant")
        self.probe = self.plant.probe
        self.probe.value_c = self.probe.process_c = self.probe.around_c = start_c
        KERNEL.lib.fsw_plant_probe_configure(KERNEL.ffi.addressof(self.probe), lag_s)
        self.plant.outputs.temperature_c = start_c

    def read(self, around_c):
        added = KERNEL.new("fsw_plant_disturbance")
        added.temperature_c = around_c - self.plant.outputs.temperature_c
        shown = KERNEL.ffi.new("double[3]")
        KERNEL.lib.fsw_plant_show(self.plant, added, shown)
        return shown[2]

    def advance(self, process_c):
        self.plant.outputs.temperature_c = process_c
        KERNEL.lib.fsw_plant_probe_advance(KERNEL.ffi.addressof(self.probe), process_c)


class Sensor:
    """A sensor of the library, with its stream of random numbers."""

    def __init__(self, seed, index, *noise):
        self.sensor, self.draws, self.index, self.drawn = (
            KERNEL.new("fsw_plant_sensor"),
            Draws(seed),
            index,
            [],
        )
        self.configure(*noise)

    def configure(self, deviation=0.0, resolution=0.0, correlation_s=0.0):
        KERNEL.lib.fsw_plant_sensor_configure(self.sensor, deviation, resolution, correlation_s)

    def read(self, value):
        self.drawn = self.drawn or self.draws.block()[::-1, self.index].tolist()
        return KERNEL.lib.fsw_plant_sensor_read(self.sensor, self.drawn.pop(), value)


def test_actuator_rate_and_lag():
    drive = Actuator(78.4, largest_step=1.0, lag_s=0.02)
    drive.advance(95.0)
    assert drive.setpoint == pytest.approx(79.4)
    assert drive.position == pytest.approx(79.4 - exp(-5.0))
    before = drive.position
    mean = drive.advance(78.9)
    assert drive.setpoint == 78.9
    # mean of an exponential approach, by fine summation
    fine = [78.9 + (before - 78.9) * exp(-(i + 0.5) * 0.1 / 1e4 / 0.02) for i in range(10_000)]
    assert mean == pytest.approx(sum(fine) / len(fine), rel=1e-9)
    for _ in range(30):
        drive.advance(60.0)
    assert drive.position == pytest.approx(60.0, abs=1e-9)


def test_actuator_without_lag():
    drive = Actuator(400.0, largest_step=3.0, lag_s=0.0)
    assert drive.advance(402.0) == 402.0 == drive.position
    assert drive.advance(399.5) == 399.5 == drive.position
    assert drive.advance(500.0) == pytest.approx(402.5)


def test_sensors_have_streams_of_their_own():
    streams = [
        [sensor.read(0.0) for _ in range(50)] for sensor in (Sensor(1, i, 1.0) for i in range(3))
    ]
    assert len({tuple(stream) for stream in streams}) == 3
    assert Sensor(1, 0, 1.0, 0.5).read(3.0) * 2 % 1 == 0
    assert Sensor(1, 0).read(3.3) == 3.3


@pytest.mark.parametrize("correlation_s", [0.0, 0.2, 1.0, 3.0])
def test_noise_decays_with_its_correlation_time(correlation_s):
    """Autocorrelation exp(-t / correlation time), at the standard deviation of the white noise."""
    sensor = Sensor(3, 1, 2.0, 0.0, correlation_s)
    noise = np.array([sensor.read(0.0) for _ in range(120_000)])
    assert noise.std() == pytest.approx(2.0, rel=0.05)
    assert abs(noise.mean()) < 0.15
    for ticks in (1, 5, 20):
        correlation = np.mean(noise[ticks:] * noise[:-ticks]) / np.mean(noise**2)
        assert correlation == pytest.approx(
            exp(-0.1 * ticks / correlation_s) if correlation_s else 0.0, abs=0.06
        )


def test_correlated_noise_is_stationary_from_the_first_sample():
    sensors = [Sensor(seed, 0, 1.0, 0.0, 5.0) for seed in range(2000)]
    first, second, *_, last = ([sensor.read(0.0) for sensor in sensors] for _ in range(5))
    assert [np.std(noise) for noise in (first, second, last)] == pytest.approx([1.0] * 3, rel=0.06)
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(exp(-0.02), abs=0.01)


def test_correlated_noise_continues_from_its_value():
    sensor = Sensor(1, 0, 1.0)
    before = [sensor.read(0.0) for _ in range(3)][-1]
    sensor.configure(1.0, 0.0, 600.0)
    assert sensor.read(0.0) == pytest.approx(before, abs=0.1)


def test_probe_follows_steps_and_ramps_exactly():
    step, ramp, at_once = Probe(3.0, 800.0), Probe(3.0, 800.0), Probe(0.0, 800.0)
    for tick in range(1, 200):
        assert at_once.read(810.0) == 810.0
        for probe in (step, at_once):
            probe.read(810.0)  # a disturbance by 10
            probe.advance(800.0)
        ramp.advance(800.0 + 0.5 * tick)
        t, met_c = 0.1 * tick, 800.0 + 0.5 * tick
        assert step.read(810.0) == pytest.approx(800.0 + 10.0 * (1.0 - exp(-t / 3.0)), abs=1e-9)
        assert ramp.read(met_c) == pytest.approx(
            800.0 + 5.0 * (t - 3.0 * (1.0 - exp(-t / 3.0))), abs=1e-9
        )


@given(st.floats(0.0, 60.0), st.lists(st.floats(500.0, 1000.0), min_size=2, max_size=30))
def test_probe_stays_within_past_temperatures(lag_s, around):
    probe = Probe(lag_s, around[0])
    for value in around:
        probe.advance(value)
        assert min(around) - 1e-9 <= probe.read(value) <= max(around) + 1e-9


def disturbance(shape, amplitude, duration_s=0.0, period_s=0.0, at_s=1.0):
    return Disturbance("depth", shape, amplitude, duration_s, at_s, period_s)


@pytest.mark.parametrize(
    "disturbance, times, values",
    [
        (disturbance("step", 2.0), (0.9, 1.0, 99.0), (0.0, 2.0, 2.0)),
        (
            disturbance("step", 2.0, 0.5),
            (0.9, 1.0, 99.0),
            (0.0, 2.0, 2.0),
        ),  # a step has no duration
        (disturbance("ramp", 2.0, 4.0), (0.9, 1.0, 2.0, 5.0, 99.0), (0.0, 0.0, 0.5, 2.0, 2.0)),
        (disturbance("pulse", 2.0, 0.3), (0.9, 1.0, 1.2, 1.3, 99.0), (0.0, 2.0, 2.0, 0.0, 0.0)),
        (
            disturbance("sine", 2.0, 0.0, 4.0),
            (0.9, 1.0, 2.0, 4.0, 41.5),
            (0, 0, 2.0, -2.0, 2 * sin(pi / 4)),
        ),
        (disturbance("sine", 2.0, 1.5, 4.0), (2.0, 2.5), (2.0, 0.0)),
        (disturbance("none", 2.0), (0.0, 9.0), (0.0, 0.0)),
    ],
)
def test_shapes(disturbance, times, values):
    assert [disturbance.value(t) for t in times] == pytest.approx(values, abs=1e-9)


def test_random_disturbance_is_seeded_and_has_its_size():
    def values(seed):
        event = disturbance("random", 2.0, 0.0, 5.0)
        event.begin((seed, 0))
        return np.array([event.value(1.0 + tick / 10) for tick in range(200_000)])

    first = values(1)
    assert (first == values(1)).all() and (first != values(2)).mean() > 0.9
    assert first.mean() == pytest.approx(0.0, abs=0.15)
    assert first.std() == pytest.approx(2.0, rel=0.1)
    assert np.abs(np.diff(first)).max() < 2.0  # continuous: no jump within a tick


def passed(kind, magnitude=0.0, duration_s=0.0, ticks=8):
    """What a sensor sends at each tick with a fault from tick 3 on.

    Its healthy values are 100 + tick.
    """
    fault, sent, last = Fault("depth", kind, magnitude, duration_s, 0.3), [], None
    for tick in range(ticks):
        sample = Sample(tick, 100.0 + tick)
        works = tick < 3 or fault.over(tick / 10)
        sent.append(
            [tuple(s) for s in ([sample] if works else fault.pass_on(sample, tick / 10, last))]
        )
        last = sample.value
    return sent


@pytest.mark.parametrize(
    "fault, expected",
    [
        (("freeze", 0.0, 0.3), [[(3, 102)], [(4, 102)], [(5, 102)], [(6, 106)], [(7, 107)]]),
        (("dropout", 0.0, 0.2), [[], [], [(5, 105)], [(6, 106)], [(7, 107)]]),
        (("bias", 5.0, 0.2), [[(3, 108)], [(4, 109)], [(5, 105)], [(6, 106)], [(7, 107)]]),
        (("drift", 10.0, 0.3), [[(3, 103)], [(4, 105)], [(5, 107)], [(6, 106)], [(7, 107)]]),
        (("spike", 5.0, 0.0), [[(3, 108)], [(4, 104)], [(5, 105)], [(6, 106)], [(7, 107)]]),
        (
            ("duplicate", 0.0, 0.1),
            [[(3, 103)] * 2, [(4, 104)], [(5, 105)], [(6, 106)], [(7, 107)]],
        ),
        (("delay", 0.2, 0.4), [[], [], [(3, 103)], [(4, 104)], [(7, 107)]]),
    ],
)
def test_faults(fault, expected):
    sent = passed(*fault)
    assert [[(stamp, pytest.approx(value)) for stamp, value in tick] for tick in expected] == sent[
        3:
    ]


def test_nan_fault():
    assert all(isnan(tick[0][1]) for tick in passed("nan")[3:])


def test_dust_makes_noise_and_loses_half_of_the_samples():
    sent = passed("dust", 2.0, ticks=2003)[3:]
    noise = [tick[0][1] - 103.0 - k for k, tick in enumerate(sent) if tick]
    assert len(noise) == pytest.approx(1000, abs=80)
    assert np.std(noise) == pytest.approx(2.0, rel=0.1)
    assert sent == passed("dust", 2.0, ticks=2003)[3:]  # repeatable


def test_spikes_repeat_once_a_second():
    assert [
        tick[0][0] for tick in passed("spike", 50.0, 2.05, ticks=40) if tick[0][1] > 145.0
    ] == [3, 13, 23]


def test_freeze_at_the_very_first_sample():
    fault = Fault("torque", "freeze")
    assert fault.pass_on(Sample(1, 7.0), 0.1, None) == (Sample(1, 7.0),)
    assert fault.pass_on(Sample(2, 8.0), 0.2, 7.0) == (Sample(2, 7.0),)


def drive_watchdog(dog, force, ticks):
    history = []
    for _ in range(ticks):
        force = dog.advance(force)
        history.append((dog.state, force))
    return history


@pytest.mark.requirement("S10")
def test_watchdog_holds_then_ramps_to_the_safe_force():
    dog = Watchdog(DEFAULTS)
    dog.feed()
    history = drive_watchdog(dog, 78.4, 150)
    states = [state for state, _ in history]
    assert (
        states == [WatchdogState.OK] * 10 + [WatchdogState.HOLD] * 20 + [WatchdogState.SAFE] * 120
    )
    assert [force for _, force in history[:30]] == [78.4] * 30
    assert history[30][1] == pytest.approx(78.2)  # 2 kN/s
    assert history[40][1] == pytest.approx(76.2)
    assert history[-1][1] == 65.0
    dog.feed()
    assert drive_watchdog(dog, 65.0, 1) == [(WatchdogState.OK, 65.0)]


@pytest.mark.requirement("S10")
def test_watchdog_does_not_raise_a_low_force():
    dog = Watchdog(DEFAULTS)
    dog.feed()
    assert drive_watchdog(dog, 61.0, 100)[-1] == (WatchdogState.SAFE, 61.0)


@pytest.mark.requirement("S10")
def test_watchdog_before_the_first_command():
    assert drive_watchdog(Watchdog(DEFAULTS), 78.4, 100)[-1] == (WatchdogState.HOLD, 78.4)
    armed = PlantConfig.from_values({"watchdog.armed_at_start": True})
    assert drive_watchdog(Watchdog(armed), 78.4, 100)[-1] == (WatchdogState.SAFE, 65.0)


def gate_of(*sources):
    return CommandGate(Limits(), 0.5, sources)


GOOD = Command(78.4, 407.0)
NOW = 50 * TICK_NS


@pytest.mark.requirement("S4")
@pytest.mark.parametrize(
    "command, stamp, source, healthy, reason",
    [
        (Command(nan, 407.0), NOW, "decentral", True, "not_finite"),
        (Command(78.4, inf), NOW, "decentral", True, "not_finite"),
        (Command(59.9, 407.0), NOW, "decentral", True, "out_of_range"),
        (Command(95.1, 407.0), NOW, "decentral", True, "out_of_range"),
        (Command(78.4, 299.0), NOW, "decentral", True, "out_of_range"),
        (Command(78.4, 501.0), NOW, "decentral", True, "out_of_range"),
        (GOOD, NOW, "decentral", False, "unhealthy"),
        (GOOD, NOW, "intruder", True, "source"),
        (GOOD, NOW + 1, "decentral", True, "future"),
        (GOOD, 40 * TICK_NS, "decentral", True, "repeated"),
        (GOOD, 39 * TICK_NS, "decentral", True, "repeated"),
        (GOOD, 44 * TICK_NS, "decentral", True, "too_old"),
        (GOOD, 0, "decentral", True, "repeated"),
    ],
)
def test_bad_commands_are_refused_and_counted(command, stamp, source, healthy, reason):
    gate = gate_of("decentral", "manual")
    assert gate.check(GOOD, 40 * TICK_NS, "decentral", True, 40 * TICK_NS) == ""
    assert gate.check(command, stamp, source, healthy, NOW) == reason
    assert gate.refused == dict.fromkeys(REASONS, 0) | {reason: 1} and gate.total() == 1
    assert gate.last.code == reason
    assert gate.last_stamp_ns == 40 * TICK_NS
    assert gate.check(GOOD, NOW, "manual", True, NOW) == ""


def test_commands_before_the_first_measurement_and_old_ones_at_the_start():
    assert gate_of().check(GOOD, 0, "", True, None) == "future"
    assert gate_of().check(GOOD, 0, "", True, NOW) == "too_old"


def test_limits_survive_the_units_of_the_wire():
    limit_rad_s = 500.0 * (pi / 30.0)
    for speed in (limit_rad_s / (pi / 30.0), 500.0 * (1 + 2e-16), 500.0):
        plant = PlantEmulator()
        plant.measure()
        assert plant.apply(Command(95.0 * (1 + 2e-16), speed)) == ""
        assert plant.applied == Command(95.0, 500.0)


def test_stamps_are_one_tick_apart_whatever_the_jitter():
    stamps, now = TickStamps(), 1_700_000_000_000_000_000
    jitter = [0, 3_000_000, 0, 4_900_000, 200_000] * 20
    seen = [
        stamps.next(now + k * TICK_NS + late, k * TICK_NS + late) for k, late in enumerate(jitter)
    ]
    assert seen == [now + k * TICK_NS for k in range(100)]
    assert stamps.jumps == 0


def test_stamps_follow_the_wall_clock():
    stamps = TickStamps()
    stamps.next(0, 0)
    seen = [
        stamps.next(k * TICK_NS + 20_000_000, k * TICK_NS + 20_000_000) for k in range(1, 3000)
    ]
    assert all(TICK_NS <= b - a <= TICK_NS + NUDGE_NS for a, b in pairwise(seen))
    assert 2999 * TICK_NS + 20_000_000 - seen[-1] <= 5_010_000
    assert stamps.jumps == 0
    held_up_ns = 3000 * TICK_NS + JUMP_NS + 30_000_000
    assert stamps.next(held_up_ns, held_up_ns) == held_up_ns and stamps.jumps == 1
    set_ns = held_up_ns + 3600 * 10**9
    assert stamps.next(set_ns, held_up_ns + TICK_NS) == set_ns and stamps.jumps == 2


@given(
    st.lists(
        st.tuples(
            st.integers(0, 3 * TICK_NS), st.sampled_from([0, 0, 0, -9, 9, -36_000, 36_000, -4])
        ),
        max_size=60,
    )
)
def test_no_stamp_comes_twice_however_the_wall_clock_is_set(moves):
    stamps, wall_ns, steady_ns = TickStamps(), 10**18, 0
    seen = [stamps.next(wall_ns, steady_ns)]
    for elapsed_ns, set_by_ticks in moves:
        steady_ns += elapsed_ns
        wall_ns += elapsed_ns + set_by_ticks * TICK_NS
        seen.append(stamps.next(wall_ns, steady_ns))
    assert all(before < after for before, after in pairwise(seen))
    assert seen[-1] >= wall_ns - 2 * TICK_NS, (
        "set-points that are sent now must not lie in the future"
    )


def test_a_clock_that_is_set_back_again_and_again_does_not_repeat_stamps():
    stamps = TickStamps()
    seen = [stamps.next(10**18 + (k % 9) * TICK_NS, k * TICK_NS) for k in range(300)]
    assert seen == [10**18 + k * TICK_NS for k in range(300)]
    assert stamps.jumps == 33


def test_watchdog_of_a_plant_whose_steps_are_late_keeps_its_times():
    dog = Watchdog(DEFAULTS)
    dog.feed()
    times_s, forces_kn = {}, [78.4]
    for count in range(1, 200):
        forces_kn.append(dog.advance(forces_kn[-1], 0.35))
        times_s.setdefault(dog.state, count * 0.35)
    assert times_s[WatchdogState.HOLD] == pytest.approx(1.0, abs=0.46)
    assert times_s[WatchdogState.SAFE] == pytest.approx(3.0, abs=0.46)
    assert forces_kn.index(65.0) * 0.35 == pytest.approx(3.0 + 13.4 / 2.0, abs=0.71)


def test_watchdog_of_a_plant_that_was_suspended_does_not_ramp_at_once():
    dog = Watchdog(DEFAULTS)
    dog.feed()
    assert dog.advance(78.4, 60.0) == 78.4
    assert dog.state is not WatchdogState.SAFE
    assert dog.advance(78.4) == 78.4
    assert dog.state is WatchdogState.HOLD


@given(dead=st.integers(0, 10), targets=st.lists(st.floats(60.0, 95.0), min_size=1, max_size=30))
def test_dead_time_of_a_drive_is_the_same_motion_later(dead, targets):
    prompt, late = Actuator(78.4, 1.0, 0.02), Actuator(78.4, 1.0, 0.02, dead)
    expected = [78.4] * dead + [prompt.advance(target) for target in targets]
    assert [late.advance(target) for target in targets] == pytest.approx(
        expected[: len(targets)], abs=1e-12
    )


def test_dead_time_of_a_drive_may_change_on_the_way():
    drive = Actuator(70.0, 10.0, 0.0, 2)
    assert [drive.advance(target) for target in (71.0, 72.0, 73.0)] == [70.0, 70.0, 71.0]
    drive.configure(10.0, 0.0, 0)  # 72 is overtaken
    assert drive.advance(74.0) == 74.0
    drive.configure(10.0, 0.0, 1)
    assert [drive.advance(target) for target in (75.0, 76.0)] == [74.0, 75.0]


def test_lockstep_repeats_an_unanswered_tick_in_time_and_at_once_for_a_new_writer():
    pace = Lockstep()
    pace.begin(10.0)
    assert not pace.must_repeat(11.9, 2.0)
    assert (
        pace.must_repeat(12.0, 2.0)
        and not pace.must_repeat(13.9, 2.0)
        and pace.must_repeat(14.0, 2.0)
    )
    pace.on_new_writer()
    assert (
        pace.must_repeat(14.1, 2.0)
        and not pace.must_repeat(14.5, 2.0)
        and pace.must_repeat(14.6, 2.0)
    )
    pace.answered = True
    assert not pace.must_repeat(99.0, 2.0)
    pace.begin(100.0)
    assert not pace.must_repeat(100.6, 2.0), "the next tick reaches the new writer"


def test_a_plant_gives_up_later_than_a_standby_takes_over():
    values = defaults(PlantParameters)
    assert values["lockstep_give_up_s"] > 2.0 * 30.0 + values["lockstep_timeout_s"]


@pytest.mark.parametrize("oldest", [0, 5])
def test_history_of_another_dead_time(oldest):
    history = [float(i) for i in range(28)]

    def refitted(steps):
        plant = KERNEL.new("fsw_plant")
        plant.oldest = oldest
        for age, power_kw in enumerate(history):
            plant.power[(oldest + age) % len(history)][0] = power_kw
        KERNEL.lib.fsw_plant_refit(plant, len(history), steps)
        return [plant.power[(plant.oldest + age) % steps][0] for age in range(steps)]

    assert refitted(30) == [history[0]] * 2 + history
    assert refitted(27) == history[1:]


def test_truth_is_sent_in_si():
    changed = {"depth_mm": 2.0, "force_kn": 80.0, "speed_rpm": 60.0, "process_power_kw": 44.0}
    changed |= {"temperature_c": 820.0, "force_disturbance_kn": 0.3}
    sent = truth_message(PlantEmulator().truth()._replace(**changed, refused_commands=3))
    in_si = {"depth": 0.002, "axial_force": 8e4, "spindle_speed": 2.0 * pi, "process_power": 44e3}
    in_si |= {"temperature": 820.0, "force_disturbance": 300.0, "refused_commands": 3}
    assert {name: getattr(sent, name) for name in in_si} == pytest.approx(in_si)


def test_a_further_row_of_the_table_is_a_sensor_of_the_plant(monkeypatch):
    monkeypatch.setitem(SENSORS, "second", SENSORS["thermocouple"])
    assert sensors_of(PlantConfig.from_values({})) == (*REQUIRED, "second")
