"""The state of the system's clock as the kernel reports it."""

from __future__ import annotations

import struct

import pytest

from fsw_recorder import manifest
from fsw_recorder.manifest import UNKNOWN, clock_state


def timex(offset: int, status: int) -> bytes:
    return struct.pack("@IqqqqI", 0, offset, 0, 5000, 120, status) + bytes(200)


@pytest.mark.parametrize(
    ("kernel", "expected"),
    [
        (timex(-2500, 0x2001), (True, 2.5e-6)),
        (timex(2500, 0x0001), (True, 2.5e-3)),
        (timex(0, 0x0040), (False, None)),
    ],
)
def test_kernel(
    kernel: bytes, expected: tuple[bool, float | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(manifest, "_adjtimex", lambda: kernel)
    state = clock_state()
    assert state.source == "kernel" and (state.synchronized, state.offset_s) == (
        expected[0],
        expected[1] and pytest.approx(expected[1]),
    )


def test_a_kernel_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manifest, "_adjtimex", lambda: None)
    assert clock_state() == UNKNOWN


def test_on_this_machine() -> None:
    assert clock_state().source in ("kernel", "unknown")
