"""What the operator is told of a weld at the emulated machine."""

import signal

import pytest

from fsw_control.parameters import defaults
from fsw_hmi.alarm_desk_ros import AlarmDesk
from fsw_hmi.parameters import HmiParameters
from fsw_hmi.watch_ros import Watch
from fsw_msgs.msg import WeldCommand


@pytest.fixture
def desk(weld):
    """The alarms of the operator's page, in this graph."""
    watch = Watch(weld.node, *[lambda *_: None] * 2)
    return AlarmDesk(weld.node, watch, defaults(HmiParameters).__getitem__)


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
    until_alarm(
        weld,
        desk,
        "machine",
        "active",
        "Commands do not reach the machine: it does not permit them",
    )
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
@pytest.mark.full
def test_operator_is_told_of_a_foreign_writer(weld, desk):
    rogue = weld.node.create_publisher(WeldCommand, "fsw/command", 10)
    weld.until(lambda: weld.depths, "a depth")

    def command():
        rogue.publish(WeldCommand(header=weld.depths[-1].header, source="rogue", healthy=True))

    timer = weld.node.create_timer(
        0.1, command
    )  # supervisor and gateway hear it once they have found it
    until_alarm(weld, desk, "foreign", "active")
    weld.node.destroy_timer(timer)
    weld.node.destroy_publisher(rogue)
    until_alarm(weld, desk, "foreign", "cleared")


@pytest.mark.requirement("S17")
def test_operator_is_told_that_the_gateway_has_died(weld, desk):
    until_reached(weld, desk)
    weld.end("gateway", signal.SIGKILL)
    until_alarm(weld, desk, "measurements", "active", "No measurements: the drives are silent")
    assert desk.frame()["reach"]["ok"] is False
    weld.start("gateway")
    until_alarm(weld, desk, "measurements", "cleared")
    until_reached(weld, desk)
