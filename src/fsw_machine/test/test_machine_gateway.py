"""What the gateway publishes and which commands it passes on."""

from dataclasses import replace
from math import isnan, nan

import numpy as np
import pytest

from fsw_control import Command
from fsw_control.command_gate import Flaw
from fsw_control.depth_channels import ChannelHealth
from fsw_control.fence import UNKNOWN, Signature
from fsw_control.sensors import DEPTH_CHANNELS, SENSORS
from fsw_control.stop import Stop, StopCause
from fsw_control.units import NANOSECONDS
from fsw_machine.gateway import PAUSE_S, Gateway
from fsw_machine.machine_file import MachineFile
from fsw_machine.samples import RawValue

STEADY = Command(78.4, 407.5)


class Machine:
    """Reads cycle after cycle into a gateway, as a machine does that obeys it."""

    def __init__(self, machine, parameters, read_of):
        self.gateway = Gateway(machine, parameters)
        self.gateway.on_connected()
        self.read_of = read_of
        self.counter = 100
        self.stamp_ns = None
        self.in_force = STEADY

    @property
    def now_s(self):
        return self.counter * 0.1

    def cycle(self, steps=1, **changed):
        self.counter += steps
        values = {
            "force_in_force": self.in_force.force_kn,
            "speed_in_force": self.in_force.speed_rpm,
        } | changed
        out = self.gateway.on_read(self.read_of(self.counter, steps=steps, **values))
        self.stamp_ns = out.stamp_ns if out else self.stamp_ns
        return out

    def command(self, force_kn=STEADY.force_kn, speed_rpm=STEADY.speed_rpm, after_s=0.02, **given):
        stamp_ns, healthy = given.get("stamp_ns", self.stamp_ns), given.get("healthy", True)
        at_s, source = self.now_s + after_s, given.get("source", "nmpc")
        signature = given.get("signature", Signature(stop=self.gateway.fence.register.value))
        return self.gateway.on_command(
            Command(force_kn, speed_rpm), stamp_ns, source, healthy, at_s, signature
        )

    def obey(self, order):
        assert order is not None, self.refused
        waiting = self.gateway.on_written(order, "", self.now_s)
        self.in_force = order.command
        return waiting

    def pause(self, **changed):
        """Cycles until something is published again; how many were withheld."""
        for count in range(100):
            if self.cycle(**changed) is not None:
                return count
        raise AssertionError("nothing is published any more")

    @property
    def refused(self):
        return {reason for reason, count in self.gateway.gate.refused.items() if count}


@pytest.fixture
def running(machine, parameters, read_of):
    made = Machine(machine, parameters, read_of)
    made.cycle()
    return made


def test_a_tick_has_the_values_and_the_counters_timestamp(running):
    out = running.cycle()
    assert (
        out.values == {"depth": 2.66, "torque": 980.0, "thermocouple": 816.4}
        and out.drives == STEADY
    )
    assert out.stamp_ns == running.gateway.read.source_ns


def test_with_stamps_of_receipt_the_first_tick_has_the_local_time(machine, parameters, read_of):
    gateway = Gateway(machine, parameters | {"clock.stamps": "received"})
    gateway.on_connected()
    local_ns = 1_800_000_000 * NANOSECONDS
    first, second = (
        replace(read_of(counter), read_ns=local_ns + counter) for counter in (100, 101)
    )
    assert gateway.on_read(first).stamp_ns == local_ns + 100
    assert gateway.on_read(second).stamp_ns == local_ns + 100 + second.source_ns - first.source_ns


def test_stamps_advance_by_a_cycle_when_the_machine_clock_is_set(running):
    before_ns = running.stamp_ns
    assert running.cycle(source_ns=before_ns + 10**12).stamp_ns == before_ns + NANOSECONDS // 10
    assert running.gateway.stamps.steps == 1


def test_late_cycle_is_not_a_clock_step(running):
    late = running.read_of(
        running.counter + 1, at_s=running.now_s + 0.7, source_ns=running.stamp_ns + 700_000_000
    )
    assert running.gateway.on_read(late).stamp_ns == late.source_ns
    assert running.gateway.stamps.steps == 0


def test_an_invalid_value_is_nan_and_the_others_stay(running):
    bad = RawValue(
        0.0, status=0x80000000, status_name="Bad", source_ns=running.gateway.read.source_ns
    )
    out = running.cycle(depth=bad, temperature="hot")
    assert (
        isnan(out.values["depth"])
        and isnan(out.values["thermocouple"])
        and out.values["torque"] == 980.0
    )
    assert running.gateway.invalid == 2
    running.cycle(torque=nan)
    assert running.gateway.invalid == 3


def test_the_heartbeat_is_the_cycle_that_the_command_answers(running):
    order = running.command(78.5, 408.0)
    assert (order.force, order.speed, order.heartbeat) == (78.5, 408.0, running.counter)


@pytest.mark.requirement("S13")
@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"force_kn": nan}, "not_finite"),
        ({"force_kn": 200.0}, "out_of_range"),
        ({"healthy": False}, "unhealthy"),
        ({"stamp_ns": 5}, "too_old"),
        ({"stamp_ns": 2**62}, "future"),
        ({"after_s": 0.3}, "stale_read"),
        ({"force_kn": 80.0}, "jump"),
        ({"speed_rpm": 411.0}, "jump"),
    ],
)
def test_refused(running, given, reason):
    assert running.command(**given) is None
    assert running.refused == {reason}
    assert len(running.gateway.gate.last.words) > 10, "it is told in words"


def test_only_commands_of_the_sources_that_are_allowed_are_written(machine, parameters, read_of):
    for sources, is_written in ([["nmpc"], True], [["decentral"], False]):
        made = Machine(machine, parameters | {"commands.sources": sources}, read_of)
        made.cycle()
        assert (made.command() is not None) == is_written
        assert made.refused == (set() if is_written else {"source"})


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({}, ""),
        ({"limits.force_max_kn": 78.0}, "out_of_range"),
        ({"limits.speed_min_rpm": 408.0}, "out_of_range"),
        ({"commands.sources": ["decentral"]}, "source"),
        ({"commands.max_age_s": 0.05}, "too_old"),
    ],
)
def test_a_parameter_that_is_changed_counts_at_once(running, parameters, changed, reason):
    before_ns = running.stamp_ns
    running.cycle()
    running.gateway.configure(parameters | changed)
    assert (running.command(stamp_ns=before_ns) is None) == bool(reason)
    assert running.refused == ({reason} if reason else set())


def test_only_one_command_per_cycle_and_only_one_under_way(running):
    order = running.command()
    assert running.command() is None and running.refused == {"repeated"}
    assert isnan(running.cycle().drives.force_kn)
    assert running.command() is None and "unanswered" not in running.refused
    waiting = running.obey(order)
    assert waiting.heartbeat == running.counter
    running.obey(waiting)
    assert running.cycle().drives == STEADY


def test_newer_of_two_pending_commands_is_written(running):
    order = running.command()
    for force_kn in (78.5, 78.6):
        running.cycle()
        assert running.command(force_kn) is None
    assert running.refused == {"unanswered"}
    assert running.gateway.gate.last.data["since_s"] == pytest.approx(0.2)
    assert running.obey(order).command.force_kn == 78.6


@pytest.mark.requirement("S25")
def test_a_command_that_waits_when_a_safe_stop_comes_is_not_written(running):
    order = running.command()
    running.cycle()
    assert running.command() is None and not running.refused
    running.gateway.fence.hear(Stop(1, True, StopCause.OPERATOR, "anna"))
    assert running.obey(order) is None
    assert running.refused == {"stopped"}


@pytest.mark.parametrize("reason", ["not_permissive", "jump", "stale_read"])
def test_pending_command_is_checked_again_before_its_write(running, reason):
    order = running.command()
    running.cycle()
    running.command(79.3 if reason == "jump" else 78.4)
    if reason == "not_permissive":
        running.cycle(permissive=False)
    elif reason == "jump":
        running.cycle(force_in_force=70.0)
    assert (
        running.gateway.on_written(
            order, "", running.now_s + (0.3 if reason == "stale_read" else 0.0)
        )
        is None
    )
    assert running.refused == {"unanswered" if reason == "not_permissive" else reason}
    last = running.gateway.gate.last
    assert reason != "jump" or last.data["jump"].code is Flaw.JUMP
    assert reason != "stale_read" or last.data["age_s"] == pytest.approx(0.3)


def test_a_stamp_between_two_ticks_is_refused(running):
    running.obey(running.command())
    running.cycle()
    assert running.command(stamp_ns=running.stamp_ns - 1) is None and running.refused == {
        "unknown_stamp"
    }


def test_before_it_is_connected_a_gateway_reports_nothing(machine, parameters):
    gateway = Gateway(machine, parameters)
    assert (gateway.connected, gateway.permissive, gateway.joined) == (False, False, False)
    assert (gateway.samples, gateway.read, gateway.last_failure) == ({}, None, "")


@pytest.mark.requirement("S13")
def test_nothing_before_the_first_read(machine, parameters, read_of):
    made = Machine(machine, parameters, read_of)
    assert made.command(stamp_ns=1) is None and made.refused == {"disconnected"}


@pytest.mark.requirement("S13")
@pytest.mark.parametrize(
    "permissive", [False, None, 1, RawValue(True), RawValue(True, 0x80000000, "Bad", 1)]
)
def test_nothing_is_written_without_a_good_permissive_bit(running, permissive):
    out = running.cycle(permissive=permissive)
    assert (
        out.values["depth"] == 2.66 and isnan(out.drives.force_kn) and isnan(out.drives.speed_rpm)
    )
    assert running.command() is None and running.refused == {"not_permissive"}
    assert running.gateway.ticks == 2


@pytest.mark.requirement("S14")
def test_commands_restart_from_the_drives_after_the_permissive_returns(running):
    running.cycle(permissive=False)
    running.in_force = Command(70.0, 407.5)
    assert running.cycle() is None
    assert running.command() is None and running.refused == {"paused"}
    withheld = 1 + running.pause(force_acting=70.0)
    assert withheld == pytest.approx(PAUSE_S / 0.1, abs=1)
    assert running.gateway.paused == withheld
    assert running.gateway.joined
    assert running.command(78.4) is None and "jump" in running.refused
    running.cycle(force_acting=70.0)
    running.obey(running.command(70.5))


def test_first_cycle_after_a_pause_reports_set_points_then_feedback(running):
    running.cycle(permissive=False)
    running.in_force = Command(70.0, 407.5)
    while (out := running.cycle(force_acting=74.0)) is None:
        pass
    assert out.drives.force_kn == 70.0
    running.obey(running.command(70.5))
    assert running.cycle(force_acting=74.5).drives.force_kn == 74.5


@pytest.mark.requirement("S14")
def test_after_a_loss_of_the_connection_the_pause_is_as_long(running):
    running.gateway.on_lost()
    assert running.command() is None and running.refused == {"disconnected"}
    running.gateway.on_connected()
    assert running.command() is None and running.gateway.gate.refused["disconnected"] == 2
    assert running.pause() == pytest.approx(PAUSE_S / 0.1, abs=1)
    running.obey(running.command())


def test_after_a_long_loss_there_is_nothing_to_wait_for(running):
    running.gateway.on_lost()
    running.gateway.on_connected()
    assert running.cycle(steps=100) is not None


def test_a_steady_ramp_at_the_limit_is_no_jump_though_the_machine_shows_it_a_cycle_later(running):
    shown = STEADY
    for _ in range(8):
        order = running.command(running.in_force.force_kn + 1.0)
        assert order is not None, running.gateway.gate.last
        running.gateway.on_written(order, "", running.now_s)
        running.cycle(force_in_force=shown.force_kn)
        shown = running.in_force = order.command


def test_rejected_write_is_not_in_force(running):
    running.gateway.on_written(running.command(79.4), "refused", running.now_s)
    assert isnan(running.cycle().drives.force_kn)
    assert running.command(80.4) is None and running.refused == {"jump"}
    assert running.gateway.failed == 1 and running.gateway.last_failure == "refused"


@pytest.mark.requirement("S32")
def test_a_ramp_goes_on_when_single_commands_are_lost_but_by_one_move_from_what_the_machine_has(
    running,
):
    running.obey(running.command(79.4))
    running.cycle()
    running.gateway.on_written(running.command(80.4), "refused", running.now_s)
    running.cycle()
    order = running.command(81.4)
    assert order.command.force_kn == pytest.approx(80.4) and running.gateway.cut == 1
    running.obey(order)
    running.cycle(steps=4)
    assert running.command(84.0) is None and running.refused == {"jump"}


@pytest.fixture
def with_other_moves(machine, parameters, read_of):
    """Running, with 2 kN and 3 rpm per tick; the machine has taken a command."""
    made = Machine(machine, parameters | {"limits.force_step_kn": 2.0}, read_of)
    made.cycle()
    made.obey(made.command())
    return made


@pytest.mark.requirement("S32")
@pytest.mark.parametrize(
    ("asked", "cut_to"),
    [
        ((84.3, 407.5), (80.4, 407.5)),
        ((72.5, 407.5), (76.4, 407.5)),
        ((78.4, 416.4), (78.4, 410.5)),
        ((78.4, 398.6), (78.4, 404.5)),
        ((84.5, 407.5), None),
        ((78.4, 416.6), None),
    ],
)
def test_a_command_catches_up_from_three_moves_away_and_no_further(
    with_other_moves, asked, cut_to
):
    with_other_moves.cycle()
    order = with_other_moves.command(*asked)
    assert (order and order.command) == (pytest.approx(cut_to) if cut_to else None)
    assert with_other_moves.gateway.cut == bool(cut_to)
    assert with_other_moves.refused == (set() if cut_to else {"jump"})


@pytest.mark.requirement("S32")
def test_every_command_that_was_cut_is_counted(with_other_moves):
    for force_kn in (82.0, 84.0, 86.0):
        with_other_moves.cycle()
        with_other_moves.obey(with_other_moves.command(force_kn))
    assert with_other_moves.in_force.force_kn == 84.4 and with_other_moves.gateway.cut == 3


@pytest.mark.requirement("S32")
def test_between_what_it_shows_and_what_it_has_taken_no_command_is_within_a_move_of_both(
    with_other_moves,
):
    """The machine moves by itself, faster than commands may.

    None is written until it is clear where it is.
    """
    with_other_moves.cycle(force_in_force=73.5)
    assert with_other_moves.command(76.0) is None and with_other_moves.refused == {"jump"}
    assert with_other_moves.gateway.cut == 0
    with_other_moves.cycle(force_in_force=73.5)
    assert with_other_moves.command(75.0).command.force_kn == 75.0


@pytest.mark.requirement("S32")
@pytest.mark.parametrize(("cycles", "is_cut"), [(3, True), (4, False)])
def test_a_command_catches_up_within_three_cycles_of_the_last_one_that_was_taken(
    with_other_moves, cycles, is_cut
):
    with_other_moves.cycle(steps=cycles)
    assert (with_other_moves.command(83.0) is not None) == is_cut
    assert with_other_moves.gateway.cut == is_cut


def test_rounded_readback_is_not_a_machine_move(with_other_moves):
    """The readback is a cycle late and a little off; a ramp at the limit is not cut."""
    shown = before = STEADY
    for _ in range(5):
        requested = Command(before.force_kn + 1.98, before.speed_rpm + 2.97)
        with_other_moves.cycle(
            force_in_force=shown.force_kn + 0.018, speed_in_force=shown.speed_rpm + 0.027
        )
        order = with_other_moves.command(*requested)
        assert order.command == requested
        with_other_moves.gateway.on_written(order, "", with_other_moves.now_s)
        shown, before = before, requested
    assert with_other_moves.gateway.cut == 0


def test_written_and_failed_commands_are_counted(running):
    for failure in ("", "refused", "", "refused"):
        running.gateway.on_written(running.command(), failure, running.now_s)
        running.cycle()
    assert (running.gateway.written, running.gateway.failed) == (2, 2)


def test_while_the_server_does_not_answer_every_command_is_refused_in_the_end(running):
    """And after three of them nothing waits any more: control restarts from the drives."""
    running.command()
    for count in range(6):
        running.cycle()
        assert running.command() is None
        assert running.gateway.joined == (count < 3)
    refused = running.gateway.gate.refused
    assert running.gateway.gate.total() == 6 and (refused["unanswered"], refused["paused"]) == (
        4,
        2,
    )


@pytest.mark.requirement("S32")
def test_slow_machine_is_led_by_its_readback(running):
    """It acknowledges every write, but its own rate is half of ours."""
    shown = STEADY.force_kn
    for k in range(1, 8):
        order = running.command(min(STEADY.force_kn + k, shown + 1.4))
        assert abs(order.command.force_kn - shown) <= 1.0 + 1e-6
        running.gateway.on_written(order, "", running.now_s)
        shown += 0.5
        running.cycle(force_in_force=shown)


@pytest.mark.requirement("S32")
def test_a_write_that_may_have_arrived_counts_as_well(running):
    running.obey(running.command(78.4))
    running.cycle()
    running.gateway.on_written(running.command(79.3), "no answer in time", running.now_s)
    running.cycle()
    order = running.command(77.6)
    assert order.command.force_kn == pytest.approx(78.3)


def test_set_point_outside_the_limits_is_reported(running):
    running.cycle(force_in_force=40.0)
    assert running.command(60.0) is None
    assert running.refused == {"outside"}


@pytest.mark.parametrize("how", ["jump", "failure"])
def test_lost_writes_restart_control_from_the_drives(running, how):
    for _ in range(3):
        assert running.gateway.joined
        if how == "jump":
            assert running.command(90.0) is None
        else:
            running.gateway.on_written(running.command(), "refused", running.now_s)
        running.cycle()
    assert not running.gateway.joined
    running.pause()
    running.obey(running.command())


@pytest.mark.requirement("S13")
@pytest.mark.parametrize("node", ["force_in_force", "speed_in_force"])
def test_unknown_set_points_block_writes_with_a_reason(running, node):
    running.cycle(**{node: None})
    assert running.command() is None and running.refused == {"not_known"}
    assert running.gateway.gate.last.data["fault"]


def test_a_late_answer_to_an_order_from_before_a_loss_changes_nothing(running):
    order = running.command()
    running.gateway.on_lost()
    running.gateway.on_written(order, "", running.now_s)
    assert running.gateway.written == 0


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("off_kn", [-0.7, -5.0, 0.7])
def test_a_machine_that_has_moved_by_itself_needs_an_acknowledgement(running, off_kn):
    """Its watchdog has lowered the force, or somebody has moved it by hand."""
    running.obey(running.command())
    running.gateway.on_lost()
    running.gateway.on_connected()
    running.in_force = running.in_force._replace(force_kn=running.in_force.force_kn + off_kn)
    running.pause()
    register = running.gateway.fence.register
    assert (register.stopped, register.value.cause) == (True, StopCause.WATCHDOG)
    assert running.command(*running.in_force) is None and running.refused == {"stopped"}
    assert running.command(*running.in_force, source="safe_stop") is not None
    register.acknowledge("operator", 0)
    running.gateway.on_lost()
    running.gateway.on_connected()
    running.pause()
    running.obey(running.command(*running.in_force))


@pytest.mark.requirement("S25")
def test_a_machine_that_has_stayed_where_it_was_is_commanded_again(running):
    running.obey(running.command())
    running.gateway.on_lost()
    running.gateway.on_connected()
    running.pause()
    assert not running.gateway.fence.register.stopped
    running.obey(running.command())


@pytest.mark.requirement("S38")
def test_uncertain_write_has_an_unknown_source(running):
    """Else a request would be answered by what acted before it."""
    gateway = running.gateway
    assert gateway.fence.state.source == ""
    gateway.on_written(running.command(), "no answer", running.now_s)
    assert gateway.fence.state.source == "", "no command has acted yet"
    running.cycle()
    running.obey(running.command())
    assert gateway.fence.state.source == "nmpc"
    running.cycle()
    gateway.on_written(running.command(source="hold"), "no answer", running.now_s)
    assert gateway.fence.state.source == UNKNOWN
    running.cycle()
    running.obey(running.command(source="hold"))
    assert gateway.fence.state.source == "hold"


@pytest.mark.requirement("S25")
def test_uncertain_write_is_not_a_machine_move(running):
    running.obey(running.command())
    running.cycle()
    order = running.command(78.9)
    running.gateway.on_written(order, "no answer", running.now_s)
    running.in_force = order.command
    running.gateway.on_lost()
    running.gateway.on_connected()
    running.pause()
    assert not running.gateway.fence.register.stopped


@pytest.mark.requirement("S9")
def test_commands_of_a_leader_before_are_refused(running):
    running.obey(running.command(signature=Signature(2, "b")))
    running.cycle()
    assert running.command(signature=Signature(1, "a")) is None
    assert running.refused == {"leader"}
    assert running.gateway.fence.state[:2] == (2, "b")


@pytest.mark.requirement("S33")
def test_failed_write_without_successor_restarts_from_the_drives(running):
    """A fresh supervisor commands nothing before the drives are reported, and they are not while commands are lost."""
    order = running.command()
    running.gateway.on_written(order, "no answer", running.now_s)
    assert isnan(running.cycle().drives.force_kn)
    for _ in range(4):
        running.cycle()
    assert not running.gateway.joined
    running.pause()
    running.cycle()
    assert running.cycle().drives == running.in_force


# ---------------------------------------------------------------- several sensors of the depth


class Several:
    """A machine with four sensors of the depth, which stands at one depth."""

    def __init__(self, text, parameters, read_of):
        self.machine = Machine(MachineFile.parse(text), parameters, read_of)
        self.random, self.added_mm, self.touch_offs = np.random.default_rng(1), {}, 7

    def run(self, ticks, **changed):
        """What was published at last."""
        for _ in range(ticks):
            shown = {
                name: 2.66
                + self.added_mm.get(name, 0.0)
                + SENSORS[name].noise * self.random.normal()
                for name in DEPTH_CHANNELS
            }
            more = {"touch_off": self.touch_offs, "travel": 0.0, "depth": nan}
            out = self.machine.cycle(**(shown | more | changed))
        return out


@pytest.fixture
def several(several_sensors, parameters, read_of):
    return Several(several_sensors, parameters, read_of)


@pytest.mark.parametrize("sensor", DEPTH_CHANNELS)
def test_the_depth_of_several_sensors_outlives_a_slip_of_one(several, sensor):
    assert several.run(100).values["depth"] == pytest.approx(2.66, abs=0.02)
    several.added_mm[sensor] = 0.3
    out = several.run(30)
    assert out.values["depth"] == pytest.approx(2.66, abs=0.03)
    assert out.fused.health[DEPTH_CHANNELS[sensor]] is not ChannelHealth.GOOD
    assert DEPTH_CHANNELS[sensor] not in out.fused.used


def test_a_touch_off_begins_afresh(several):
    several.run(50)
    several.added_mm = dict.fromkeys(DEPTH_CHANNELS, -0.5)
    several.touch_offs += 1
    assert several.run(1).values["depth"] == pytest.approx(2.16, abs=0.02)


@pytest.mark.parametrize("count", [RawValue(9, 0x80000000, "Bad", 1), RawValue(9), 9.0, None])
def test_a_touch_off_that_is_not_certain_changes_nothing(several, count):
    several.run(50)
    several.added_mm["depth_laser"] = 0.3
    several.run(30)
    assert "laser" not in several.run(5, touch_off=count).fused.used


def test_no_sensor_of_the_depth_is_an_unknown_depth(several):
    several.run(20)
    assert isnan(several.run(10, **dict.fromkeys(DEPTH_CHANNELS, nan)).values["depth"])


def test_a_pause_of_the_measurements_does_not_pause_the_fusion(several):
    several.run(50)
    several.machine.gateway.on_lost()
    several.machine.gateway.on_connected()
    several.added_mm["depth_axial"] = 0.3
    assert several.run(5) is None
    assert "axial" not in several.run(30).fused.used
