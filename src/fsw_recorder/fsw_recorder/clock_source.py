"""State of the system's clock: the source that it follows, and its error."""

from __future__ import annotations

import ctypes
import re
import struct
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Literal

from fsw_schema.models import Model
from fsw_schema.processes import tool_environment

#: time limit for a program's answer
_PATIENCE_S = 2.0
_CHRONY = ("chronyc", "-c", "tracking")
_PTP = ("pmc", "-u", "-b", "0", "GET TIME_STATUS_NP")
#: `struct timex` of Linux (64 bit) up to the status: modes, offset, frequency, largest and
#: estimated error, status
_TIMEX = struct.Struct("@IqqqqI")
_TIMEX_BYTES = 512
#: status bits, `<sys/timex.h>`
_UNSYNCHRONIZED, _IN_NANOSECONDS = 0x0040, 0x2000


class ClockState(Model):
    """State of the system's clock as reported by chrony, PTP or the kernel."""

    source: Literal["chrony", "ptp", "kernel", "unknown"]
    """kernel: from adjtimex, as in timedatectl"""
    synchronized: bool | None = None
    """none: unknown"""
    offset_s: float | None = None
    """estimated size of the offset from the source"""
    error_s: float | None = None
    """bound of the error, given by the source"""
    words: str
    """text for people"""


UNKNOWN = ClockState(source="unknown", words="nothing tells which source the clock follows")


def clock_state(
    ask: Callable[[Sequence[str]], str | None] | None = None,
    kernel: Callable[[], bytes | None] | None = None,
) -> ClockState:
    """Ask chrony, then PTP, then the kernel; may take seconds.

    ``ask`` runs a program and returns its output, ``kernel`` returns the kernel's `struct timex`;
    None if not available.
    """
    run, timex = ask or _run, kernel or _adjtimex
    return _chrony(run(_CHRONY) or "") or _ptp(run(_PTP) or "") or _kernel(timex()) or UNKNOWN


def _chrony(text: str) -> ClockState | None:
    """Parse ``chronyc -c tracking``: 14 values, separated by commas."""
    values = text.strip().split(",")
    if len(values) != 14:
        return None
    try:
        offset, delay, dispersion = abs(float(values[4])), float(values[10]), float(values[11])
    except ValueError:
        return None
    synchronized = values[13] != "Not synchronised" and values[0] not in ("", "00000000")
    name = (
        values[1] or bytes.fromhex(values[0]).decode("ascii", "replace")
        if synchronized
        else "no source"
    )
    return ClockState(
        source="chrony",
        synchronized=synchronized,
        offset_s=offset if synchronized else None,
        error_s=0.5 * delay + dispersion if synchronized else None,
        words=f"chrony: {name}, stratum {values[2]}, {values[13]}",
    )


def _ptp(text: str) -> ClockState | None:
    """Parse the output of linuxptp's ``pmc``."""
    offset = re.search(r"\bmaster_offset\s+(-?\d+)", text)
    present = re.search(r"\bgmPresent\s+(\w+)", text)
    identity = re.search(r"\bgmIdentity\s+(\S+)", text)
    if offset is None or present is None:
        return None
    synchronized = present[1] == "true"
    return ClockState(
        source="ptp",
        synchronized=synchronized,
        offset_s=abs(int(offset[1])) * 1e-9 if synchronized else None,
        words=f"ptp4l: grandmaster {identity[1] if identity and synchronized else 'none'}",
    )


def _kernel(timex: bytes | None) -> ClockState | None:
    if timex is None:
        return None
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
        words=(
            f"the kernel's clock is synchronized, error estimated as {estimated} µs; "
            "by what it does not tell"
        ),
    )


def _run(command: Sequence[str]) -> str | None:
    try:
        done = subprocess.run(
            command,
            env=tool_environment(),
            capture_output=True,
            text=True,
            timeout=_PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    return done.stdout if done.returncode == 0 else None


def _adjtimex() -> bytes | None:
    buffer = ctypes.create_string_buffer(_TIMEX_BYTES)
    with suppress(OSError, AttributeError):
        if ctypes.CDLL(None).adjtimex(buffer) >= 0:  # modes 0: only reads
            return buffer.raw
    return None
