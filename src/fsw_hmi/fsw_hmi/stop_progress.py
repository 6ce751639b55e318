"""Progress of a safe stop: whether the force follows the supervisor's ramp."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from math import isfinite, nan
from typing import Any

#: tolerated lag of the force behind its ramp [s], and distance from it [kN] (chosen)
_LATE_S = 2.0
_NEAR_KN = 1.0


class StopKind(StrEnum):
    """State of a safe stop."""

    FALLING = "falling"
    SAFE = "safe"
    NOT_FALLING = "not_falling"
    UNKNOWN = "unknown"  # neither ramp nor force can be compared


class StopProgress:
    """Follows one safe stop after the other, tick by tick."""

    def __init__(self) -> None:
        self._began: tuple[float, float] | None = None  # time and force

    def at(
        self, stopped: bool, values: Mapping[str, float], safe: Mapping[str, float] | None
    ) -> dict[str, Any] | None:
        """State at a tick, ready for JSON; None without a safe stop.

        Parameters
        ----------
        stopped : bool
            Whether the supervisor reports a safe stop.
        values : mapping of str to float
            Of the tick, with ``time_s`` and ``force_kn``.
        safe : mapping of str to float or None
            ``force_kn`` at which the ramp ends and its ``rate_kn_per_s``; None while they are not
            known.
        """
        time_s, force_kn = values.get("time_s", nan), values.get("force_kn", nan)
        measured = isfinite(time_s) and isfinite(force_kn)
        if not stopped:
            self._began = None
        elif measured and self._began is None:
            self._began = time_s, force_kn
        if self._began is None:
            return None
        if safe is None or not measured:
            return {"kind": StopKind.UNKNOWN}
        began_s, began_kn = self._began
        end_kn, rate = safe["force_kn"], safe["rate_kn_per_s"]
        due_kn = max(end_kn, began_kn - rate * max(0.0, time_s - began_s - _LATE_S)) + _NEAR_KN
        kind = StopKind.NOT_FALLING if force_kn > due_kn else StopKind.FALLING
        return {
            "kind": StopKind.SAFE if force_kn <= end_kn + _NEAR_KN else kind,
            "share": round(
                min(1.0, max(0.0, (began_kn - force_kn) / max(began_kn - end_kn, _NEAR_KN))), 4
            ),
            "safe_kn": end_kn,
            "due_kn": round(due_kn, 3),
            "left_s": round(max(0.0, (force_kn - end_kn) / rate), 1),
        }
