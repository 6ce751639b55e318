"""State of the system's clock, and its error."""

from __future__ import annotations

import ctypes
import struct
from contextlib import suppress
from typing import Literal

from fsw_control.schema.models import Model

#: `struct timex` of Linux (64 bit) up to the status: modes, offset, frequency, largest and
#: estimated error, status
_TIMEX = struct.Struct("@IqqqqI")
_TIMEX_BYTES = 512
#: status bits, `<sys/timex.h>`
_UNSYNCHRONIZED, _IN_NANOSECONDS = 0x0040, 0x2000


class ClockState(Model):
    """State of the system's clock as reported by the kernel."""

    source: Literal["chrony", "ptp", "kernel", "unknown"]
    """kernel: adjtimex, to which chrony, ntpd and phc2sys report; others: older recorders"""
    synchronized: bool | None = None
    """none: unknown"""
    offset_s: float | None = None
    """estimated size of the offset from the source"""
    error_s: float | None = None
    """bound of the error, given by the source"""
    words: str
    """text for people"""


UNKNOWN = ClockState(source="unknown", words="the kernel does not report on its clock")


def clock_state() -> ClockState:
    """Ask the kernel."""
    timex = _adjtimex()
    if timex is None:
        return UNKNOWN
    _, offset, _, largest, estimated, status = _TIMEX.unpack_from(timex)
    if status & _UNSYNCHRONIZED:
        return ClockState(
            source="kernel", synchronized=False, words="the kernel's clock is not synchronized"
        )
    return ClockState(
        source="kernel",
        synchronized=True,
        offset_s=abs(offset) * (1e-9 if status & _IN_NANOSECONDS else 1e-6),
        error_s=largest * 1e-6,
        words=f"the kernel's clock is synchronized, error estimated as {estimated} µs",
    )


def _adjtimex() -> bytes | None:
    buffer = ctypes.create_string_buffer(_TIMEX_BYTES)
    with suppress(OSError, AttributeError):
        if ctypes.CDLL(None).adjtimex(buffer) >= 0:  # modes 0: only reads
            return buffer.raw
    return None
