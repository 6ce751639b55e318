"""Welds for Python: simulated, read from bags, compared."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fsw.arguments import validated
from fsw.simulation import Source, closed_loop, overrides_of
from fsw_analysis import kpi, kpi_table
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.kpi_table import Kpi
from fsw_analysis.weld_signals import Column, WeldSignals, export_weld, weld_table
from fsw_control.contract import Controller
from fsw_control.schema.extensions import Extra
from fsw_control.schema.models import InputError
from fsw_scenario.controllers import OURS, name_of
from fsw_scenario.plants import Plant

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Progress = Callable[[float], None]


def needed(module: str) -> Any:
    """A module of the extra ``science``; otherwise an ImportError that says how to install it."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        extra = Extra("fsw-control", "science", (error.name or module,))
        raise ImportError(extra.absence) from None


class Weld:
    """A weld, simulated or recorded: time series, figures of merit, figures.

    Parameters
    ----------
    label : str
        Name in tables and legends.
    signals : WeldSignals

    Attributes
    ----------
    table : dict of str to (n,) array
        All signals by name, a row per tick of 0.1 s, in the paper's units: mm, degC, kN, rpm, N m,
        kW, s. Names that begin with ``truth_`` are the noise-free process (simulations only).
    controller : Controller or None
        Of a simulation with an object of your own the copy that welded, with the memory that it
        has at the end; not part of a copied or pickled weld.
    kpi : Kpi
        Figures of merit, by name or as attributes.

    Examples
    --------
    >>> import fsw
    >>> weld = fsw.simulate("quick")
    >>> weld["depth_mm"].shape
    (600,)
    >>> sorted(name for name in weld.table if name.startswith("reference"))
    ['reference_depth_mm', 'reference_temperature_c']
    """

    @validated
    def __init__(self, label: str, signals: WeldSignals) -> None:
        self.label = label
        self.signals = signals
        self.controller: Controller | None = None

    def __repr__(self) -> str:
        return (
            f"<Weld {self.label}: {self.signals.n_ticks} ticks, {self.signals.duration_s:.1f} s>"
        )

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "controller": None}  # it may hold what cannot be pickled

    def __getitem__(self, name: str) -> Column:
        """A signal by name; KeyError if there is none."""
        try:
            return self.table[name]
        except (KeyError, TypeError):
            near = get_close_matches(str(name), self.table, 1)
            hint = f"did you mean {near[0]}?" if near else "all names: list(weld.table)"
            raise KeyError(f"no signal {name}; {hint}") from None

    @cached_property
    def table(self) -> dict[str, Column]:
        """All signals by name."""
        return weld_table(self.signals)

    @cached_property
    def kpi(self) -> Kpi:
        """Figures of merit."""
        return Kpi(kpi.compute(self.signals, self.label))

    def to_pandas(self) -> pd.DataFrame:
        """All signals as columns over the time in s; ImportError without pandas.

        Examples
        --------
        >>> import fsw
        >>> frame = fsw.simulate("quick").to_pandas()
        >>> frame.index.name, len(frame)
        ('time_s', 600)
        """
        pandas = needed("pandas")

        return pandas.DataFrame(self.table).set_index("time_s")

    def to_xarray(self) -> xr.Dataset:
        """All signals over the coordinate ``time_s``, with units as attributes; needs xarray.

        Examples
        --------
        >>> import fsw
        >>> fsw.simulate("quick").to_xarray()["depth_mm"].attrs
        {'units': 'mm'}
        """
        xarray = needed("xarray")

        columns = dict(self.table)
        time_s = columns.pop("time_s")
        units = {
            name: {"units": unit}
            for name in columns
            if (unit := _UNITS.get(name.rpartition("_")[2]))
        }
        return xarray.Dataset(
            {name: ("time_s", values, units.get(name)) for name, values in columns.items()},
            {"time_s": time_s},
        )

    @validated
    def to_csv(self, path: str | Path) -> None:
        """Write all signals as a table; fsw_recorder.errors.BagError if that fails."""
        export_weld(self.signals, Path(path))

    @validated
    def plot(self, number: int | None = None) -> Figure:
        """Draw an overview, or a figure like the paper's 4 to 9.

        Examples
        --------
        >>> import fsw
        >>> len(fsw.simulate("quick").plot().axes)
        6
        """
        return _figure([self], number)


class Comparison(dict[str, Weld]):
    """Welds by label, for comparison.

    Examples
    --------
    >>> import fsw
    >>> both = fsw.compare("quick", ["decentral:tight", "nmpc"])
    >>> list(both)
    ['decentral:tight', 'nmpc']
    >>> both.kpi["nmpc"].iae_depth_mm_s < both.kpi["decentral:tight"].iae_depth_mm_s
    True
    """

    def __missing__(self, label: Any) -> Weld:
        near = get_close_matches(str(label), self, 1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(self)}"
        raise KeyError(f"no weld {label}; {hint}")

    @property
    def kpi(self) -> dict[str, Kpi]:
        """Figures of merit of each weld, by label."""
        return {label: weld.kpi for label, weld in self.items()}

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(self)}; print it for its table>"

    def __str__(self) -> str:
        """Table in Markdown with a column per weld, and below it the problems of the welds."""
        notes = [
            f"- {weld.label}: {problem}"
            for weld in self.values()
            for problem in weld.signals.problems
        ]
        table = kpi_table.markdown(list(self.kpi.values()))
        return "\n\n".join([table, *(["\n".join(notes)] if notes else [])])

    _repr_markdown_ = __str__

    def to_pandas(self) -> pd.DataFrame:
        """Figures of merit, a row per weld; ImportError without pandas."""
        pandas = needed("pandas")

        flat = [
            {key: value for key, value in kpi.items() if not isinstance(value, list)}
            for kpi in self.kpi.values()
        ]
        return pandas.DataFrame(flat).set_index("label")

    @validated
    def plot(self, number: int | None = None) -> Figure:
        """Draw all welds into an overview, or a figure like the paper's 4 to 9."""
        return _figure(list(self.values()), number)


#: units by the suffix of a signal's name
_UNITS = {
    "mm": "mm",
    "c": "degC",
    "kn": "kN",
    "rpm": "rpm",
    "nm": "N m",
    "kw": "kW",
    "s": "s",
    "ns": "ns",
    "deg": "deg",
}


def _figure(welds: Sequence[Weld], number: int | None) -> Figure:
    # matplotlib takes a second to import
    from fsw_analysis.figures import PAPER_FIGURES, Run, page

    if number is not None and number not in PAPER_FIGURES:
        raise InputError(
            f"plot: there is no figure {number!r}; there are {', '.join(map(str, PAPER_FIGURES))}"
        )
    drawn = page([Run(weld.label, weld.signals) for weld in welds], number)
    if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
        with suppress(ValueError):  # before matplotlib 3.11
            pyplot.figure(drawn)  # plt.show() shows it, too
    return drawn


@validated
def simulate(
    scenario: Source,
    controller: str | Controller | None = None,
    *,
    plant: Mapping[str, Any] | Plant | None = None,
    parameters: Mapping[str, Any] | None = None,
    changes: Mapping[str, Any] | None = None,
    noise: bool | None = None,
    heat: str | Path | None = None,
    label: str | None = None,
    progress: Progress | None = None,
) -> Weld:
    """Weld a scenario in this process: emulated plant and controllers, at full speed.

    Parameters
    ----------
    scenario : str, Path or mapping
        Name of a shipped scenario, e.g. ``reference_tracking``, a YAML file, or the content of
        one.
    controller : str or Controller, optional
        Name, also with a variant, e.g. ``nmpc:paper``; ``MODULE:CLASS``, ``FILE.py:CLASS``, or an
        object of your own class, of which a copy welds (``weld.controller``). By default the
        scenario's.
    plant : mapping of str to value or Plant, optional
        Parameters of the emulated plant, e.g. ``{"seed": 3, "factors.thermal_gain_c_per_kw":
        1.2}``, or a process of your own (:class:`fsw.Plant`) instead.
    parameters : mapping of str to value, optional
        Parameters of the controller's node.
    changes : mapping of str to value, optional
        Other values of the scenario by path, e.g. ``{"events[0].at_s": 10}``.
    noise : bool, optional
        Whether sensors have noise and resolution.
    heat : str or Path, optional
        Heat profile of the type of weld, from ``fsw.py learn``, for controllers that look ahead.
    label : str, optional
        Name of the weld in tables and legends; by default the controller's.
    progress : callable, optional
        Called with the completed share, 0 to 1.

    Raises
    ------
    fsw_control.schema.models.InputError
        When something of this is not there or out of range, or the controller proposed nothing
        that could be applied at any tick. Where that was so for a part of the weld, its
        ``signals.problems`` have a remark.
    fsw_model.OperatingPointError
        If the plant has no equilibrium to start from.

    Examples
    --------
    >>> import fsw
    >>> weld = fsw.simulate("quick", controller="nmpc:default", plant={"seed": 3}, noise=False)
    >>> weld
    <Weld nmpc:default: 600 ticks, 59.9 s>
    >>> round(float(weld["truth_depth_mm"][-1]), 2)
    2.76
    """
    own = (
        {}
        if parameters is None or not isinstance(controller, str)
        else {name_of(controller): parameters}
    )
    if parameters and not own:
        raise InputError("simulate: parameters are for a controller that is given by its name")
    process = None if plant is None or isinstance(plant, Mapping) else plant
    if process is not None and noise is not None:
        raise InputError("simulate: noise is for the emulated plant; your own makes its own")
    overrides = overrides_of(plant if isinstance(plant, Mapping) else None, changes, noise)
    name, loop = closed_loop(scenario, controller, overrides, own, heat, process)
    weld = Weld(label or name, loop.run(progress))
    if not isinstance(controller, str | None):
        weld.controller = loop.selected
    return weld


@validated
def compare(
    scenario: Source,
    controllers: Sequence[str | Controller] | Mapping[str, str | Controller] = tuple(OURS),
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    **options: Any,
) -> Comparison:
    """Weld a scenario with each of several controllers; ``options`` as for :func:`simulate`.

    Parameters
    ----------
    scenario : str, Path or mapping
    controllers : sequence, or mapping by label
        Names or objects, as for :func:`simulate`. Of controllers with the same label all but the
        first get a number.
    parameters : mapping of str to mapping, optional
        Parameters of controllers' nodes, by label.

    Examples
    --------
    >>> import fsw
    >>> print(fsw.compare("quick", ["decentral", "decentral:tight"]))  # doctest: +ELLIPSIS
    |                       ...| unit ...| decentral | decentral:tight | difference |
    ...
    >>> both = fsw.compare(
    ...     "quick",
    ...     {"slow": "decentral", "fast": "decentral"},
    ...     parameters={"fast": {"tuning": "tight"}},
    ... )
    >>> both["fast"].kpi.iae_depth_mm_s < both["slow"].kpi.iae_depth_mm_s
    True
    """
    if not controllers:
        raise InputError(f"compare: controllers is a list of at least one, not {controllers!r}")
    if isinstance(controllers, Mapping):
        entrants = [*controllers.items()]
    else:
        entrants = [
            (options.get("label") or (entry if isinstance(entry, str) else entry.name), entry)
            for entry in controllers
        ]
    unused = (parameters or {}).keys() - {label for label, _ in entrants}
    if unused:
        raise InputError(
            f"compare: parameters are for {', '.join(sorted(unused))}, "
            f"but the labels are {', '.join(label for label, _ in entrants)}"
        )
    welds = Comparison()
    for name, controller in entrants:
        own: dict[str, Any] = {"parameters": (parameters or {}).get(name)}
        if isinstance(controllers, Mapping):
            own["label"] = name
        weld = simulate(scenario, controller, **{**options, **own})
        numbered = (f"{weld.label} ({number})" for number in count(2))
        if weld.label in welds:
            weld.label = next(label for label in numbered if label not in welds)
        welds[weld.label] = weld
    return welds


@validated
def read_bag(bag: str | Path, label: str | None = None, progress: Progress | None = None) -> Weld:
    """A recorded weld, cut to its scenario's length; ``signals.problems`` has the bag's problems.

    Parameters
    ----------
    bag : str or Path
        Folder or file (MCAP, sqlite3; intact, truncated or damaged).
    label : str, optional
        The folder's name by default.
    progress : callable, optional
        Called with the share read, 0 to 1.

    Raises
    ------
    fsw_recorder.errors.BagError
        If nothing can be read.

    Examples
    --------
    >>> import fsw
    >>> fsw.read_bag("no_such_bag")
    Traceback (most recent call last):
    fsw_recorder.errors.BagError: no_such_bag: there is no such bag
    """
    from fsw_analysis.signals import load_weld  # what reads bags takes a while to import

    signals = cut_to_scenario(load_weld(Path(bag), progress))
    return Weld(label or signals.path.name, signals)
