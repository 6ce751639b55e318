"""Makes controllers by name, for runs in one process."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from fsw_control.contract import Controller
from fsw_control.parameters import ParameterError, load, validate
from fsw_experiment.open_loop import OpenLoopController
from fsw_experiment.scenario import ScenarioError

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
    name, _, variant = label.partition(":")
    if name not in KNOWN:
        raise ScenarioError(f"controller {name} is not available; available: {', '.join(KNOWN)}")
    package, kind, file, choice = KNOWN[name]
    try:
        values = validate(load(package, file), {**(parameters or {}), **({choice: variant} if variant else {})})
        made: Controller = getattr(import_module(package), kind)(values)
    except (ParameterError, ValueError) as error:
        raise ScenarioError(f"controller {label}: {error}") from None
    return made
