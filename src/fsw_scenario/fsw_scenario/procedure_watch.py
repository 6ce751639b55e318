"""Detects when a weld leaves its procedure: set-points, controller, mode, swaps, tuning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_analysis.procedure import Procedure, tuning_sha256
from fsw_control.cause import Cause
from fsw_control.coded import Fact, Worded


class Deviation(Worded):
    """How a weld leaves its procedure."""

    SET_POINT = (
        "set_point",
        "set-point {quantity} {value:g} is in force; permitted: {low:g} to {high:g}",
    )
    CONTROLLER = "controller", "{controller} is in command; permitted: {permitted}"
    MODE = "mode", "mode {mode} ({cause.words}) instead of auto"
    SWAP = "swap", "swap to {controller} ({cause.words}); permitted: {permitted}"
    TUNING = (
        "tuning",
        "{controller} has parameters {sha256:.12}…, the procedure wants {wanted:.12}…",
    )
    LEAVES = "leaves", "{deviations}"
    KEEPS = "keeps", "no deviation"


class ProcedureWatch:
    """Deviations of a weld from its procedure, each with a name."""

    def __init__(self, procedure: Procedure) -> None:
        self._procedure = procedure
        self._permitted = {entry.name: entry.parameters_sha256 for entry in procedure.controllers}
        self._found: dict[str, Fact] = {}
        self._first = ""
        self._welds = False  # before automatic control has begun, hold is normal

    @property
    def deviations(self) -> dict[str, Fact]:
        """Present deviations, including those that cannot be undone."""
        return dict(self._found)

    @property
    def fact(self) -> Fact:
        """All deviations; the field ``names`` distinguishes those that have the same code."""
        if not self._found:
            return Fact.of(Deviation.KEEPS)
        deviations, names = tuple(self._found.values()), tuple(sorted(self._found))
        return Fact.of(Deviation.LEAVES, deviations=deviations, names=names)

    def _set(self, name: str, fact: Fact | None) -> None:
        if fact:
            self._found[name] = fact
        else:
            self._found.pop(name, None)

    def set_points(self, depth_mm: float, temperature_c: float) -> None:
        """Take the set-points in force."""
        for name, value in (("depth_mm", depth_mm), ("temperature_c", temperature_c)):
            point = getattr(self._procedure.set_points, name)
            inside = point.min <= value <= point.max
            data = {"quantity": name, "value": value, "low": point.min, "high": point.max}
            self._set(f"set_point_{name}", None if inside else Fact(Deviation.SET_POINT, data))

    def state(self, controller: str, mode: str, cause: Cause) -> None:
        """Take controller, mode and cause, as reported by the supervisor."""
        foreign = controller and controller not in self._permitted
        data = {"controller": controller, "permitted": tuple(self._permitted)}
        self._set("controller", Fact(Deviation.CONTROLLER, data) if foreign else None)
        self._welds = self._welds or mode == "auto"
        other = Fact.of(Deviation.MODE, mode=mode, cause=cause)
        self._set("mode", other if self._welds and mode != "auto" else None)
        if not controller:
            return
        if not self._first:
            self._first = controller
        acceptance = self._procedure.acceptance
        if controller != self._first and not acceptance.permits_swap(cause):
            # kept: a swap back does not undo it
            permitted = acceptance.swap_words
            swap = Fact.of(Deviation.SWAP, controller=controller, cause=cause, permitted=permitted)
            self._found.setdefault("swap", swap)

    def tuning(self, controller: str, parameters: Mapping[str, Any]) -> None:
        """Take the present parameters of a controller's node."""
        permitted = self._permitted.get(controller)
        actual = tuning_sha256(parameters)
        data = {"controller": controller, "sha256": actual, "wanted": permitted}
        other = (
            Fact(Deviation.TUNING, data) if permitted is not None and actual != permitted else None
        )
        self._set(f"tuning_{controller}", other)
