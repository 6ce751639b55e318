"""Heat profile of a type of weld: the heat by place in welds of it, their mean and spread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.schema.models import InputError
from fsw_identification.heat import HeatWalk, fit_fast, fit_walk, heat_record, smooth
from fsw_model import ModelParameters
from fsw_model.heat_profile import CORRELATION_MM, HeatProfile, HeatSource, ThermalModel

#: distance of two places of a profile
GRID_MM = 2.0
#: what welds of a type differ by before any of them has been seen [kW], and as how many welds that
#: counts; of welds that were computed with nominal copper it is more; chosen
_EXPECTED_KW, _COMPUTED_KW, _EXPECTED_WELDS = 0.15, 0.3, 2.0


class Learned(NamedTuple):
    """A profile, the process model that belongs to it, and the random walk of the heat."""

    profile: HeatProfile
    model: ModelParameters
    walk: HeatWalk


def learn(
    welds: Sequence[tuple[str, str, WeldSignals]],
    type_name: str,
    model: ModelParameters,
    drive_lag_s: float,
    keep_model: bool = False,
    computed: bool = False,
    progress: Callable[[float], None] = lambda _: None,
) -> Learned:
    """Learn from welds.

    Parameters
    ----------
    welds : sequence of (str, str, WeldSignals)
        Name, SHA-256 of the bag, and signals.
    type_name : str
    model : ModelParameters
        Friction and inertia are taken from it.
    drive_lag_s : float
        Time constant of the drives.
    keep_model : bool
        Keep gain, lags and dead time, too; else they are those of the fast part of the copper's
        response, from these welds.
    computed : bool
        The welds are simulated, with nominal copper.
    progress : callable, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    InputError
        If there is no weld, one lacks signals or a path, or they have no path in common.
    """
    if not welds:
        raise InputError("learn: give the bag of a weld")
    records = [heat_record(signals, model, drive_lag_s) for _, _, signals in welds]
    used, walk = (model, fit_walk(records, model)) if keep_model else fit_fast(records, model)
    reach_mm = min(_reach(signals) for _, _, signals in welds)
    travel_mm = np.arange(0.0, reach_mm + 1e-9, GRID_MM)
    if travel_mm.size < 2:
        raise InputError("learn: the welds have no path in common")
    # By place and not by time: welds of a type have the same copper at the same place, but may
    # dwell for different times.
    heats, own = [], []
    for i, ((_, _, signals), record) in enumerate(zip(welds, records, strict=True)):
        progress(i / len(welds))
        heat_kw, variance_kw2 = smooth(record, used, walk)
        at = _places(signals, record.first, heat_kw.size, travel_mm)
        heats.append(heat_kw[at])
        own.append(variance_kw2[at])
    progress(1.0)
    by_weld, variances = np.array(heats), np.array(own)
    sources = [
        HeatSource(weld=name, sha256=digest, left_out_kw=_left_out(by_weld, i), computed=computed)
        for i, (name, digest, _) in enumerate(welds)
    ]
    expected_kw = _COMPUTED_KW if computed else _EXPECTED_KW
    profile = HeatProfile(
        type=type_name,
        model=ThermalModel.of(used),
        welds=tuple(sources),
        travel_mm=_rounded(travel_mm),
        heat_kw=_rounded(_common(by_weld)),
        deviation_kw=_rounded(_deviation(by_weld, variances, expected_kw)),
    )
    return Learned(profile, used, walk)


def _rounded(values: FloatArray) -> tuple[float, ...]:
    return tuple(round(value, 4) for value in values.tolist())


def _reach(signals: WeldSignals) -> float:
    """How far the tool travelled."""
    travelled = signals.travel_mm[np.isfinite(signals.travel_mm)]
    if not travelled.size or not travelled.max() > 0.0:
        raise InputError(f"{signals.path}: the weld has no programme with a path")
    return float(travelled.max())


def _places(signals: WeldSignals, first: int, n: int, travel_mm: FloatArray) -> FloatArray:
    """Row at which the tool passed each place; at the first place, when it began to move."""
    travelled = np.nan_to_num(signals.travel_mm[first : first + n], nan=0.0)
    rows = np.searchsorted(np.maximum.accumulate(travelled), travel_mm, side="right") - 1
    return np.clip(rows, 0, n - 1)


def _common(by_weld: FloatArray) -> FloatArray:
    """What the welds have in common: the median by place, so that a bad weld does no harm."""
    level = by_weld.mean(axis=1, keepdims=True)  # by which each differs throughout
    return np.asarray(np.median(by_weld - level, axis=0) + level.mean())


def _left_out(by_weld: FloatArray, i: int) -> float | None:
    """RMS of what the mean of the other welds lacks of a weld, apart from a constant."""
    if len(by_weld) < 2:
        return None
    lacks = by_weld[i] - _common(np.delete(by_weld, i, axis=0))
    return round(float(np.std(lacks)), 4)


def _deviation(by_weld: FloatArray, variances: FloatArray, expected_kw: float) -> FloatArray:
    """Standard deviation of a weld about the profile, by place: expected and observed."""
    # The variance between welds, smoothed along the path, is shrunk to the expected one, which
    # counts as that many welds (conjugate prior of a variance): one weld alone shows no spread.
    n = len(by_weld)
    lacks = by_weld - _common(by_weld)
    lacks -= lacks.mean(axis=1, keepdims=True)  # a constant is no error of the profile
    width = max(1, round(CORRELATION_MM / GRID_MM))
    counts = np.convolve(np.ones(by_weld.shape[1]), np.ones(width), "same")
    seen = np.convolve((lacks**2).sum(axis=0), np.ones(width), "same")
    between = (_EXPECTED_WELDS * expected_kw**2 + seen / counts) / (_EXPECTED_WELDS + n - 1.0)
    # the mean of n welds is itself uncertain by what they differ and by what each one's heat is
    return np.sqrt(between * (1.0 + 1.0 / n) + variances.mean(axis=0) / n)
