"""What the programs that keep the clock tell, as they write it."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import pytest

from fsw_recorder.clock_source import UNKNOWN, ClockState, clock_state

CHRONY = "C0A80101,ntp.cell.example,2,1764072000.1,-0.000012345,0.0,0.0,1.2,0.1,0.2,0.004,0.0005,64.2,Normal\n"
PTP = """sending: GET TIME_STATUS_NP
	90e2ba.fffe.1a2b3c-0 seq 0 RESPONSE MANAGEMENT TIME_STATUS_NP
		master_offset              -37
		ingress_time               1764072000000000000
		gmPresent                  true
		gmIdentity                 90e2ba.fffe.20c7f8
"""


def timex(offset: int, status: int) -> bytes:
    return struct.pack("@IqqqqI", 0, offset, 0, 5000, 120, status) + bytes(200)


def state(
    chrony: str | None = None, ptp: str | None = None, kernel: bytes | None = None
) -> ClockState:
    def ask(command: Sequence[str]) -> str | None:
        return {"chronyc": chrony, "pmc": ptp}[command[0]]

    return clock_state(ask, lambda: kernel)


def test_chrony() -> None:
    found = state(CHRONY, PTP, timex(0, 0))
    assert (
        found.source == "chrony"
        and found.synchronized
        and found.offset_s == pytest.approx(12.345e-6)
    )
    assert found.error_s == pytest.approx(0.0025) and found.words.split(", ") == [
        "chrony: ntp.cell.example",
        "stratum 2",
        "Normal",
    ]


def test_chrony_without_a_source() -> None:
    found = state("00000000,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised\n")
    assert (found.source, found.synchronized, found.offset_s) == ("chrony", False, None)


def test_ptp() -> None:
    found = state(None, PTP)
    assert (found.source, found.synchronized) == ("ptp", True) and found.offset_s == pytest.approx(
        37e-9
    )
    assert "90e2ba.fffe.20c7f8" in found.words
    assert state(None, PTP.replace("true", "false")).synchronized is False


@pytest.mark.parametrize(
    ("kernel", "expected"),
    [
        (timex(-2500, 0x2001), (True, 2.5e-6)),
        (timex(2500, 0x0001), (True, 2.5e-3)),
        (timex(0, 0x0040), (False, None)),
    ],
)
def test_kernel(kernel: bytes, expected: tuple[bool, float | None]) -> None:
    found = state(None, None, kernel)
    assert found.source == "kernel" and (found.synchronized, found.offset_s) == (
        expected[0],
        expected[1] and pytest.approx(expected[1]),
    )


@pytest.mark.parametrize("text", ["", "506 Cannot talk to daemon\n", ",".join("x" * 14)])
def test_what_tells_nothing_is_unknown(text: str) -> None:
    assert state(text, text) == UNKNOWN


def test_on_this_machine_it_is_one_of_them() -> None:
    assert clock_state().source in ("chrony", "ptp", "kernel", "unknown")
