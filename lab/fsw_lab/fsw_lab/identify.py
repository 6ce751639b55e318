"""Identification for use in Python: model parameters from welds."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fsw.arguments import validated
from fsw.welds import Weld, read_bag
from fsw_control.schema.models import InputError
from fsw_identification import estimation, summary
from fsw_identification.drives import DriveRates, drive_rates, from_air
from fsw_identification.problem import Prior
from fsw_identification.read_table import read_table as table_signals
from fsw_identification.summary import Summary
from fsw_identification.weld_data import prepare
from fsw_model import MachineData, ModelParameters, ParameterCovariance
from fsw_plant.parameters import Actuators

#: ends of the names of logs
TABLES = (".csv", ".tsv", ".txt")


@dataclass(frozen=True)
class Identified(Summary):
    """Model parameters estimated from welds, with their statistics.

    As text, the tables of ``fsw identify``.
    """

    rates: DriveRates = field(default_factory=DriveRates)

    @property
    def parameters(self) -> ModelParameters:
        """The estimate, as the sensors show the process to a controller.

        What is not estimated is as at the start.
        """
        return self.fit.shown

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the estimated parameters."""
        return self.fit.std | self.air

    @property
    def covariance(self) -> ParameterCovariance:
        """Covariance of the estimates' relative errors, for the monitor and the next weld's prior.

        Without what the thermocouple shows in another way than the tool has it, where it lags.
        """
        shown, fit = self.fit.shown, self.fit
        same = [getattr(shown, name) == getattr(fit.parameters, name) for name in fit.free]
        names = [name for name, is_same in zip(fit.free, same, strict=True) if is_same]
        return ParameterCovariance(
            parameters=names, covariance=fit.covariance[np.ix_(same, same)].tolist()
        )

    @property
    def machine(self) -> MachineData:
        """Noise of the sensors and rates of the drives, for the NMPC's ``machine_file``."""
        depth_mm, temperature_c, torque_nm = (float(noise) for noise in self.fit.noise)
        return MachineData(
            depth_noise_mm=depth_mm,
            temperature_noise_c=temperature_c,
            torque_noise_nm=torque_nm,
            force_rate_kn_per_s=self.rates.force_kn_per_s,
            speed_rate_rpm_per_s=self.rates.speed_rpm_per_s,
        )

    @property
    def text(self) -> str:
        """Model file (YAML), which :func:`model` reads."""
        return summary.model_text(self.fit, self.sources, self.air)

    def __repr__(self) -> str:
        names = ", ".join(self.fit.free)
        return f"<Identified {names} from {self.sources}; print it for its tables>"

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
    *welds: Any,
    validate: Any = None,
    air: Any = None,
    start: ModelParameters | None = None,
    drive_lag_s: float | None = None,
    steady: bool = False,
    prior: ParameterCovariance | None = None,
    other_type: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Identified:
    """Estimate the parameters of the process model from welds of one process.

    Parameters
    ----------
    *welds : Weld, str, Path, mapping or pandas.DataFrame
        Welds, their bags, or logs of a machine: CSV files, arrays, data frames (as
        :func:`fsw.read_table` reads them). What only the emulator knows is not used.
    validate : like welds, optional
        Weld that validates the model and is not used for the estimate.
    air : like welds, optional
        Run in air at several speeds, for the friction (23).
    start : ModelParameters, optional
        The paper's by default.
    drive_lag_s : float, optional
        Time constant of the drives, that of the emulator by default.
    steady : bool
        Take disturbances as constant: without drifts and shifts all that is slow is the process's.
    prior : ParameterCovariance, optional
        Covariance of ``start``, from the last weld of the machine: the welds update both.
    other_type : bool
        The last weld was of another type, from which the thermal parameters differ by more.
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
    signals = [weld_of(weld).signals for weld in welds]
    data = [prepare(row, lag_s) for row in signals]
    judge = None if validate is None else prepare(weld_of(validate).signals, lag_s)
    first = start or ModelParameters()
    deviations: dict[str, float] = {}
    if air is not None:
        first, deviations = from_air(weld_of(air).signals, first, lag_s)
    segments = [segment for weld in data for segment in weld.segments]
    earlier = None if prior is None else Prior.of(first, prior, other_type)
    fit = estimation.identify(segments, first, progress, steady, earlier)
    validation = None
    if judge is not None:
        validation = estimation.validate(judge.segments, fit.parameters, fit.known_lag_s)
    rates = drive_rates(signals)
    notes = tuple(note for weld in data for note in weld.notes) + rates.notes
    return Identified(
        ", ".join(weld.name for weld in data),
        fit,
        validation,
        notes,
        deviations,
        rates,
    )


@validated
def read_table(
    source: Any, columns: Mapping[str, str] | None = None, label: str | None = None
) -> Weld:
    """A weld from the log of any machine: a CSV file, arrays by column, or a data frame of pandas.

    Needed are time, depth, temperature, torque, force and speed at any rate, which is brought to
    ticks of 0.1 s; :func:`fsw.identify` needs at least 5 samples a second. Force and speed are
    those that act, unless ``drives_force_kn`` and ``drives_speed_rpm`` are there, too, as in
    :meth:`Weld.to_csv`. Columns are known by name and unit, e.g. ``force_kn``, ``Axial force [N]``
    or ``Spindle speed (rad/s)``; a file may have decimal commas and times such as
    2026-05-01T10:00:00. A warning names columns whose values are unusual for their unit.

    Parameters
    ----------
    source : str, Path, mapping or pandas.DataFrame
        CSV file, with ``,``, ``;`` or tabs between its cells, or columns by name.
    columns : mapping of str to str, optional
        Names of columns, by quantity and unit, e.g. ``{"force_n": "F_ax"}``.
    label : str, optional
        The file's name by default.

    Raises
    ------
    fsw_control.schema.models.InputError
        With line and column, when something is missing, ambiguous or no number.

    Examples
    --------
    >>> import fsw
    >>> weld = fsw.simulate("quick")
    >>> names = ["time_s", "depth_mm", "temperature_c", "torque_nm", "drives_speed_rpm"]
    >>> log = {name.removeprefix("drives_"): weld[name] for name in names}
    >>> log["F"] = 1e3 * weld["drives_force_kn"]
    >>> fsw.read_table(log, {"force_n": "F"})
    <Weld table: 600 ticks, 59.9 s>
    """
    signals = table_signals(source, columns)
    for problem in signals.problems:
        warnings.warn(problem, stacklevel=3)  # beyond the check of the arguments
    return Weld(label or signals.path.stem, signals)


def weld_of(source: Any, columns: Mapping[str, str] | None = None) -> Weld:
    """A weld as it is, from its bag, or from the log of a machine."""
    if isinstance(source, Weld):
        return source
    if isinstance(source, str | Path) and Path(source).suffix.lower() not in TABLES:
        return read_bag(source)
    return read_table(source, columns)
