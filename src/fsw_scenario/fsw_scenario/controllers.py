"""Controllers by name: ours, those of installed packages, and those in a user's module or file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from runpy import run_path
from typing import Any

from fsw_control.contract import Controller
from fsw_control.parameters import NodeParameters, ParameterModel, validate
from fsw_control.schema.models import InputError
from fsw_scenario.scenario import Scenario
from fsw_scenario.timeline import OpenLoopController

#: location of our classes, by name. They are entry points, too; other packages cannot replace
#: them.
OURS = {"decentral": "fsw_decentral:DecentralController", "nmpc": "fsw_nmpc:NmpcController"}


def installed() -> dict[str, str]:
    """Ours, and the entry points ``name = module:Class`` of installed packages."""
    return {
        point.name: point.value for point in metadata.entry_points(group="fsw.controllers")
    } | OURS


#: All that are known by their name.
KNOWN = installed()


def name_of(label: str) -> str:
    """Name of the controller in a label, see :func:`make`.

    A class given as ``MODULE:CLASS`` or ``FILE.py:CLASS`` is known by its name afterwards.

    Raises
    ------
    fsw_control.schema.models.InputError
        If there is no such controller.
    """
    return _parts(label)[0]


def short(label: str) -> str:
    """Label without module or file of the class; errors as in :func:`name_of`."""
    return ":".join(filter(None, _parts(label)))


def _parts(label: str) -> tuple[str, str]:
    """Name and variant in a label."""
    first, _, rest = label.partition(":")
    if first in KNOWN:
        return first, rest
    word, _, variant = rest.partition(":")
    if not word:
        known = (
            f"available: {', '.join(sorted(KNOWN))}; "
            "or name your own as MODULE:CLASS or FILE.py:CLASS"
        )
        raise InputError(f"controller {label or '(no name)'} is not available; {known}")
    # absolute, so that a process started in another folder finds the file
    place = f"{Path(first).resolve() if first.endswith('.py') else first}:{word}"
    name = str(class_at(place).name)
    if KNOWN.setdefault(name, place) != place:
        raise InputError(
            f"controller {place}: its name {name!r} is that of {KNOWN[name]}; give it another one"
        )
    return name, variant


@cache
def class_at(place: str) -> Any:
    """The class at a place, ``MODULE:CLASS`` or ``FILE.py:CLASS``; errors as :func:`name_of`."""
    module, _, kind = place.rpartition(":")
    if module.endswith(".py") and not Path(module).is_file():
        raise InputError(f"controller {place} is not available: there is no file {module}")
    try:
        candidate = (
            run_path(module).get(kind)
            if module.endswith(".py")
            else getattr(import_module(module), kind, None)
        )
    except Exception as error:  # a user's file may fail in any way
        raise InputError(f"controller {place} is not available: {_words(error)}") from None
    if not callable(candidate) or not isinstance(getattr(candidate, "name", None), str):
        raise InputError(
            f"controller {place} is not available: no class {kind} there with an attribute 'name'"
        )
    if not re.fullmatch(r"[a-zA-Z]\w*", candidate.name, re.ASCII):
        raise InputError(
            f"controller {place}: its name {candidate.name!r} has other characters "
            "than letters, digits, _"
        )
    return candidate


def _words(error: Exception) -> str:
    return str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"


def described_in(label: str) -> ParameterModel:
    """Model of a controller's parameters; errors as in :func:`name_of`."""
    model: Any = getattr(kind_of(label), "parameters", None)
    if model is None or (isinstance(model, type) and issubclass(model, NodeParameters)):
        return model
    raise InputError(f"controller {label}: its parameters are no class of NodeParameters")


def kind_of(label: str) -> Any:
    """Class of a controller, by label; errors as :func:`name_of`."""
    return class_at(KNOWN[name_of(label)])


def source_of(label: str) -> bytes:
    """Source file of a controller that is not ours, else empty; errors as in :func:`name_of`."""
    name = name_of(label)
    module = KNOWN[name].rpartition(":")[0]
    file = module if module.endswith(".py") else getattr(find_spec(module), "origin", None)
    return b"" if name in OURS or file is None else Path(file).read_bytes()


def program(name: str) -> tuple[str, tuple[str, ...]]:
    """Node (entry point in ``fsw.nodes``) and arguments that run a known controller."""
    if name in OURS or name == OpenLoopController.name:
        return name, ()
    return "controller", (KNOWN[name_of(name)],)


def make(label: str, parameters: Mapping[str, Any] | None = None) -> Controller:
    """Create a controller.

    Parameters
    ----------
    label : str
        Name, ``MODULE:CLASS`` or ``FILE.py:CLASS``, optionally followed by ``:variant``, one of
        its documented tunings, e.g. ``decentral:tight``.
    parameters : mapping of str to value, optional
        Parameters of the controller's node, by name; others have their default.

    Raises
    ------
    fsw_control.schema.models.InputError
        If there is no such controller or variant, or it rejects its parameters.
    """
    make_one = maker(label)
    try:
        values = validate(described_in(label), with_variant(label, parameters or {}))
        made = make_one(values)
    except InputError:
        raise
    except Exception as error:  # a user's class may fail in any way
        raise InputError(f"controller {label}: {_words(error)}") from None
    lacking = [name for name in ("tolerated_sensors", "step", "reset") if not hasattr(made, name)]
    if lacking:
        raise InputError(f"controller {label}: it has no {', '.join(lacking)}")
    return made


def maker(label: str) -> Callable[[dict[str, Any]], Controller]:
    """Function from a controller's parameters (or {}) to the controller; raises as `name_of`."""
    kind: Callable[..., Controller] = kind_of(label)
    return kind if described_in(label) is not None else lambda _: kind()


def variant_of(label: str) -> dict[str, str]:
    """Parameter set by the variant in a label, see :func:`make`; empty without variant."""
    (_, variant), parameter = _parts(label), getattr(kind_of(label), "variant", None)
    if not variant:
        return {}
    if not isinstance(parameter, str):
        raise InputError(f"controller {label}: it has no variants")
    return {parameter: variant}


def with_variant(label: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters, and the one set by the variant in a label.

    Raises
    ------
    fsw_control.schema.models.InputError
        As in :func:`variant_of`, and if a parameter contradicts the variant.
    """
    variant = variant_of(label)
    for name, value in variant.items():
        if parameters.get(name, value) != value:
            raise InputError(
                f"controller {label}: its variant is {name}={value}, which contradicts the "
                f"parameter {name}={parameters[name]}"
            )
    return {**parameters, **variant}


def variants_of(labels: Iterable[str]) -> dict[str, dict[str, str]]:
    """Result of :func:`variant_of` for each controller of a graph, by its name.

    Raises
    ------
    fsw_control.schema.models.InputError
        As in :func:`variant_of`, and if a controller is named twice: it is one node.
    """
    variants: dict[str, dict[str, str]] = {}
    for label in labels:
        if (name := name_of(label)) in variants:
            raise InputError(f"controller {name} is named twice; it is one node, with one tuning")
        variants[name] = variant_of(label)
    return variants


def make_all(
    scenario: Scenario, label: str, parameters: Mapping[str, Mapping[str, Any]]
) -> dict[str, Controller]:
    """Create the controllers of a scenario; the one in ``label`` in its variant.

    Errors as in :func:`make`, and InputError if ``label`` is not a controller of the scenario.
    """
    name = "" if scenario.open_loop else name_of(label)
    if name and name not in scenario.controllers:
        raise InputError(
            f"{scenario.name}: {name} is not among its controllers, "
            f"{', '.join(scenario.controllers)}"
        )
    variants = {other: label if other == name else other for other in scenario.controllers}
    return {other: make(variant, parameters.get(other)) for other, variant in variants.items()}
