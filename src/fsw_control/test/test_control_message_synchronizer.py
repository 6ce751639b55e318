"""Ticks from three sensor topics: whatever the order and the losses."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control import message_synchronizer
from fsw_control.contract import Command
from fsw_control.message_synchronizer import (
    DRIVES,
    JUMP_NS,
    RULES,
    MessageSynchronizer,
    StampFilter,
)
from fsw_control.sensors import REQUIRED

STEP_NS = 100_000_000


def join_without_commands(await_drives=False):
    return MessageSynchronizer(await_drives, await_commands=False)


def give_up(join):
    """What comes when the oldest tick is waited for no longer."""
    return [] if join.begun_s is None else join.expire(join.begun_s + 0.03, 0.03)


def add_all(join, k, now_s=0.0, sensors=REQUIRED):
    return [tick for sensor in sensors for tick in join.add(sensor, k * STEP_NS, float(k), now_s)]


def test_complete_tick_comes_at_once_with_its_values():
    join = MessageSynchronizer()
    assert join.add("depth", 0, 1.0, 0.0) == []
    assert join.begun_s == 0.0
    assert join.add("torque", 0, 2.0, 0.0) == []
    (tick,) = join.add("thermocouple", 0, 3.0, 0.0)
    assert tick.values == {"depth": 1.0, "torque": 2.0, "thermocouple": 3.0}
    assert join.begun_s is None and not join.missed


def test_next_tick_waits_for_the_command_of_the_last():
    join = MessageSynchronizer()
    assert len(add_all(join, 0)) == 1
    assert add_all(join, 1) == []
    (tick,) = join.add_command(0)
    assert tick.stamp_ns == STEP_NS
    join.add_command(STEP_NS)
    assert len(add_all(join, 2)) == 1


def test_an_older_command_does_not_complete_a_tick():
    join = MessageSynchronizer()
    add_all(join, 1)
    assert join.add_command(STEP_NS) == []
    add_all(join, 2)
    add_all(join, 3)
    assert join.lacking == {"command"}
    assert join.add_command(STEP_NS) == []
    assert join.lacking == {"command"}


def test_without_an_arbiter_commands_are_waited_for_only_three_times():
    join = MessageSynchronizer()
    add_all(join, 0)
    for k in range(1, 4):
        assert add_all(join, k) == []
        (tick,) = give_up(join)
        assert tick.stamp_ns == k * STEP_NS
        assert "command" in join.missed
    assert len(add_all(join, 4)) == 1


def test_a_sensor_is_given_up_when_it_has_sent_a_newer_sample():
    join = join_without_commands()
    add_all(join, 0)
    assert add_all(join, 1, sensors=("depth", "torque")) == []
    assert add_all(join, 2, sensors=("depth", "torque")) == []
    first, second = join.add("thermocouple", 2 * STEP_NS, 2.0, 0.0)
    assert first.stamp_ns == STEP_NS and set(first.values) == {"depth", "torque"}
    assert set(second.values) == set(REQUIRED)
    assert [join.counts[sensor]["missing"] for sensor in REQUIRED] == [0, 0, 1]


def test_a_tick_is_given_up_when_the_tick_after_the_next_begins():
    join = join_without_commands()
    assert join.add("depth", STEP_NS, 1.0, 0.0) == []
    assert join.add("torque", 2 * STEP_NS, 1.0, 0.0) == []
    (tick,) = join.add("depth", 3 * STEP_NS, 1.0, 0.0)
    assert tick.values == {"depth": 1.0}
    assert join.stamps.newest_ns == 3 * STEP_NS


def test_a_tick_is_given_up_at_its_deadline_and_the_next_has_its_own():
    join = join_without_commands()
    join.add("depth", STEP_NS, 1.0, 0.0)
    join.add("torque", 2 * STEP_NS, 1.0, 0.02)
    assert join.expire(0.029, 0.03) == []
    (tick,) = join.expire(0.030, 0.03)
    assert tick.stamp_ns == STEP_NS
    assert (join.begun_s, join.expire(0.049, 0.03)) == (0.02, [])
    (tick,) = join.expire(0.050, 0.03)
    assert tick.stamp_ns == 2 * STEP_NS
    assert join.expire(1.0, 0.03) == []


def test_after_a_hold_up_the_queues_are_read_before_a_tick_is_given_up():
    join = join_without_commands()
    join.add("depth", STEP_NS, 1.0, 0.0)
    assert join.expire(5.0, 0.03) == []
    assert join.expire(5.005, 0.03) == []
    (tick,) = join.expire(5.011, 0.03)
    assert tick.values == {"depth": 1.0}


@given(st.data())
def test_after_a_stall_no_sample_is_lost_however_neighbouring_ticks_are_mixed(data):
    """Each topic in its own order, none more than one tick ahead of another, as an executor reads its queues."""
    join = join_without_commands()
    lost = data.draw(st.sets(st.tuples(st.integers(0, 9), st.sampled_from(REQUIRED)), max_size=4))
    queues = {sensor: [k for k in range(10) if (k, sensor) not in lost] for sensor in REQUIRED}
    ticks = []
    while any(queues.values()):
        slowest = min(queue[0] for queue in queues.values() if queue)
        sensor = data.draw(
            st.sampled_from(
                [name for name in REQUIRED if queues[name] and queues[name][0] <= slowest + 1]
            )
        )
        ticks += join.add(sensor, queues[sensor][0] * STEP_NS, float(queues[sensor].pop(0)), 0.0)
    while rest := give_up(join):
        ticks += rest
    expected = {k: {s: float(k) for s in REQUIRED if (k, s) not in lost} for k in range(10)}
    assert {tick.stamp_ns // STEP_NS: tick.values for tick in ticks} == {
        k: v for k, v in expected.items() if v
    }
    assert [tick.stamp_ns for tick in ticks] == sorted(tick.stamp_ns for tick in ticks)
    assert sum(counts["missing"] for counts in join.counts.values()) + 3 * (
        10 - len(ticks)
    ) == len(lost)


def test_late_and_duplicate_samples_are_counted_and_dropped():
    join = join_without_commands()
    add_all(join, 5)
    assert join.add("depth", 5 * STEP_NS, 9.0, 0.0) == []
    assert join.counts["depth"]["duplicate"] == 1
    assert join.add("depth", 4 * STEP_NS, 9.0, 0.0) == []
    assert join.counts["depth"]["late"] == 1
    join.add("torque", 6 * STEP_NS, 1.0, 0.0)
    join.add("torque", 6 * STEP_NS, 2.0, 0.0)
    assert join.counts["torque"]["duplicate"] == 1
    (tick,) = give_up(join)
    assert tick.values == {"torque": 1.0}
    join.add("depth", 6 * STEP_NS, 3.0, 0.0)
    assert join.counts["depth"]["late"] == 2


@pytest.mark.requirement("S15")
@pytest.mark.parametrize("offset", [-50, 1000])
def test_one_sensor_with_a_strange_clock_does_not_disturb_the_others(offset):
    join = join_without_commands()
    ticks = []
    for k in range(100, 110):
        ticks += add_all(join, k, now_s=k * 0.1, sensors=("depth", "torque"))
        ticks += join.add("thermocouple", (k + offset) * STEP_NS, 0.0, k * 0.1)
        ticks += give_up(join)
    assert [tick.stamp_ns // STEP_NS for tick in ticks] == list(range(100, 110))
    assert not any(tick.restarted for tick in ticks)


@pytest.mark.parametrize("start", [0, 10_000])
def test_a_jump_of_time_that_two_sensors_confirm_restarts(start):
    join = join_without_commands()
    add_all(join, 100)
    ticks = [tick for k in range(start, start + 3) for tick in add_all(join, k)]
    assert [tick.stamp_ns // STEP_NS for tick in ticks] == list(range(start, start + 3))
    assert [tick.restarted for tick in ticks] == [True, False, False]
    assert set(ticks[0].values) == set(REQUIRED)
    assert join.stamps.jumps == 1


def test_a_jump_is_believed_alone_when_all_else_is_silent():
    join = join_without_commands()
    add_all(join, 100, now_s=0.0)
    assert join.add("depth", 900 * STEP_NS, 1.0, 0.2) == []
    assert join.add("depth", 901 * STEP_NS, 1.0, 0.3) == []
    (tick,) = give_up(join)
    assert tick.stamp_ns == 901 * STEP_NS and tick.restarted


@given(
    st.lists(
        st.one_of(
            st.tuples(st.sampled_from(REQUIRED), st.integers(0, 60), st.floats(0, 5)),
            st.tuples(st.just("command"), st.integers(0, 60), st.just(0.0)),
            st.just(("give up", 0, 0.0)),
        ),
        max_size=200,
    )
)
def test_ticks_are_never_empty_and_in_order_between_restarts(events):
    join = MessageSynchronizer()
    last, now_s, accepted = None, 0.0, 0
    for kind, k, elapsed_s in events:
        now_s += elapsed_s
        if kind == "give up":
            ticks = give_up(join)
        elif kind == "command":
            ticks = join.add_command(k * STEP_NS)
        else:
            ticks = join.add(kind, k * STEP_NS, 1.0, now_s)
        for tick in ticks:
            assert tick.values and set(tick.values) <= set(REQUIRED)
            assert last is None or tick.restarted or tick.stamp_ns > last
            last = tick.stamp_ns
            accepted += len(tick.values)
    assert accepted <= len(events)


@pytest.mark.requirement("S5")
@given(st.data())
def test_any_order_within_a_tick_gives_every_tick_complete(data):
    join = join_without_commands()
    ticks = []
    for k in range(10):
        for sensor in data.draw(st.permutations(REQUIRED)):
            ticks += join.add(sensor, k * STEP_NS, float(k), 0.0)
    assert [tick.stamp_ns for tick in ticks] == [k * STEP_NS for k in range(10)]
    assert all(set(tick.values) == set(REQUIRED) for tick in ticks)


ACTING = Command(78.4, 407.576)


def test_the_drives_sample_rides_along_and_is_never_waited_for():
    join = join_without_commands()
    assert join.add_drives(STEP_NS, ACTING) == [] and join.begun_s is None, "it begins no tick"
    ticks = add_all(join, 1) + add_all(join, 2)
    assert [tick.drives for tick in ticks] == [ACTING, None]
    assert join.add_drives(2 * STEP_NS, ACTING) == []
    assert [tick.drives for tick in add_all(join, 3)] == [None], "what comes late is of no tick"


def test_lockstep_tick_waits_for_the_drives():
    join = join_without_commands(await_drives=True)
    assert add_all(join, 1) == [] and join.lacking == {"drives"}
    assert [tick.drives for tick in join.add_drives(STEP_NS, ACTING)] == [ACTING]
    assert add_all(join, 2) == []
    assert [tick.drives for tick in give_up(join)] == [None] and join.missed == {"drives"}
    assert [tick.stamp_ns for tick in add_all(join, 3)] == [3 * STEP_NS], (
        "what is lost is not waited for again"
    )
    join.add_drives(4 * STEP_NS, ACTING)
    assert [tick.drives for tick in add_all(join, 4)] == [ACTING]
    assert add_all(join, 5) == [], "it is back"


def test_a_newer_drives_sample_ends_the_wait_for_an_older_one():
    join = join_without_commands(await_drives=True)
    assert add_all(join, 1) == []
    assert add_all(join, 2) == []
    assert [tick.drives for tick in join.add_drives(2 * STEP_NS, ACTING)] == [None, ACTING]


def test_drives_without_sensors_do_not_fill_the_memory():
    join = MessageSynchronizer()
    for k in range(1000):
        join.add_drives(k * STEP_NS, ACTING)
    assert len(join._optional[DRIVES]) < 20


def test_a_far_stamp_is_believed_when_confirmed_or_when_all_else_is_silent():
    second = 10**9
    stamps = StampFilter()
    assert stamps.offer("depth", 10 * second, 1.0, 0.0) == ({"depth": 1.0}, False)
    assert stamps.offer("torque", 10 * second, 2.0, 0.0) == ({"torque": 2.0}, False)
    assert stamps.offer("depth", 99 * second, 1.5, 0.1) is None
    assert stamps.offer("torque", 99 * second, 2.5, 0.1) == ({"depth": 1.5, "torque": 2.5}, True)
    assert stamps.offer("depth", 5 * second, 3.0, 0.2) is None
    assert stamps.offer("depth", 5 * second + 1, 3.5, 0.4) == ({"depth": 3.5}, True), (
        "nothing else came for long enough"
    )
    assert (stamps.newest_ns, stamps.jumps) == (5 * second + 1, 2)


def test_gap_of_one_second_is_not_a_time_jump():
    stamps = StampFilter(lockstep=True)
    stamps.offer("depth", 0, 1.0, 0.0)
    assert not stamps.offer("depth", JUMP_NS, 2.0, 0.1).jumped
    assert stamps.offer("depth", 2 * JUMP_NS + 1, 3.0, 0.2) is None


def test_the_rest_of_a_tick_does_not_make_a_far_stamp_forgotten():
    stamps = StampFilter(lockstep=True)
    stamps.offer("depth", 0, 1.0, 0.0)
    assert stamps.offer("torque", 5 * JUMP_NS, 2.0, 0.0) is None
    assert not stamps.offer("thermocouple", 0, 3.0, 0.0).jumped
    assert stamps.offer("depth", 5 * JUMP_NS, 4.0, 0.0) == ({"torque": 2.0, "depth": 4.0}, True)


def test_strange_stamps_are_counted_and_their_values_kept_for_the_jump():
    join = join_without_commands()
    add_all(join, 1)
    join.add("depth", 2 * STEP_NS, 2.0, 0.1)
    far = 10_000 * STEP_NS
    assert join.add("depth", far, 7.0, 0.2) == []
    assert [tick.stamp_ns for tick in join.add("torque", far, 8.0, 0.2)] == [2 * STEP_NS], (
        "what was begun is given up"
    )
    (tick,) = join.add("thermocouple", far, 9.0, 0.2)
    assert tick.values == {"depth": 7.0, "torque": 8.0, "thermocouple": 9.0}
    assert tick.restarted and not add_all(join, 10_001)[0].restarted
    assert [join.counts[sensor]["late"] for sensor in REQUIRED] == [1, 1, 0]
    assert [join.counts[sensor]["missing"] for sensor in REQUIRED] == [0, 1, 1]
    for count in (2, 3):
        join.add("depth", count, 1.0, 0.2)
        assert join.counts["depth"]["late"] == count


@pytest.fixture
def with_lvdt(monkeypatch):
    monkeypatch.setattr(message_synchronizer, "OPTIONAL", ("lvdt",))


@pytest.mark.usefixtures("with_lvdt")
def test_an_optional_sensor_neither_begins_nor_delays_a_tick():
    join = MessageSynchronizer()
    assert join.add("lvdt", STEP_NS, 2.7, 0.0) == [] and join.begun_s is None
    (tick,) = add_all(join, 1)
    assert tick.values["lvdt"] == 2.7
    join.add_command(STEP_NS)
    (tick,) = add_all(join, 2)
    assert "lvdt" not in tick.values and not join.missed


@pytest.mark.usefixtures("with_lvdt")
def test_lockstep_tick_waits_for_optional_sensors_of_the_previous_tick():
    join = MessageSynchronizer(await_drives=True)
    join.add_drives(STEP_NS, ACTING)
    assert len(add_all(join, 1)) == 1, "it has never come"
    for k in (2, 3):
        join.add_command((k - 1) * STEP_NS)
        join.add_drives(k * STEP_NS, ACTING)
        join.add("lvdt", k * STEP_NS, 2.7, 0.0)
        assert len(add_all(join, k)) == 1
    join.add_command(3 * STEP_NS)
    join.add_drives(4 * STEP_NS, ACTING)
    assert add_all(join, 4) == [] and join.lacking == {"lvdt"}
    (tick,) = join.add("lvdt", 4 * STEP_NS, 2.8, 0.0)
    assert tick.values["lvdt"] == 2.8


def test_drives_that_come_late_are_waited_for_again():
    join = join_without_commands(await_drives=True)
    add_all(join, 1)
    give_up(join)
    join.add_drives(STEP_NS, ACTING)
    assert add_all(join, 2) == [] and join.lacking == {"drives"}


def test_a_tick_is_put_off_once_only():
    join = join_without_commands()
    join.add("depth", STEP_NS, 1.0, 0.0)
    assert join.expire(0.0299, 0.03) == []
    assert join.expire(0.1, 0.03) == [] and join.begun_s == pytest.approx(0.08)
    assert len(join.expire(9.0, 0.03)) == 1


def test_after_a_command_three_ticks_wait_again():
    join = MessageSynchronizer()
    add_all(join, 1)
    join.add_command(STEP_NS)
    for k in range(2, 6):
        assert bool(add_all(join, k)) == (k == 2), k
        give_up(join)
    assert add_all(join, 6), "nobody commands"


def test_sample_older_than_two_waiting_ticks_is_late():
    join = join_without_commands()
    for k in (3, 4, 4, 4, 2, 1):
        assert join.add("depth", k * STEP_NS, 1.0, 0.0) == []
    assert (join.counts["depth"]["duplicate"], join.counts["depth"]["late"]) == (2, 2)


# ---------------------------------------------------------------- steps of the clock


def feed(stamps_ns):
    """Offer a sample of each sensor every 0.1 s.

    The stamps that began a tick, with the time on the steady clock.
    """
    stamps, begun = StampFilter(), []
    for count, stamp_ns in enumerate(stamps_ns):
        for sensor in REQUIRED:
            newest_ns, now_s = stamps.newest_ns, count * 0.1
            accepted = stamps.offer(sensor, stamp_ns, 1.0, now_s)
            if accepted is not None and (
                accepted.jumped or newest_ns is None or stamp_ns > newest_ns
            ):
                begun.append((stamp_ns, now_s))
    return begun


@pytest.mark.requirement("S5")
@pytest.mark.parametrize("back_ticks", [2, 3, 5, 9, 10, 11, 30])
def test_a_clock_that_goes_back_again_and_again_stops_nothing(back_ticks):
    """Whether or not the same stamps come again."""
    for shift_ns in (0, 1234):
        stamps_ns = [
            10**18 + (k % back_ticks) * STEP_NS + (k // back_ticks) * shift_ns for k in range(300)
        ]
        times_s = [now_s for _, now_s in feed(stamps_ns)]
        assert max(after - before for before, after in pairwise(times_s)) < 1.0
        assert len(times_s) >= (50 if back_ticks < 5 else 150)


def test_late_samples_of_a_tick_before_a_step_of_the_clock_do_not_begin_it_again():
    """Two sources agree on the old stamp, but it has begun a tick already."""
    for step in (50, -50, 5, -5):
        stamps = StampFilter()
        stamps.offer("depth", 1000 * STEP_NS, 1.0, 0.0)
        for sensor in ("depth", "drives"):
            stamps.offer(sensor, (1000 + step) * STEP_NS, 1.0, 0.1)
        for now_s in (0.1, 0.2, 0.45):
            for sensor in ("torque", "thermocouple"):
                accepted = stamps.offer(sensor, 1000 * STEP_NS, 1.0, now_s)
                assert accepted is None or not accepted.jumped
                assert accepted is None or stamps.newest_ns >= 1000 * STEP_NS


@st.composite
def disturbed_streams(draw):
    """Samples as (arrival, source, stamp).

    The clock steps, samples are late or come twice, topics keep their order.
    """
    clock_ns, samples = 10**15, []
    ready_s = dict.fromkeys((*REQUIRED, "drives"), 0.0)
    for count in range(draw(st.integers(20, 60))):
        step = draw(st.sampled_from([0] * 8 + [-1, -3, -9, 9, -11, 40, -40, "odd"]))
        clock_ns += draw(st.integers(-(10**9), 10**9)) if step == "odd" else step * STEP_NS
        clock_ns += STEP_NS
        for source in ready_s:
            late_s = draw(st.sampled_from([0.0] * 6 + [0.05, 0.12, 0.35]))
            ready_s[source] = max(ready_s[source], count * 0.1 + late_s)
            samples.append((ready_s[source], source, clock_ns))
            if draw(st.integers(0, 9)) == 0:
                samples.append(
                    (ready_s[source] + draw(st.sampled_from([0.0, 0.1, 0.3])), source, clock_ns)
                )
    return sorted(samples, key=lambda sample: sample[0])


@pytest.mark.requirement("S5")
@settings(max_examples=300)
@given(disturbed_streams())
def test_no_stamp_begins_two_ticks_and_time_never_stands_still(samples):
    stamps, begun, advanced_s = StampFilter(), {}, 0.0
    for now_s, source, stamp_ns in samples:
        newest_ns = stamps.newest_ns
        accepted = stamps.offer(source, stamp_ns, 1.0, now_s)
        if accepted is not None and (accepted.jumped or newest_ns is None or stamp_ns > newest_ns):
            if stamp_ns in begun:
                before_s, before = begun[stamp_ns]
                assert now_s - before_s >= RULES.late_s and stamps.jumps > before, (
                    "the clock has repeated it"
                )
            begun[stamp_ns] = (now_s, stamps.jumps)
            assert stamp_ns == stamps.newest_ns
            advanced_s = now_s
        assert now_s - advanced_s < 1.0


def test_a_tick_is_repeated_when_all_its_sensors_have_sent_it_again():
    join = join_without_commands()
    add_all(join, 1)
    assert not join.take_repeated()
    for _ in range(2):
        add_all(join, 1, sensors=("depth", "torque"))
        assert not join.take_repeated()
        add_all(join, 1, sensors=("thermocouple",))
        assert join.take_repeated() and not join.take_repeated()
    add_all(join, 1, sensors=("depth",))
    add_all(join, 2)
    add_all(join, 2, sensors=("torque", "thermocouple"))
    assert not join.take_repeated(), "the first came again for the tick before"


@pytest.mark.parametrize("held_up_s", [0.1, 0.3, 0.7])
def test_a_sensor_that_lags_behind_does_not_set_time_back_while_the_plant_is_held_up(held_up_s):
    stamps, now_s = StampFilter(), 0.0
    for k in range(1, 30):
        now_s += held_up_s if k % 5 == 0 else 0.1
        for sensor, stamp_ns in (
            ("thermocouple", (k - 7) * STEP_NS),
            ("depth", k * STEP_NS),
            ("torque", k * STEP_NS),
        ):
            accepted = stamps.offer(sensor, stamp_ns, 1.0, now_s)
            assert accepted is None or not accepted.jumped
        assert stamps.newest_ns == k * STEP_NS


def test_lagging_sensor_does_not_set_lockstep_time_back():
    """However long the plant waits for each tick.

    The late sample may come before the newer ones.
    """
    stamps = StampFilter(lockstep=True)
    for k in range(1, 30):
        now_s = 2.5 * k
        late = stamps.offer("thermocouple", max(k - 3, 1) * STEP_NS, 1.0, now_s)
        assert late is not None and not late.jumped
        assert stamps.offer("depth", k * STEP_NS, 1.0, now_s) == ({"depth": 1.0}, False)
        assert stamps.newest_ns == k * STEP_NS
    assert stamps.jumps == 0
