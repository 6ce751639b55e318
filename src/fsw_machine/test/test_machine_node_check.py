"""Types of the server's nodes against the machine file and the limits."""

from datetime import datetime
from types import SimpleNamespace

import pytest
from asyncua import ua

from fsw_control.contract import Limits
from fsw_machine.machine_file import MachineFile
from fsw_machine.node_check import LinkError, check_clock, check_nodes, epoch_ns
from fsw_machine.opcua_link import node_id

KINDS = {"cycle": "UInt32", "heartbeat": "UInt32", "permissive": "Boolean"}


class Nodes:
    """A server whose nodes have the given types; the others hold floating-point numbers."""

    def __init__(self, nodes, **kinds):
        kinds = KINDS | kinds
        self._kinds = {
            node: ua.VariantType[kinds.get(name, "Double")] for name, node in nodes.items()
        }
        self.uaclient = SimpleNamespace(read=self._read)

    async def _read(self, parameters):
        return [
            ua.DataValue(self._answer(node.AttributeId, self._kinds[node.NodeId]))
            for node in parameters.NodesToRead
        ]

    def _answer(self, attribute, kind):
        if attribute == ua.AttributeIds.UserAccessLevel:
            return ua.Variant(3, ua.VariantType.Byte)
        if attribute == ua.AttributeIds.DataType:
            return ua.Variant(ua.NodeId(kind.value))
        return ua.Variant(
            kind is ua.VariantType.Boolean if kind is ua.VariantType.Boolean else 1, kind
        )


def check(shipped_text, changes, **kinds):
    text = shipped_text
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    machine = MachineFile.parse(text)
    nodes = {name: node_id(spec, 2) for name, spec in machine.nodes.given.items()}
    with pytest.raises(
        StopIteration
    ):  # it waits for nothing; another test's event loop may be running here
        check_nodes(Nodes(nodes, **kinds), machine, nodes, Limits()).send(None)


@pytest.mark.parametrize(
    ("changes", "kinds", "words"),
    [
        (
            {},
            {"force_setpoint": "Int32"},
            r"nodes\.force_setpoint: .* Int32, .* 1 kN",
        ),
        ({}, {"force_in_force": "Int32"}, r"nodes.force_in_force: .* steps of 1 kN"),
        (
            {"ForceSetpoint, unit: kN": "ForceSetpoint, unit: N"},
            {"force_setpoint": "Int16"},
            "32767, and the limits need",
        ),
        (
            {"SpeedSetpoint, unit: rpm": "SpeedSetpoint, unit: rad/s"},
            {"speed_setpoint": "UInt16"},
            "steps of 9.5",
        ),
        ({}, {"speed_acting": "Byte"}, "nodes.speed_acting: .* ends at 0 and 255"),
        (
            {"SpeedSetpoint, unit: rpm": "SpeedSetpoint, unit: rpm, scale: -1"},
            {"speed_setpoint": "UInt16"},
            "need -",
        ),
        ({}, {"depth": "Int16"}, "nodes.depth: .* has steps of 1 mm"),
        ({}, {"torque": "Byte"}, "nodes.torque: .* ends at 0 and 255"),
        (
            {"Temperature, unit: degC": "Temperature, unit: degC, scale: 0.01"},
            {"temperature": "Int16"},
            "32767, and",
        ),
    ],
)
def test_whole_numbers_that_do_not_hold_every_set_point_are_refused(
    shipped_text, changes, kinds, words
):
    with pytest.raises(LinkError, match=words):
        check(shipped_text, changes, **kinds)


@pytest.mark.parametrize(
    ("changes", "kinds"),
    [
        ({}, {"force_setpoint": "Float", "speed_setpoint": "Int16", "speed_in_force": "UInt16"}),
        ({"Depth, unit: mm": "Depth, unit: mm, scale: 0.001"}, {"depth": "UInt16"}),
        ({"ForceSetpoint, unit: kN": "ForceSetpoint, unit: N"}, {"force_setpoint": "Int32"}),
        (
            {"ForceSetpoint, unit: kN": "ForceSetpoint, unit: kN, scale: 0.01"},
            {"force_setpoint": "Int16"},
        ),
        (
            {"Depth, unit: mm": "Depth, unit: um"},
            {"depth": "Int16", "torque": "Int16", "temperature": "UInt16"},
        ),
    ],
)
def test_whole_numbers_that_are_fine_enough(shipped_text, changes, kinds):
    check(shipped_text, changes, **kinds)


def test_clock_outside_1970_to_2038_is_reported():
    check_clock(0)
    for year, source in ((1601, datetime(1601, 1, 1)), (2040, datetime(2040, 1, 1))):
        with pytest.raises(LinkError, match=rf"year {year}; .* clock\.stamps: received"):
            check_clock(epoch_ns(source))
