"""A weld of a scenario in this process, made from names, values and objects."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fsw_control.contract import Controller
from fsw_control.schema.models import InputError
from fsw_model.heat_profile import HeatProfile
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import KNOWN, make, make_all, name_of, short
from fsw_scenario.plants import Plant
from fsw_scenario.scenario_file import load, shipped

#: a scenario: its name, its file, or its content
Source = str | Path | Mapping[str, Any]
T = TypeVar("T")


def scenarios() -> list[str]:
    """Names of the shipped scenarios.

    Examples
    --------
    >>> import fsw
    >>> "reference_tracking" in fsw.scenarios()
    True
    """
    return shipped()


def controllers() -> list[str]:
    """Names of the installed controllers; each may have variants, e.g. ``nmpc:paper``.

    Examples
    --------
    >>> import fsw
    >>> fsw.controllers()
    ['decentral', 'nmpc']
    """
    return sorted(KNOWN)


def overrides_of(
    plant: Mapping[str, Any] | None, changes: Mapping[str, Any] | None, noise: bool | None
) -> list[str]:
    """Overrides for :func:`fsw_scenario.scenario_file.load` from values by path."""
    values = {
        **(changes or {}),
        **{f"plant.{name}": value for name, value in (plant or {}).items()},
    }
    if noise is not None:
        values["plant.noise"] = noise
    return [f"{name}={_as_text(str(name), value)}" for name, value in values.items()]


def _as_text(name: str, value: Any) -> str:
    def plain(other: Any) -> Any:
        if isinstance(other, np.generic | np.ndarray):
            return other.tolist()
        raise TypeError

    try:
        return json.dumps(value, default=plain)
    except (TypeError, ValueError):
        raise InputError(f"{name} is a number, text, list or mapping, not {value!r}") from None


def _copied(user_object: T, kind: str) -> T:
    """A copy for one weld, so that no weld sees what another one left in the object's memory."""
    try:
        return deepcopy(user_object)
    except Exception as error:  # e.g. a solver in C
        raise InputError(
            f"simulate: {kind} {type(user_object).__name__} cannot be copied: {error}; define "
            "__deepcopy__" + (", or give it by its name" if kind == "controller" else "")
        ) from None


def closed_loop(
    source: Source,
    controller: str | Controller | None,
    overrides: Sequence[str] = (),
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    heat: str | Path | None = None,
    plant: Plant | None = None,
) -> tuple[str, ClosedLoop]:
    """Label of a weld, and its simulation; see :func:`simulate`.

    ``overrides`` are those of :func:`fsw_scenario.scenario_file.load`, ``parameters`` by name of
    the controller. Of objects of a user's classes the weld has a copy.
    """
    own = None
    if not isinstance(controller, str | None):
        if isinstance(controller, type) or not hasattr(controller, "step"):
            raise InputError(
                "simulate: controller is a name or an object of a controller's class, "
                f"not {controller!r}"
            )
        own = _copied(controller, "controller")
    scenario = load(source, overrides)
    if scenario.open_loop and controller is not None:
        raise InputError(
            f"simulate: {scenario.name} is an open-loop scenario; it takes no controller"
        )
    known = None if heat is None else HeatProfile.from_file(heat)
    plant = None if plant is None else _copied(plant, "plant")
    if scenario.open_loop:
        return "open loop", ClosedLoop(scenario, {}, known, plant)
    label = scenario.controller if controller is None else own.name if own else str(controller)
    if controller is not None:
        name = label if own else name_of(label)
        scenario = load(source, [*overrides, f"controller={name}"])
    if own is not None:
        controllers = {name: own if name == label else make(name) for name in scenario.controllers}
        return label, ClosedLoop(scenario, controllers, known, plant)
    controllers = make_all(scenario, label, parameters or {})
    return short(label), ClosedLoop(scenario, controllers, known, plant)
