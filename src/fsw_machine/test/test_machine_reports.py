"""What the gateway says of itself on /diagnostics."""

import pytest

from fsw_control.reports_ros import ERROR, OK, WARN
from fsw_machine import gateway_reports_ros as reports
from fsw_machine.gateway import Gateway


@pytest.fixture
def gateway(machine, parameters):
    made = Gateway(machine, parameters)
    made.on_connected()
    return made


@pytest.mark.parametrize(
    ("skew_s", "stamps", "level"),
    [
        (0.1, "source", OK),
        (-0.6, "source", WARN),
        (61.0, "source", ERROR),
        (-61.0, "received", WARN),
    ],
)
def test_the_difference_of_the_clocks(gateway, parameters, read_of, skew_s, stamps, level):
    read = read_of(1)
    object.__setattr__(read, "read_ns", read.source_ns - round(skew_s * 1e9))
    gateway.on_read(read)
    report = reports.clock(gateway, parameters | {"clock.stamps": stamps})
    assert report.level == level
    assert report.what.data["skew_s"] == pytest.approx(skew_s)


def test_clock_step_is_reported(gateway, parameters, read_of):
    gateway.on_read(read_of(1))
    late = read_of(2)
    gateway.on_read(read_of(2, source_ns=late.source_ns + 10**10))
    assert reports.clock(gateway, parameters).level == WARN
    assert gateway.stamps.shift_ns == -(10**10)


def test_the_machine(gateway, read_of):
    assert reports.machine(gateway, 0.0, 0, 0).level == WARN
    gateway.on_read(read_of(1))
    assert reports.machine(gateway, 0.0, 0, 0).level == OK
    assert (
        reports.machine(gateway, 0.0, 0, 0).values["permissive"] is True
    )  # as the operator's page reads it
    stands = reports.machine(gateway, 0.7, 0, 0)
    assert (stands.code, stands.what.data["time_s"]) == ("stalled", 0.7)
    gateway.on_read(read_of(2, depth=None))
    invalid = reports.machine(gateway, 0.0, 0, 0)
    assert invalid.code == "invalid"
    assert [fault.data["name"] for fault in invalid.what.data["faults"]] == ["depth"]
    gateway.on_read(read_of(3, permissive=False))
    assert reports.machine(gateway, 0.0, 0, 0).level == WARN
    assert reports.machine(gateway, 0.0, 0, 0).values["permissive"] is False
    gateway.on_lost()
    assert reports.machine(gateway, 0.0, 0, 0).level == ERROR


def test_writes(gateway):
    assert reports.writes(gateway, 0, 0.0).level == OK
    gateway.last_failure = "refused"
    assert reports.writes(gateway, 2, 0.1).level == ERROR
    assert reports.connection("opc.tcp://plc:4840", False, "why", 1, 2, 4.0).words == "why"
