"""Identification for use in Python: model parameters from welds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fsw.arguments import validated
from fsw.welds import Weld, read_bag
from fsw_control.schema.models import InputError
from fsw_identification import estimation, summary
from fsw_identification.friction import from_air
from fsw_identification.summary import Summary
from fsw_identification.weld_data import prepare
from fsw_model import ModelParameters
from fsw_plant.parameters import Actuators


class Identified(Summary):
    """Model parameters estimated from welds, with their statistics; as text, the tables of ``fsw identify``."""

    @property
    def parameters(self) -> ModelParameters:
        """The estimate, as the sensors show the process to a controller; what is not estimated is as at the start."""
        return self.fit.shown

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the estimated parameters."""
        return self.fit.std | self.air

    @property
    def text(self) -> str:
        """Model file (YAML), which :func:`model` reads."""
        return summary.model_text(self.fit, self.sources, self.air)

    def __str__(self) -> str:
        tables = (summary.parameter_rows(self), summary.output_rows(self))
        lines = [
            "  ".join(f"{cell:<22}" for cell in row).rstrip()
            for rows in tables
            for row in (*rows, [])
        ]
        return "\n".join([*lines, *summary.remarks(self)])


@validated
def identify(
    *welds: Weld | str | Path,
    validate: Weld | str | Path | None = None,
    air: Weld | str | Path | None = None,
    start: ModelParameters | None = None,
    drive_lag_s: float | None = None,
    steady: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Identified:
    """Estimate the parameters of the process model from welds of one process.

    Parameters
    ----------
    *welds : Weld, str or Path
        Welds or their bags. What only the emulator knows is not used.
    validate : Weld, str or Path, optional
        Weld that validates the model and is not used for the estimate.
    air : Weld, str or Path, optional
        Run in air at several speeds, for the friction (23).
    start : ModelParameters, optional
        The paper's by default.
    drive_lag_s : float, optional
        Time constant of the drives, that of the emulator by default.
    steady : bool
        Take disturbances as constant: without drifts and shifts all that is slow is the process's.
    progress : callable, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    fsw_control.schema.models.InputError
        When the welds do not suffice.

    Examples
    --------
    >>> import fsw
    >>> weld = fsw.simulate("identify_closed_loop", plant={"factors.thermal_gain_c_per_kw": 1.2})
    >>> found = fsw.identify(weld)
    >>> abs(found.parameters.thermal_gain_c_per_kw / (1.2 * 18.1) - 1.0) < 0.03
    True
    """
    lag_s = Actuators().lag_s if drive_lag_s is None else drive_lag_s
    if not welds:
        raise InputError("identify: needs at least one weld, or its bag")
    if not 0.0 <= lag_s < np.inf:
        raise InputError(f"identify: drive_lag_s is a number of seconds from 0, not {lag_s:g}")
    data = [prepare(_weld(one).signals, lag_s) for one in welds]
    judge = None if validate is None else prepare(_weld(validate).signals, lag_s)
    first = start or ModelParameters()
    deviations: dict[str, float] = {}
    if air is not None:
        first, deviations = from_air(_weld(air).signals, first, lag_s)
    segments = [segment for weld in data for segment in weld.segments]
    found = estimation.identify(segments, first, progress, steady)
    validation = None
    if judge is not None:
        validation = estimation.validate(judge.segments, found.parameters, found.known_lag_s)
    notes = tuple(note for weld in data for note in weld.notes)
    return Identified(", ".join(weld.name for weld in data), found, validation, notes, deviations)


def _weld(given: Weld | str | Path) -> Weld:
    return given if isinstance(given, Weld) else read_bag(given)
