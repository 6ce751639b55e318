"""The plant's node over real middleware."""

import math
import os
import random
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise

import pytest
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from fsw_control import Command
from fsw_control import messages_ros as convert
from fsw_control.sensors import DEPTH_CHANNELS, SENSORS
from fsw_control.single_instance_ros import AnotherPlantError
from fsw_control.stop import Stop as Register
from fsw_control.topics_ros import LATEST, PLAYER_READY, STREAM
from fsw_control.units import mm_from_m, rpm_from_rad_s
from fsw_msgs.msg import (
    ControllerHealth,
    DriveFeedback,
    PlantState,
    ShoulderDepth,
    Stop,
    SupervisorState,
    WeldCommand,
    WeldProgress,
)
from fsw_msgs.srv import ResetPlant, SetDisturbance, SetFault
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_plant.plant_node import PlantNode, main
from fsw_test_support.waiting import PATIENCE_S

pytestmark = pytest.mark.slow

TICK_NS = 100_000_000
SENSOR_TOPICS = ("depth", "torque", "temperature", "truth")


def test_lockstep_gives_the_trajectory_of_the_emulator(graph):
    generator = random.Random(3)
    moves = [(generator.uniform(-1, 1), generator.uniform(-3, 3)) for _ in range(300)]
    events = "[{at_s: 5, disturbance: {channel: depth, shape: step, amplitude_mm: 0.1}}, "
    events += (
        "{at_s: 8, fault: {sensor: thermocouple, kind: bias, magnitude_c: 3.0, duration_s: 4}}]"
    )
    force, speed, sent = 78.4, 407.576, []

    def answer(tick, stamp):
        nonlocal force, speed
        if tick <= len(moves):
            force = min(max(force + moves[tick - 1][0], 60.0), 95.0)
            speed = min(max(speed + moves[tick - 1][1], 300.0), 500.0)
            sent.append(Command(force, speed))
            graph.peer.command(stamp, force, speed)

    peer = graph.start(
        speed=0.0, seed=5, factors__copper_lag_s=1.1, scenario=f'"{events}"', answer=answer
    )
    graph.until(lambda: len(peer.got["temperature"]) > len(moves))
    offline = PlantEmulator(
        PlantConfig.from_values({"seed": 5, "factors.copper_lag_s": 1.1}),
        PlantSchedule.from_yaml(events),
    )
    for k, command in enumerate(sent):
        reading, truth = offline.measure(), offline.truth()
        assert mm_from_m(peer.got["depth"][k].depth) == pytest.approx(
            reading.samples["depth"][0].value, rel=1e-9
        )
        assert peer.got["torque"][k].torque == pytest.approx(
            reading.samples["torque"][0].value, rel=1e-9
        )
        assert peer.got["temperature"][k].temperature == pytest.approx(
            reading.samples["thermocouple"][0].value, rel=1e-9
        )
        assert peer.got["truth"][k].axial_force == pytest.approx(truth.force_kn * 1e3, rel=1e-9)
        assert rpm_from_rad_s(peer.got["truth"][k].spindle_speed) == pytest.approx(
            truth.speed_rpm, rel=1e-9
        )
        assert offline.apply(command) == ""
        offline.step()
    for topic in SENSOR_TOPICS:
        assert peer.stamps(topic) == [(k + 1) * TICK_NS for k in range(len(moves) + 1)], topic
    clock = peer.stamps("clock")
    assert clock and set(clock) <= set(peer.stamps("depth")) and clock == sorted(clock)


def test_depth_is_fused_from_the_channels_that_are_published(graph):
    events = "[{at_s: 1, fault: {sensor: depth_axial, kind: nan}}]"
    settings = {"seed": 5, "machine.depth_channels": True}
    peer = graph.start(
        speed=0.0,
        seed=5,
        machine__depth_channels=True,
        scenario=f'"{events}"',
        answer=lambda _, stamp: graph.peer.command(stamp),
    )
    graph.until(lambda: len(peer.got["depth"]) > 40)
    offline = PlantEmulator(PlantConfig.from_values(settings), PlantSchedule.from_yaml(events))
    topics = {name for name, _ in peer.node.get_topic_names_and_types()}
    assert topics >= {f"/{SENSORS[name].topic}" for name in DEPTH_CHANNELS}
    for message in peer.got["depth"][:40]:
        fused = offline.measure().fused
        assert mm_from_m(message.depth) == pytest.approx(fused.depth_mm, rel=1e-9)
        assert mm_from_m(message.standard_deviation) == pytest.approx(fused.deviation_mm)
        assert list(message.channel_health) == list(fused.health.values())
        assert offline.apply(Command(78.4, 407.576)) == ""
        offline.step()
    assert message.channels_used == 0b0111
    assert message.channel_health[3] == ShoulderDepth.MISSING


def test_on_a_canister_the_tool_goes_where_the_programme_says(graph, block):
    """In real time the tool travels, stands during a hold, and continues from there."""
    path = "{path: [{at_s: 0.0, arc_mm: 0.0}, {at_s: 1000.0, arc_mm: 2000.0, axial_mm: 100.0}]}"
    peer = graph.start(process="canister", start__temperature_c=800.0, scenario=f'"{path}"')
    progress = peer.node.create_publisher(WeldProgress, "fsw/weld_progress", LATEST)
    heated = len(block.moved)
    graph.until(lambda: len(block.moved) > heated + 2)
    assert block.moved[-1][0] == 2.0

    def tell(state, time_s):
        stamp = peer.got["depth"][-1].header.stamp
        progress.publish(
            WeldProgress(header=Header(stamp=stamp), state=state, time_left=1000.0 - time_s)
        )

    graph.until(lambda: progress.get_subscription_count() == 1)
    tell("held", 500.0)
    graph.until(lambda: block.moved[-1] == (0.0, 50.0))
    stood = len(block.moved)
    graph.until(lambda: len(block.moved) > stood + 2)
    assert set(block.moved[stood:]) == {(0.0, 50.0)}
    tell("running", 500.0)
    graph.until(lambda: block.moved[-1][0] == 2.0)
    assert 50.0 < block.moved[-1][1] < 51.0


def test_a_scenario_that_is_set_later_may_have_a_path_to_follow(graph):
    peer = graph.start(machine__depth_channels="true", speed=20.0)
    progress = peer.node.create_publisher(WeldProgress, "fsw/weld_progress", LATEST)
    graph.until(lambda: progress.get_subscription_count() == 1)
    held = WeldProgress(state="held", time_left=500.0)
    heard = graph.plant.emulator.tick
    progress.publish(held)
    graph.until(lambda: graph.plant.emulator.tick > heard + 5)
    assert graph.plant.emulator.travel.lag_s == 0.0
    path = "{path: [{at_s: 0.0, arc_mm: 0.0}, {at_s: 1000.0, arc_mm: 2000.0}]}"
    (result,) = graph.plant.set_parameters([Parameter("scenario", value=path)])
    assert result.successful, result.reason
    held.header.stamp = peer.got["depth"][-1].header.stamp
    progress.publish(held)
    graph.until(lambda: graph.plant.emulator.travel.lag_s != 0.0)


def test_refused_commands_are_counted_and_lockstep_continues(graph):
    def answer(tick, stamp):
        bad = {
            2: {"force_kn": math.nan},
            3: {"force_kn": 200.0},
            4: {"speed_rpm": 501.0},
            5: {"speed_rpm": -math.inf},
            6: {"healthy": False},
        }
        if tick <= 10:
            graph.peer.command(stamp, **bad.get(tick, {}))
            if tick not in bad:
                graph.peer.command(stamp, force_kn=90.0)  # a second answer to the same measurement

    peer = graph.start(speed=0.0, noise="false", answer=answer)
    graph.until(lambda: len(peer.got["truth"]) == 11)
    assert all(state.axial_force == pytest.approx(78.4e3, abs=1e-6) for state in peer.got["truth"])
    assert all(state.watchdog == PlantState.WATCHDOG_OK for state in peer.got["truth"])
    graph.until(lambda: peer.report("commands") and counts(peer)["repeated"] == 5)
    seen = counts(peer)
    assert (seen["not_finite"], seen["out_of_range"], seen["unhealthy"]) == (2, 2, 1)


def test_lockstep_waits_for_a_player_while_there_is_one(graph, monkeypatch):
    """What a player sends before a tick, is heard before it.

    Else the same scenario would not give the same weld.

    When it leaves, the weld may be over: before the plant is ended, all must have arrived.
    """
    ready, awaited, wait = None, [], Publisher.wait_for_all_acked
    monkeypatch.setattr(
        Publisher,
        "wait_for_all_acked",
        lambda *arguments: awaited.append(graph.plant.emulator.tick) or wait(*arguments),
    )

    def answer(tick, stamp):
        if ready is not None and tick <= 8:
            ready.publish(Header(stamp=stamp))
        if tick != 3:
            graph.peer.command(stamp)

    truth = graph.start(speed=0.0, lockstep_timeout_s=600.0, answer=answer).got["truth"]
    graph.until(lambda: len(truth) == 3 and len(graph.peer.got["temperature"]) == 3)
    ready = graph.peer.node.create_publisher(Header, PLAYER_READY, LATEST)
    graph.until(
        lambda: ready.get_subscription_count() and graph.plant.count_publishers(PLAYER_READY)
    )
    answer(3, truth[-1].header.stamp)
    graph.peer.command(truth[-1].header.stamp)
    graph.until(lambda: len(truth) == 9)
    for _ in range(20):
        graph.spin()
    assert len(truth) == 9
    assert awaited == []
    graph.peer.node.destroy_publisher(ready)
    graph.until(lambda: len(truth) > 15)
    assert set(awaited) == {9}


def test_lockstep_continues_without_a_hanging_player(graph):
    player = None

    def answer(tick, stamp):
        nonlocal player
        graph.peer.command(stamp)
        if tick == 3:
            player = graph.peer.node.create_publisher(Header, PLAYER_READY, LATEST)
            player.publish(Header(stamp=stamp))

    truth = graph.start(speed=0.0, lockstep_timeout_s=0.3, answer=answer).got["truth"]
    graph.until(lambda: len(truth) > 30)


#: receives fsw/depth up to a stamp in seconds, and prints how many ticks are missing between the
#: first and the last
LISTENER = """
import sys
import rclpy
from fsw_control.topics_ros import SENT
from fsw_msgs.msg import ShoulderDepth
rclpy.init()
node, ticks = rclpy.create_node("listener"), []
def take(depth):
    ticks.append(depth.header.stamp.sec * 10 + depth.header.stamp.nanosec // 100_000_000)
node.create_subscription(ShoulderDepth, "fsw/depth", take, SENT)
while not ticks or ticks[-1] < int(sys.argv[1]):
    rclpy.spin_once(node)
print(ticks[-1] - ticks[0] + 1 - len(ticks))
"""


def test_lockstep_waits_for_a_subscriber_that_stands_still(graph, monkeypatch):
    """A recorder on a busy machine, which is no part of the tick, would miss what its publishers no longer keep."""
    last, wait = 1500, Publisher.wait_for_all_acked
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", LISTENER, str(last)]
    listener = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)

    def arrived(publisher, timeout):
        if not wait(publisher, Duration()):
            listener.send_signal(signal.SIGCONT)
        return wait(publisher, timeout)

    def answer(tick, stamp):
        if tick == 20:
            listener.send_signal(signal.SIGSTOP)
        if tick == last:
            listener.send_signal(signal.SIGCONT)
        elif tick > 1:
            graph.peer.command(stamp)

    monkeypatch.setattr(Publisher, "wait_for_all_acked", arrived)
    try:
        peer = graph.start(speed=0.0, answer=answer)
        graph.until(lambda: graph.plant.count_subscribers("fsw/depth") == 2)
        peer.command(peer.got["depth"][0].header.stamp)
        graph.until(lambda: len(peer.got["temperature"]) >= last)
        graph.until(lambda: listener.poll() is not None)  # what was lost is sent again meanwhile
        assert int(listener.stdout.read()) == 0
    finally:
        listener.kill()
        listener.communicate()


def test_lockstep_waits_once_for_a_subscriber_that_hangs(graph, monkeypatch):
    waited_ns = []

    def never(publisher, timeout):
        waited_ns.append(timeout.nanoseconds)
        return False

    monkeypatch.setattr(Publisher, "wait_for_all_acked", never)
    graph.start(speed=0.0, answer=lambda tick, stamp: graph.peer.command(stamp))
    graph.until(lambda: len(waited_ns) == 3)
    assert waited_ns[0] > 0
    assert waited_ns[1:] == [0, 0]


def counts(peer):
    values = {pair.key: pair.value for pair in peer.report("commands").values}
    return {
        key.removeprefix("refused: "): int(value)
        for key, value in values.items()
        if key.startswith("refused: ")
    }


def test_silent_lockstep_is_reported_and_the_tick_repeated(graph):
    peer = graph.start(speed=0.0, lockstep_timeout_s=0.2)
    graph.until(
        lambda: (
            peer.stamps("depth").count(TICK_NS) >= 2 and peer.stamps("truth").count(TICK_NS) >= 2
        )
    )
    assert set(peer.stamps("depth")) == {TICK_NS}
    graph.until(
        lambda: (
            peer.report("clock")
            and peer.report("clock").message == "no command answers the last tick"
        )
    )
    assert peer.report("clock").level == b"\x02"
    peer.command(peer.got["depth"][-1].header.stamp)
    graph.until(lambda: 2 * TICK_NS in peer.stamps("depth"))


def test_lockstep_repeats_its_tick_for_a_supervisor_that_was_started_again(graph):
    peer = graph.start(speed=0.0, lockstep_timeout_s=600.0)
    for _ in range(20):
        graph.spin()
    assert peer.stamps("depth") == [TICK_NS], "nobody is new"
    second = peer.node.create_publisher(WeldCommand, "fsw/command", STREAM)
    graph.until(lambda: peer.stamps("depth").count(TICK_NS) >= 3)
    peer.node.destroy_publisher(second)
    peer.command(peer.got["depth"][-1].header.stamp)
    graph.until(lambda: 2 * TICK_NS in peer.stamps("depth"))


def test_a_repeated_tick_does_not_wait_for_the_player_again(graph):
    """The player has answered it and hears nothing new."""
    peer = graph.start(speed=0.0, lockstep_timeout_s=600.0)
    ready = peer.node.create_publisher(Header, PLAYER_READY, LATEST)
    graph.until(
        lambda: ready.get_subscription_count() and graph.plant.count_publishers(PLAYER_READY)
    )
    ready.publish(Header(stamp=peer.got["depth"][-1].header.stamp))
    graph.until(lambda: graph.plant._pace.player_present)
    second = peer.node.create_publisher(WeldCommand, "fsw/command", STREAM)
    graph.until(lambda: peer.stamps("depth").count(TICK_NS) >= 2)
    peer.command(peer.got["depth"][-1].header.stamp)
    graph.until(lambda: 2 * TICK_NS in peer.stamps("depth"))
    peer.node.destroy_publisher(second)


def test_dead_lockstep_ends_with_an_error(graph):
    graph.start(speed=0.0, lockstep_timeout_s=0.1, lockstep_give_up_s=0.3)
    with pytest.raises(SystemExit, match=r"tick 1 .* by peer\)"):
        graph.until(lambda: False)


def test_real_time_ticks_at_10_hz_with_one_stamp_per_tick(graph):
    peer = graph.start()
    begin = time.time_ns()
    heard = len(peer.got["temperature"])
    graph.until(lambda: len(peer.got["temperature"]) >= heard + 8)
    assert (
        time.time_ns() - begin
    ) * 1e-9 > 0.5  # the first of these may be overdue, and the second soon after it

    def steps():
        return [after - before for before, after in pairwise(peer.stamps("temperature"))]

    graph.until(
        lambda: steps().count(TICK_NS) >= 6
    )  # a busy machine may force jumps, which are other steps
    stamps = peer.stamps("temperature")
    for topic in SENSOR_TOPICS:
        graph.until(lambda topic=topic: len(peer.stamps(topic)) >= len(stamps))
        assert peer.stamps(topic)[: len(stamps)] == stamps
    assert abs(stamps[0] - begin) < PATIENCE_S * 1e9
    assert peer.got["clock"] == []


def test_simulated_time_at_a_pace(graph):
    peer = graph.start(speed=20.0)
    graph.until(lambda: len(peer.got["depth"]) >= 100)
    assert peer.stamps("depth")[:100] == [(k + 1) * TICK_NS for k in range(100)]
    assert len(peer.got["clock"]) > 50


def test_use_sim_time_means_that_the_plant_makes_it(graph):
    peer = graph.start(use_sim_time="true")
    graph.until(lambda: len(peer.got["clock"]) >= 3 and len(peer.got["depth"]) >= 3)
    assert peer.stamps("depth")[:3] == [TICK_NS, 2 * TICK_NS, 3 * TICK_NS]


@pytest.mark.requirement("S10", "S25")
def test_watchdog_holds_and_ramps_until_that_is_acknowledged(graph):
    peer = graph.start(speed=50.0, noise="false")
    drives = []
    peer.node.create_subscription(DriveFeedback, "fsw/drives", drives.append, 10)
    graph.until(lambda: peer.got["depth"])
    peer.command(peer.got["depth"][-1].header.stamp, 80.0, 410.0)
    graph.until(lambda: peer.got["truth"][-1].watchdog == PlantState.WATCHDOG_HOLD)
    assert peer.got["truth"][-1].axial_force == pytest.approx(80e3, abs=1.0)
    graph.until(lambda: peer.got["truth"][-1].axial_force < 65.001e3)
    assert peer.got["truth"][-1].watchdog == PlantState.WATCHDOG_SAFE
    assert rpm_from_rad_s(peer.got["truth"][-1].spindle_speed) == pytest.approx(410.0)
    ramp = [
        state.axial_force
        for state in peer.got["truth"]
        if state.watchdog == PlantState.WATCHDOG_SAFE
    ]
    assert all(0.0 <= a - b <= 201.0 for a, b in pairwise(ramp))
    graph.until(lambda: (report := peer.report("watchdog")) and report.level == b"\x02")
    assert "65 kN" in peer.report("watchdog").message
    graph.until(lambda: drives and drives[-1].actuator.stop.stopped)
    stop = drives[-1].actuator.stop
    assert stop.epoch > 0 and stop.cause == Stop.WATCHDOG

    def commanded(source, condition):
        """Command until a condition holds.

        A command to a measurement that is too old is refused.
        """

        def holds():
            peer.command(peer.got["depth"][-1].header.stamp, 70.0, 410.0, source)
            return condition()

        graph.until(holds)

    refused = peer.got["truth"][-1].refused_commands
    commanded("test", lambda: peer.got["truth"][-1].refused_commands > refused + 10)
    assert peer.got["truth"][-1].watchdog == PlantState.WATCHDOG_SAFE
    peer.stop = convert.stop(stop)
    commanded("safe_stop", lambda: peer.got["truth"][-1].watchdog == PlantState.WATCHDOG_OK)
    peer.stop = Register(drives[-1].actuator.stop.epoch + 1, False)
    commanded("safe_stop", lambda: not drives[-1].actuator.stop.stopped)
    commanded("test", lambda: drives[-1].actuator.source == "test")


def test_disturbance_and_fault_services(graph):
    peer = graph.start(speed=50.0, noise="false")
    disturb = peer.node.create_client(SetDisturbance, "fsw/plant/set_disturbance")
    fault = peer.node.create_client(SetFault, "fsw/plant/set_fault")
    answer = graph.call(
        disturb, SetDisturbance.Request(channel="depth", shape="step", amplitude=1e-4)
    )
    assert answer.ok and answer.message.startswith("depth: step ")
    graph.until(lambda: peer.got["truth"][-1].depth_disturbance == pytest.approx(1e-4))
    graph.until(lambda: peer.got["depth"][-1].depth == pytest.approx(2.76e-3))
    speed = SetDisturbance.Request(channel="spindle_speed", shape="step", amplitude=1.0)
    assert graph.call(disturb, speed).ok
    graph.until(lambda: peer.got["truth"][-1].speed_disturbance == pytest.approx(1.0))
    answer = graph.call(
        disturb, SetDisturbance.Request(channel="traverse", shape="step", amplitude=1.0)
    )
    assert not answer.ok and re.search(r"'traverse': .*\bdepth\b", answer.message)
    answer = graph.call(
        disturb, SetDisturbance.Request(channel="depth", shape="step", amplitude=1e6)
    )
    assert not answer.ok and "outside -1 to 1 mm" in answer.message
    assert graph.call(disturb, SetDisturbance.Request(channel="depth", shape="none")).ok
    graph.until(lambda: peer.got["truth"][-1].depth_disturbance == 0.0)

    assert graph.call(fault, SetFault.Request(sensor="depth", kind="bias", magnitude=5e-4)).ok
    graph.until(lambda: list(peer.got["truth"][-1].active_faults) == ["depth:bias"])
    graph.until(lambda: peer.got["depth"][-1].depth == pytest.approx(3.16e-3, abs=1e-5))
    assert graph.call(fault, SetFault.Request(sensor="thermocouple", kind="nan")).ok
    graph.until(lambda: math.isnan(peer.got["temperature"][-1].temperature))
    answer = graph.call(fault, SetFault.Request(sensor="depth", kind="odd"))
    assert not answer.ok and re.search(r"'odd': .*\bfreeze\b", answer.message)
    answer = graph.call(fault, SetFault.Request(sensor="depth", kind="bias", magnitude=1e6))
    assert not answer.ok and "outside -5 to 5 mm" in answer.message
    graph.until(
        lambda: (report := peer.report("sensors")) and "thermocouple:nan" in report.message
    )


def test_reset_service(graph):
    peer = graph.start(speed=50.0, noise="false")
    reset = peer.node.create_client(ResetPlant, "fsw/plant/reset")
    answer = graph.call(reset, ResetPlant.Request(seed=-1, depth=2.8e-3, temperature=0.0))
    assert answer.ok and answer.message.endswith(": 2.800 mm, 816.4 degC")
    graph.until(lambda: peer.got["depth"][-1].depth == pytest.approx(2.8e-3))
    answer = graph.call(reset, ResetPlant.Request(seed=2, depth=0.0, temperature=560.0))
    assert not answer.ok and "drives' limits" in answer.message
    answer = graph.call(reset, ResetPlant.Request(seed=2, depth=math.nan, temperature=0.0))
    assert not answer.ok and "no equilibrium" in answer.message


def test_sensors_are_announced_last_so_that_who_has_them_has_the_other_topics_of_a_tick(graph):
    graph.start(speed=0.0)
    announced = [publisher.topic_name for publisher in graph.plant.publishers]
    sensors = {"/fsw/depth", "/fsw/spindle_torque", "/fsw/thermocouple"}
    first = min(map(announced.index, sensors))
    assert max(map(announced.index, ("/clock", "/fsw/plant/truth", "/fsw/drives"))) < first


def test_first_tick_waits_for_subscribers(graph):
    peer = graph.start(speed=0.0, wait_for_subscribers=2, lockstep_timeout_s=0.1, connected=False)
    graph.until(lambda: peer.report("clock") is not None)
    assert "for subscribers" in peer.report("clock").message and not peer.got["depth"]
    from sensor_msgs.msg import Temperature

    from fsw_msgs.msg import ShoulderDepth, SpindleTorque

    second = []
    peer.node.create_subscription(ShoulderDepth, "fsw/depth", second.append, 10)
    peer.node.create_subscription(SpindleTorque, "fsw/spindle_torque", second.append, 10)
    peer.node.create_subscription(Temperature, "fsw/thermocouple", second.append, 10)
    graph.until(lambda: len(second) == 3)
    assert all(message.header.stamp.nanosec == TICK_NS for message in second)


@pytest.mark.requirement("S11")
def test_two_command_publishers_restrict_the_sources(graph):
    peer = graph.start(speed=50.0, noise="false", watchdog__timeout_s=60.0)
    states = peer.node.create_publisher(SupervisorState, "fsw/supervisor/state", LATEST)
    graph.until(lambda: states.get_subscription_count() == 1)
    states.publish(SupervisorState(controllers=[ControllerHealth(name="decentral")]))
    graph.until(lambda: peer.got["depth"])
    peer.command(peer.got["depth"][-1].header.stamp, 79.0, source="anybody")
    graph.until(lambda: peer.got["truth"][-1].axial_force == pytest.approx(79e3, abs=1.0))
    second = peer.node.create_publisher(peer.commands.msg_type, "fsw/command", 10)
    graph.until(
        lambda: (
            (report := peer.report("commands")) and "2 publishers: peer, peer" in report.message
        )
    )
    assert peer.report("commands").level == b"\x01"  # as while a standby takes over
    peer.command(peer.got["depth"][-1].header.stamp, 80.0, source="intruder")
    graph.until(lambda: peer.got["truth"][-1].refused_commands >= 1)
    graph.until(lambda: peer.report("commands").level == b"\x02")
    assert re.search(r"\b1 refused; .*'intruder'", peer.report("commands").message)
    peer.command(peer.got["depth"][-1].header.stamp, 79.5, source="decentral")
    graph.until(lambda: peer.got["truth"][-1].axial_force == pytest.approx(79.5e3, abs=1.0))
    assert max(state.axial_force for state in peer.got["truth"]) < 79.6e3
    assert second.topic_name == "/fsw/command"


def test_parameters_at_runtime(graph):

    peer = graph.start(speed=50.0)
    plant = graph.plant

    def set_one(name, value):
        return plant.set_parameters([Parameter(name, value=value)])[0]

    assert set_one("noise", False).successful
    graph.until(
        lambda: (
            peer.got["depth"] and peer.got["depth"][-1].depth == pytest.approx(2.66e-3, abs=1e-10)
        )
    )
    step = "[{at_s: 0, disturbance: {channel: depth, shape: step, amplitude_mm: 0.2}}]"
    assert set_one("scenario", step).successful
    graph.until(lambda: peer.got["depth"][-1].depth == pytest.approx(2.86e-3, abs=1e-10))
    assert set_one("factors.thermal_gain_c_per_kw", 1.2).successful
    for name, value, words in (
        ("limits.force_min_kn", 96.0, "below force_max"),
        ("scenario", "[{at_s: 0}]", "exactly one"),
        ("factors.dead_time_s", 9.0, "outside 0.1 to 10 s"),
        ("factors.copper_lag_s", 99.0, "out"),
        ("commands.sources", 3, ""),
    ):
        result = set_one(name, value)
        assert not result.successful and words in result.reason, result.reason
    assert not set_one("speed", 3.0).successful  # at start only


def test_namespace(graph):
    graph.start("-r", "__ns:=/left", speed=50.0, connected=False)
    names = {name for name, _ in graph.plant.get_topic_names_and_types()}
    assert {
        "/left/fsw/depth",
        "/left/fsw/command",
        "/left/fsw/plant/truth",
        "/clock",
        "/diagnostics",
    } <= names


def test_second_plant_is_refused(graph):
    graph.start(speed=0.0, discovery_s=0.3)  # lockstep: silent but alive
    command = [sys.executable, "-m", "fsw_plant.plant_node", "--ros-args"]
    command += [
        "-p",
        "discovery_s:=10.0",
    ]  # ends as soon as it hears the other's report or a repeated tick
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=environment, **pipes) as process:
        try:
            graph.until(lambda: process.poll() is not None)
        finally:
            process.kill()
        _, error = process.communicate()
    assert process.returncode == 2
    assert "/fsw/depth " in error and f"domain {graph.domain}" in error
    assert error.count("\n") == 1
    assert issubclass(AnotherPlantError, RuntimeError) and PlantNode is type(graph.plant)


@pytest.mark.parametrize(
    "parameter, words",
    [
        ("speed:=-1.0", "speed"),
        ("limits.force_min_kn:=96.0", "force_min (96)"),
        ("start.temperature_c:=560.0", "drives' limits"),
        ("scenario:=/nowhere.yaml", "scenario /nowhere.yaml"),
        ("factors.dead_time_s:=9.0", "dead_time_s = 25.2"),
    ],
)
def test_wrong_parameters_end_the_start_with_one_line(domain_id, capfd, parameter, words):
    assert main(["plant", "--ros-args", "-p", parameter]) == 2
    printed = "".join(capfd.readouterr())
    assert words in printed and printed.count("\n") == 1, printed
