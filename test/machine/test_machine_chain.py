"""The whole chain at the emulated machine.

Each part is killed and ended in turn, the connection cut and stalled.
"""

import itertools
import signal
from math import isnan

import pytest
import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from machine_weld import GRAPH, MachineWeld

from fsw_control.depth_channels import ChannelHealth
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_plant.events import Fault
from fsw_scenario.launcher import Launcher
from fsw_test_support.machine import RunningMachine, free_port, write_machine_file
from fsw_test_support.ros_graph import domain_id
from fsw_test_support.waiting import PATIENCE_S

__all__ = ["domain_id"]


def test_it_welds(weld):
    """In other units than the paper's, and what nodes and machine say agrees."""
    weld.until_report("machine", "runs and obeys")
    weld.until_report("writes", "taken")
    weld.until_report("connection", "connected")

    def depth():
        return weld.machine.do(lambda server: server.plant.truth()).depth_mm * 1e-3

    def temperature():
        return float(weld.value("machine", "temperature"))

    # what is reported is some time old
    weld.until(lambda: weld.depths[-1].depth == pytest.approx(depth(), abs=2e-5), "the depth")
    weld.until(
        lambda: temperature() == pytest.approx(weld.temperature_c(), abs=2.0), "the temperature"
    )


def test_it_welds_with_several_sensors_of_the_depth_of_which_one_slips(
    tmp_path, shipped_text, domain_id
):
    nodes = yaml.safe_load(shipped_text)["nodes"]
    del nodes["depth"]
    nodes |= {name: {"node": f"s=Weld.{name}", "unit": "mm"} for name in DEPTH_CHANNELS}
    nodes |= {"touch_off": {"node": "s=Weld.TouchOffs"}}
    nodes |= {"travel": {"node": "s=Weld.Travel", "unit": "mm"}}
    port, parts = free_port(), {"nodes": nodes, "depth_fusion": {}}
    file = write_machine_file(tmp_path / "machine.yaml", port, shipped_text, **parts)
    machine = RunningMachine(file, machine={"depth_channels": True})
    with Launcher(tmp_path / "log", domain_id) as launcher:
        weld = MachineWeld(domain_id, launcher, machine, file)
        weld.start(*GRAPH)
        weld.runs()
        bad, seen = list(DEPTH_CHANNELS).index("depth_lvdt_trail"), len(weld.depths)
        weld.until(lambda: len(weld.depths) > seen + 20, "the biases of the channels")
        slip = Fault("depth_lvdt_trail", "bias", 0.4)
        machine.do(lambda server: server.plant.begin(slip))
        weld.until(lambda: weld.depths[-1].channel_health[bad] == ChannelHealth.SLIP, "the slip")
        assert weld.depths[-1].channels_used & 1 << bad == 0
        assert weld.depths[-1].depth == pytest.approx(2.66e-3, abs=1e-4)
        weld.runs(more=5)
        weld.close()
    machine.stop()


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.full)]
)
def test_nmpc_ends(weld, number):
    weld.runs("nmpc")
    weld.end("nmpc", number)
    weld.runs("decentral")


@pytest.mark.parametrize("name", [pytest.param("supervisor", marks=pytest.mark.full), "gateway"])
def test_part_ends_and_is_started_again_at_once(weld, name):
    weld.end(name, signal.SIGTERM)
    weld.start(name)
    weld.runs()


@pytest.mark.requirement("S14")
@pytest.mark.parametrize("name", [pytest.param("supervisor", marks=pytest.mark.full), "gateway"])
def test_the_heartbeat_ends(weld, name):
    """The machine's watchdog takes over; what is started again begins from there."""
    weld.end(name, signal.SIGKILL)
    safe, count = weld.until_safe(), len(weld.taken())
    weld.start(name)
    weld.runs()
    _, _, before = weld.taken()[count]
    assert before.force_kn <= safe.force_kn and before.speed_rpm == safe.speed_rpm


@pytest.mark.requirement("S14")
@pytest.mark.parametrize("how", ["cut", "stall"])
def test_the_connection_breaks(weld, how):
    losses = int(weld.value("connection", "losses"))
    getattr(weld.proxy, how)()
    weld.until(lambda: int(weld.value("connection", "losses")) > losses, "the loss to be told")
    weld.proxy.flow()
    weld.until_report("connection", "connected")
    weld.runs()


@pytest.mark.requirement("S14")
def test_the_machine_does_not_permit(weld):
    weld.machine.do(lambda server: setattr(server, "permissive", False))
    weld.until_report("machine", "permits no commands")
    count = len(weld.taken())
    weld.until_safe()
    assert len(weld.taken()) == count
    weld.until(lambda: isnan(weld.drives[-1].axial_force), "drives that do not obey")
    weld.until(
        lambda: int(weld.value("commands", "refused: not_permissive")) > 0, "commands refused"
    )
    weld.machine.do(lambda server: setattr(server, "permissive", True))
    weld.runs()


@pytest.mark.requirement("S15")
def test_the_machines_clock_is_set(weld):
    """By minutes, forwards and back: the stamps go on, and the weld with them."""
    for offset_s in (300.0, -300.0):
        weld.machine.do(
            lambda server, s=offset_s: setattr(server, "clock_offset_ns", round(s * 1e9))
        )
        weld.until(lambda: "it was set" in weld.report("clock"), "the step to be told")
        weld.runs()
    stamps = [message.header.stamp for message in weld.depths]
    times = [stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps[-30:]]
    # A busy machine may lose cycles, but no step is as large as those of the clock.
    assert all(0.0 < b - a < 100.0 for a, b in itertools.pairwise(times))
    weld.machine.do(lambda server: setattr(server, "clock_offset_ns", 0))


def test_a_second_gateway_is_refused(weld):
    patient = ["--ros-args", "-p", "discovery_s:=10.0"]  # ends as soon as it hears the first
    weld.launcher.start("second", "fsw_machine.machine_node", patient)
    child = weld.launcher.children.pop("second")
    assert child.process.wait(PATIENCE_S) == 2 and "end it first" in child.text()


def test_a_long_stall(weld):
    """The watchdog acts meanwhile; what was held back in the connection is not obeyed later."""
    weld.proxy.stall()
    weld.until_safe()
    count = len(weld.taken())
    weld.proxy.flow()
    weld.runs()
    assert weld.taken()[count][0] > weld.taken()[count - 1][0] + 10


def test_a_deactivated_gateway_leaves_the_machine_to_its_watchdog(weld):
    change = weld.node.create_client(ChangeState, "fsw_machine/change_state")

    def ask(transition):
        return weld.call(change, ChangeState.Request(transition=Transition(id=transition))).success

    def sessions():
        return weld.launcher.children["gateway"].text().count("connection: connected")

    weld.runs()
    before = sessions()
    assert ask(Transition.TRANSITION_DEACTIVATE)
    weld.until_safe()
    assert ask(Transition.TRANSITION_ACTIVATE)
    weld.until(lambda: sessions() > before, "the next session to be logged")
    weld.until_report("writes", "taken")


@pytest.mark.requirement("S14")
@pytest.mark.full
def test_the_machine_is_started_again(tmp_path, shipped_text, domain_id):
    """The server as a process of its own, killed and ended.

    Its counter begins again, and so does the weld.
    """
    file = write_machine_file(tmp_path / "machine.yaml", free_port(), shipped_text)
    with Launcher(tmp_path / "log", domain_id) as launcher:
        weld = MachineWeld(domain_id, launcher, None, file)
        weld.start("server", *GRAPH)
        for times, number in enumerate((signal.SIGKILL, signal.SIGTERM)):
            weld.until_report("writes", "taken")
            weld.end("server", number)
            weld.until_report("machine", "not connected")
            weld.start("server")
            weld.until(
                lambda goal=times + 1: int(weld.value("machine", "counter went back")) == goal,
                "the counter",
            )
            count = int(weld.value("writes", "written"))
            weld.until(
                lambda least=count + 5: int(weld.value("writes", "written")) > least,
                "commands written",
            )
        weld.close()


def test_a_machine_file_that_is_wrong_is_refused_in_one_line(tmp_path, shipped_text, domain_id):
    file = write_machine_file(
        tmp_path / "machine.yaml", 4840, shipped_text, nodes__depth__unit="inch"
    )
    with Launcher(tmp_path / "log", domain_id) as launcher:
        weld = MachineWeld(domain_id, launcher, None, file)
        weld.start("gateway")
        child = launcher.children["gateway"]
        assert child.process.wait(PATIENCE_S) == 2
        text = child.text().strip()
        assert "nodes.depth.unit is 'inch'" in text and "\n" not in text
        weld.close()
