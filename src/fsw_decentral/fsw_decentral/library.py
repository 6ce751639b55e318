"""Binding of the controller library (``kernel/fsw_decentral.h``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fsw_control.c_library import CController, CLibrary

KERNEL = CLibrary("fsw_decentral", Path(__file__).parent / "kernel")
Reason = KERNEL.enum("fsw_decentral_reason", "FSW_DECENTRAL_")
Limit = KERNEL.enum("fsw_decentral_limit", "FSW_DECENTRAL_")
_UNUSABLE = (
    "limits, friction, spindle_inertia, nominal_torque and blind_limit "
    "must be finite and in their ranges"
)


def make(tuning: Any) -> CController:
    """A controller with a ``fsw_decentral_tuning *``; raises as :class:`.CController`."""
    return CController(KERNEL, None, _UNUSABLE, tuning)


def check(tuning: Any) -> None:
    """Raise ValueError if the library rejects a tuning."""
    if not KERNEL.lib.fsw_decentral_is_usable(tuning):
        raise ValueError(_UNUSABLE)
