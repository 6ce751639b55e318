"""Which commands are a foreign writer's, where two nodes publish commands."""

from types import SimpleNamespace

import pytest

from fsw_control.coded import Fact
from fsw_control.command_gate import CommandGate, Rejection
from fsw_control.command_writers_ros import CommandWriters
from fsw_control.contract import Limits
from fsw_control.reports_ros import ERROR, OK, WARN, commands
from fsw_msgs.msg import SupervisorState

GATE = CommandGate(Limits(), 1.0)
GATE.refuse(Fact.of(Rejection.FUTURE, stamp_s=1.0))


@pytest.fixture
def node():
    """Without a graph; ``hear`` has who listens to the state of the supervisor."""
    fake = SimpleNamespace(hear=[])
    fake.create_subscription = lambda kind, topic, heard, qos: (
        fake.hear.append(heard) if kind is SupervisorState else None
    )
    return fake


@pytest.fixture
def writers(node):
    return CommandWriters(node, lambda: GATE, lambda: ())


def leads(node, leader):
    [hear] = node.hear
    hear(SupervisorState(term=1, leader=leader))


def refused(writers, *leaders):
    for leader in leaders:
        writers.note_refused(leader)
    return commands(GATE, len(leaders), ["one", "two"], writers.unauthorised())


def test_takeover_does_not_count_as_a_foreign_writer(node, writers):
    leads(node, "aaa")
    assert (
        refused(writers, "aaa", "bbb").level == WARN
    )  # bbb has begun to lead, its state is on its way
    leads(node, "bbb")
    assert refused(writers, "aaa", "bbb").level == WARN
    assert refused(writers).level == WARN
    assert commands(GATE, 1, ["one"], writers.unauthorised()).level == WARN
    assert commands(GATE, 0, ["one"], writers.unauthorised()).level == OK


def test_publishers_are_logged_once_and_by_name():
    published, logged = [], []
    node = SimpleNamespace(
        create_subscription=lambda kind, topic, heard, qos: None,
        get_publishers_info_by_topic=lambda topic: [
            SimpleNamespace(node_name=name) for name in published
        ],
        get_logger=lambda: SimpleNamespace(warning=logged.append),
    )
    writers = CommandWriters(node, lambda: GATE, lambda: ())
    for names in (
        ["one"],
        ["one", "_NODE_NAME_UNKNOWN_"],
        ["one", "two"],
        ["one"],
        ["one", "two"],
        ["one", "two"],
    ):
        published[:] = names
        writers.look()
        assert writers.names == sorted(names)
    assert (
        len(logged) == 1
        and logged[0].startswith("2 ")
        and logged[0].endswith("fsw/command: one, two")
    )
    published.append("three")
    writers.look()
    assert len(logged) == 2


@pytest.mark.requirement("S11")
def test_commands_that_no_supervisor_has_signed_are_a_foreign_writers(node, writers):
    leads(node, "aaa")
    assert refused(writers, "aaa", "").level == ERROR
    assert refused(writers).level == WARN


@pytest.mark.requirement("S11")
def test_signer_that_never_leads_is_a_foreign_writer(node, writers):
    leads(node, "aaa")
    assert [refused(writers, "forged").level for _ in range(3)] == [WARN, ERROR, ERROR]
