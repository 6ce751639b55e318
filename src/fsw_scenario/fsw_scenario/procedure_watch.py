"""Detects when a weld leaves its procedure: set-points, controller, mode, swaps, tuning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_analysis.procedure import Procedure, tuning_sha256
from fsw_control.cause import Cause


class ProcedureWatch:
    """Deviations of a weld from its procedure, each with a name and a text."""

    def __init__(self, procedure: Procedure) -> None:
        self._procedure = procedure
        self._permitted = {one.name: one.parameters_sha256 for one in procedure.controllers}
        self._found: dict[str, str] = {}
        self._first = ""
        self._welds = False  # before automatic control has begun, hold is normal

    @property
    def deviations(self) -> dict[str, str]:
        """Present deviations, including those that cannot be undone."""
        return dict(self._found)

    def _set(self, name: str, text: str) -> None:
        if text:
            self._found[name] = text
        else:
            self._found.pop(name, None)

    def set_points(self, depth_mm: float, temperature_c: float) -> None:
        """Take the set-points in force."""
        for name, value in (("depth_mm", depth_mm), ("temperature_c", temperature_c)):
            point = getattr(self._procedure.set_points, name)
            inside = point.min <= value <= point.max
            text = (
                f"set-point {name} {value:g} is in force; "
                f"permitted: {point.min:g} to {point.max:g}"
            )
            self._set(f"set_point_{name}", "" if inside else text)

    def state(self, controller: str, mode: str, cause: Cause) -> None:
        """Take controller, mode and cause, as reported by the supervisor."""
        foreign = controller and controller not in self._permitted
        text = f"{controller} is in command; permitted: {', '.join(self._permitted)}"
        self._set("controller", text if foreign else "")
        self._welds = self._welds or mode == "auto"
        text = f"mode {mode} ({cause.words}) instead of auto"
        self._set("mode", text if self._welds and mode != "auto" else "")
        if not controller:
            return
        if not self._first:
            self._first = controller
        acceptance = self._procedure.acceptance
        if controller != self._first and not acceptance.permits_swap(cause):
            # kept: a swap back does not undo it
            self._found.setdefault(
                "swap", f"swap to {controller} ({cause.words}); permitted: {acceptance.swap_words}"
            )

    def tuning(self, controller: str, parameters: Mapping[str, Any]) -> None:
        """Take the present parameters of a controller's node."""
        wanted = self._permitted.get(controller)
        actual = tuning_sha256(parameters)
        text = (
            f"{controller} has parameters {actual[:12]}…, "
            f"the procedure wants {(wanted or '')[:12]}…"
        )
        self._set(f"tuning_{controller}", text if wanted is not None and actual != wanted else "")
