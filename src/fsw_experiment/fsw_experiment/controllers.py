"""Makes controllers by name, for runs in one process."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from fsw_control.contract import Controller
from fsw_control.parameters import ParameterError, load, validate
from fsw_experiment.open_loop import OpenLoopController
from fsw_experiment.scenario import Scenario, ScenarioError

#: Controller name: module, class, parameter file, and the parameter that a ``:variant`` sets.
KNOWN: dict[str, tuple[str, str, str, str]] = {
    "decentral": ("fsw_decentral", "DecentralController", "decentral.yaml", "tuning"),
    "nmpc": ("fsw_nmpc", "NmpcController", "nmpc.yaml", "preset"),
}
#: Controller name: module with the ``main`` of its node; in ROS 2 it is the program of that name of its package.
CONTROLLER_MODULES = {
    **{name: f"{package}.{name}_node" for name, (package, *_) in KNOWN.items()},
    OpenLoopController.name: "fsw_experiment.open_loop_node",
}


def make(label: str, parameters: Mapping[str, Any] | None = None) -> Controller:
    """Make a controller.

    Parameters
    ----------
    label : str
        Name, or ``name:variant`` with one of its documented tunings, e.g. ``decentral:tight``.
    parameters : mapping of str to value, optional
        Of the controller's node, by name; the others have their defaults.

    Raises
    ------
    ScenarioError
        When there is no such controller or variant here.
    """
    name = label.partition(":")[0]
    if name not in KNOWN:
        raise ScenarioError(f"controller {name} is not available; available: {', '.join(KNOWN)}")
    package, kind, file, _ = KNOWN[name]
    try:
        values = validate(load(package, file), {**(parameters or {}), **variant_of(label)})
        made: Controller = getattr(import_module(package), kind)(values)
    except (ParameterError, ValueError) as error:
        raise ScenarioError(f"controller {label}: {error}") from None
    return made


def variant_of(label: str) -> dict[str, str]:
    """The parameter that the variant of a label of :func:`make` sets; none without variant."""
    name, _, variant = label.partition(":")
    return {KNOWN[name][3]: variant} if variant else {}


def make_all(scenario: Scenario, label: str, parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, Controller]:
    """Make the controllers of a scenario by name, the one that ``label`` names in that variant.

    Parameters
    ----------
    scenario : Scenario
    label : str
        As of :func:`make`.
    parameters : mapping of str to mapping
        By name of the controller.

    Raises
    ------
    ScenarioError
        As :func:`make`.
    """
    name = label.partition(":")[0]
    variants = {other: label if other == name else other for other in scenario.controllers}
    return {other: make(variant, parameters.get(other)) for other, variant in variants.items()}
