"""Friction stir welding, simulated, controlled and analysed.

``import fsw`` loads next to nothing; modules are imported at their first use. Other distributions
add public names by entry points (``fsw.api``). The command line is in the same package, with a
module per command.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import fsw_scenario  # noqa: F401  (before numpy: it sets the number of linear algebra threads)

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from fsw.controller import Controller as Controller
    from fsw.processes import Model as Model
    from fsw.processes import model as model
    from fsw.simulation import controllers as controllers
    from fsw.simulation import scenarios as scenarios
    from fsw.welds import Comparison as Comparison
    from fsw.welds import Weld as Weld
    from fsw.welds import compare as compare
    from fsw.welds import read_bag as read_bag
    from fsw.welds import simulate as simulate
    from fsw_analysis.kpi_table import Kpi as Kpi
    from fsw_control.contract import Command as Command
    from fsw_control.contract import Limits as Limits
    from fsw_control.contract import Measurement as Measurement
    from fsw_control.contract import Proposal as Proposal
    from fsw_control.contract import Reference as Reference
    from fsw_control.schema.errors import InputError as InputError
    from fsw_scenario.plants import Outputs as Outputs
    from fsw_scenario.plants import Plant as Plant

__version__ = "0.3.0"
#: public names by module
_PLACES = {
    "fsw.controller": ("Controller",),
    "fsw.processes": ("Model", "model"),
    "fsw.simulation": ("controllers", "scenarios"),
    "fsw.welds": ("Comparison", "Weld", "compare", "read_bag", "simulate"),
    "fsw_analysis.kpi_table": ("Kpi",),
    "fsw_control.contract": ("Command", "Limits", "Measurement", "Proposal", "Reference"),
    "fsw_control.schema.errors": ("InputError",),
    "fsw_scenario.plants": ("Outputs", "Plant"),
}
MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}
__all__ = sorted(MODULE_OF)
#: folders of our other distributions, each with a package that adds names and commands
ELSEWHERE = ("lab", "quality")


def missing(points: Mapping[str, EntryPoint]) -> str:
    """Which other distributions of ours have no entry point of a group, to end an error."""
    here = {point.value.partition(".")[0] for point in points.values()}
    folders = [folder for folder in ELSEWHERE if f"fsw_{folder}" not in here]
    named = " and ".join(f"fsw-{folder}" for folder in folders)
    places = " ".join(f"./{folder}" for folder in folders)
    return f"; {named} can add it: pip install {places} in the repository" if folders else ""


def __getattr__(name: str) -> Any:
    if name in MODULE_OF:
        value = getattr(import_module(MODULE_OF[name]), name)
    else:
        added = import_module("fsw_control.schema.extensions")
        value = None if name.startswith("_") else added.loaded("fsw.api", name)
        if value is None:
            where = missing(added.extensions("fsw.api"))
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}{where}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    added = import_module("fsw_control.schema.extensions").extensions("fsw.api")
    return [*__all__, *added, "__version__"]
