"""Makes controllers by name, for runs in one process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from fsw_control.contract import Controller
from fsw_control.parameters import ParameterError, load, validate
from fsw_experiment.scenario import ScenarioError

#: Controller name: module, class, parameter file, and the parameter that a ``:variant`` sets.
KNOWN: dict[str, tuple[str, str, str, str]] = {
    "decentral": ("fsw_decentral", "DecentralController", "decentral.yaml", "tuning"),
    "nmpc": ("fsw_nmpc", "NmpcController", "nmpc.yaml", "preset"),
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
    if name not in KNOWN or find_spec(KNOWN[name][0]) is None:
        available = [known for known, (package, *_) in KNOWN.items() if find_spec(package) is not None]
        raise ScenarioError(f"controller {name} is not available; available: {', '.join(available)}")
    package, kind, file, choice = KNOWN[name]
    factory: Callable[[dict[str, object]], Controller] | None = getattr(import_module(package), kind, None)
    if factory is None:
        raise ScenarioError(f"controller {name} is not available: package {package} has no {kind}")
    try:
        return factory(validate(load(package, file), {**(parameters or {}), **({choice: variant} if variant else {})}))
    except (ParameterError, ValueError) as error:
        raise ScenarioError(f"controller {label}: {error}") from None
