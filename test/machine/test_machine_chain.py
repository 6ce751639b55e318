"""The whole chain at the emulated machine: each part is killed and ended in turn, the connection cut and stalled."""

import itertools
import signal
import sys
from importlib import resources
from math import isnan
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from machine_weld import GRAPH, MachineWeld

from fsw_control import weld as weld_numbers
from fsw_control.free_domain import free_domain
from fsw_control.parameters import defaults, load
from fsw_hmi.alarm_desk_ros import AlarmDesk
from fsw_hmi.watch_ros import Watch
from fsw_msgs.msg import WeldCommand
from fsw_scenario.launcher import Launcher
from fsw_test_support import machine_server
from fsw_test_support.machine import Proxy, RunningMachine, free_port, write_machine_file
from fsw_test_support.ros_graph import domain_id
from fsw_test_support.waiting import PATIENCE_S

__all__ = ["domain_id"]

OTHER_UNITS = {
    "depth": "m",
    "torque": "kN m",
    "temperature": "K",
    **dict.fromkeys(("force_acting", "force_in_force", "force_setpoint"), "N"),
    **dict.fromkeys(("speed_acting", "speed_in_force", "speed_setpoint"), "rad/s"),
}
#: the machine's watchdog acts after 1.5 s, and its safe state is so near that the weld survives it many times
WATCHDOG = {"watchdog.hold_s": 0.5, "watchdog.safe_force_kn": 77.0}


@pytest.fixture(scope="module")
def shipped_text():
    return (resources.files("fsw_machine") / "machine.yaml").read_text()


@pytest.fixture(scope="module")
def secured(tmp_path_factory, shipped_text):
    """Machine file parts with certificates, a user and other units."""
    folder = tmp_path_factory.mktemp("certificates")
    machine_server.make_certificates(folder)
    names = {"certificate": "client.der", "private_key": "client_key.pem", "server_certificate": "server.der"}
    (folder / "password").touch(0o600)
    (folder / "password").write_text("stir")
    security = {"policy": "Basic256Sha256"} | {key: str(folder / name) for key, name in names.items()}
    units = {f"nodes__{name}__unit": unit for name, unit in OTHER_UNITS.items()}
    return folder, {"security": security, "user": {"name": "fsw", "password_file": str(folder / "password")}} | units


@pytest.fixture(scope="module")
def chain(tmp_path_factory, shipped_text, secured):
    """Everything, with security and SI units, and a proxy between gateway and machine."""
    folder = tmp_path_factory.mktemp("weld")
    keys, parts = secured
    port = free_port()
    machine = RunningMachine(
        write_machine_file(folder / "server.yaml", port, shipped_text, **parts), keys / "server_key.pem"
    )
    proxy = Proxy(port)
    file = write_machine_file(folder / "machine.yaml", proxy.port, shipped_text, **parts)
    with free_domain() as domain, Launcher(folder / "log", domain, PATIENCE_S) as launcher:
        weld = MachineWeld(domain, launcher, machine, file)
        weld.proxy = proxy
        weld.start(*GRAPH)
        yield weld
        weld.close()
        codes = launcher.stop()
        proxy.stop()
        machine.stop()
        assert set(codes.values()) == {0}, codes


@pytest.fixture
def weld(chain):
    """The chain with all parts running; afterwards no command has been a bump."""
    for name in GRAPH:
        if not chain.launcher.children[name].running:
            chain.start(name)
    chain.runs()
    chain.until(lambda: abs(chain.temperature_c() - weld_numbers.TEMPERATURE_C) < 15.0, "the process to settle")
    first = len(chain.taken())
    yield chain
    chain.runs(more=3)
    chain.assert_no_bump(first)


@pytest.fixture(scope="module")
def desk(chain):
    """The alarms of the operator's page, in this graph."""
    watch = Watch(chain.node, lambda rows, restarted: None, lambda plan: None, lambda: None)
    return AlarmDesk(chain.node, watch, defaults(load("fsw_hmi", "hmi.yaml")).__getitem__)


def until_alarm(weld, desk, name, state, text=""):
    """Judge until the operator's page shows an alarm, in a state and with a text."""

    def is_so():
        desk.judge()
        entry = desk.list.entries.get(name)
        return entry is not None and entry.state == state and text in entry.alarm.text

    weld.until(is_so, f"{name} {state}")


def until_reached(weld, desk):
    """Judge until the operator's page says that commands reach the machine, which no alarm then denies."""

    def is_so():
        desk.judge()
        return desk.frame()["reach"]["ok"]

    weld.until(is_so, "commands to reach the machine")


@pytest.mark.requirement("S17")
def test_operator_is_told_that_commands_do_not_reach_the_machine_and_why(weld, desk):
    until_reached(weld, desk)
    weld.machine.do(lambda server: setattr(server, "permissive", False))
    until_alarm(weld, desk, "machine", "active", "Commands do not reach the machine: it does not permit them")
    assert desk.frame()["reach"]["ok"] is False
    weld.machine.do(lambda server: setattr(server, "permissive", True))
    until_alarm(weld, desk, "machine", "cleared")
    weld.proxy.cut()
    weld.proxy.stall()
    until_alarm(weld, desk, "machine", "active", "Commands do not reach the machine: ")
    assert "permit" not in desk.list.entries["machine"].alarm.text
    weld.proxy.flow()
    until_alarm(weld, desk, "machine", "cleared")
    weld.runs()
    until_reached(weld, desk)


@pytest.mark.requirement("S17")
def test_operator_is_told_of_a_foreign_writer(weld, desk):
    rogue = weld.node.create_publisher(WeldCommand, "fsw/command", 10)

    def command():
        rogue.publish(WeldCommand(header=weld.depths[-1].header, source="rogue", healthy=True))

    timer = weld.node.create_timer(0.1, command)  # supervisor and gateway hear it once they have found it
    until_alarm(weld, desk, "foreign", "active")
    weld.node.destroy_timer(timer)
    weld.node.destroy_publisher(rogue)
    until_alarm(weld, desk, "foreign", "cleared")


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
    weld.until(lambda: temperature() == pytest.approx(weld.temperature_c(), abs=2.0), "the temperature")


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.full)])
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
@pytest.mark.parametrize("name", ["supervisor", "gateway"])
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
    weld.until(lambda: int(weld.value("commands", "refused: not_permissive")) > 0, "commands refused")
    weld.machine.do(lambda server: setattr(server, "permissive", True))
    weld.runs()


@pytest.mark.requirement("S15")
def test_the_machines_clock_is_set(weld):
    """By minutes, forwards and back: the stamps go on, and the weld with them."""
    for offset_s in (300.0, -300.0):
        weld.machine.do(lambda server, s=offset_s: setattr(server, "clock_offset_ns", round(s * 1e9)))
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


@pytest.mark.requirement("S14")
@pytest.mark.full
def test_the_machine_is_started_again(tmp_path, shipped_text, domain_id):
    """The server as a process of its own, killed and ended: its counter begins again, and so does the weld."""
    file = write_machine_file(tmp_path / "machine.yaml", free_port(), shipped_text)
    with Launcher(tmp_path / "log", domain_id) as launcher:
        weld = MachineWeld(domain_id, launcher, None, file)
        weld.start("server", *GRAPH)
        for times, number in enumerate((signal.SIGKILL, signal.SIGTERM)):
            weld.until_report("writes", "taken")
            weld.end("server", number)
            weld.until_report("machine", "not connected")
            weld.start("server")
            weld.until(lambda goal=times + 1: int(weld.value("machine", "counter went back")) == goal, "the counter")
            count = int(weld.value("writes", "written"))
            weld.until(lambda least=count + 5: int(weld.value("writes", "written")) > least, "commands written")
        weld.close()


def test_a_machine_file_that_is_wrong_is_refused_in_one_line(tmp_path, shipped_text, domain_id):
    file = write_machine_file(tmp_path / "machine.yaml", 4840, shipped_text, nodes__depth__unit="inch")
    with Launcher(tmp_path / "log", domain_id) as launcher:
        weld = MachineWeld(domain_id, launcher, None, file)
        weld.start("gateway")
        child = launcher.children["gateway"]
        assert child.process.wait(PATIENCE_S) == 2
        text = child.text().strip()
        assert "nodes.depth.unit is 'inch'; one of mm" in text and "\n" not in text
        weld.close()
