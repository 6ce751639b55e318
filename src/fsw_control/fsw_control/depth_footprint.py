"""Footprint of a weld: biases of its depth sensors, from the depth measured afterwards.

Only the footprint reveals the error common to all sensors. The next weld takes it as its prior.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Mapping
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, model_validator

from fsw_control.schema.models import (
    InputError,
    Many,
    Model,
    json_content_of,
    problem,
    read_text,
    validate,
)

Array = NDArray[np.float64]
#: columns of the measured depths
COLUMNS = ("angle_deg", "depth_mm")
#: ticks around an angle without which it has no bias (chosen)
_LEAST_TICKS = 5
#: extent of a place where only one angle is measured [deg]
_LONE_DEG = 2.0
#: prior of a bias along the weld: standard deviation of its mean, the candidates for that of its
#: variation, and the angle within which that is similar (chosen) [mm, mm, deg]
_MEAN_MM, _VARIATIONS_MM, _SIMILAR_DEG = 0.1, (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2), 20.0
#: deviation below which a measurement is exact [mm]
_EXACT_MM = 1e-4


class SensorBias(Model):
    """Bias of a depth sensor: sample minus measured depth."""

    sensor: str
    """name in the table of sensors; `depth`: the value that control used"""
    bias_mm: Many[float]
    """at each angle, beyond the deflection that the estimator expects of it"""
    deviation_mm: Many[float]
    """standard deviation of that at each angle, by the errors of the measurement"""


class Footprint(Model):
    """Biases of the depth sensors along a weld."""

    weld: str
    """name of the bag"""
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """of the bag's data"""
    angle_deg: Annotated[Many[float], Field(min_length=1)]
    """measured places, in order"""
    depth_mm: Many[float]
    """measured depths"""
    deviation_mm: NonNegativeFloat
    """standard deviation of the measurement"""
    sensors: Annotated[Many[SensorBias], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_lengths(self) -> Footprint:
        if not all(before < after for before, after in pairwise(self.angle_deg)):
            raise problem("must rise", "angle_deg")
        for name, values in (
            ("depth_mm", self.depth_mm),
            *((f"sensors.{sensor.sensor}", sensor.bias_mm) for sensor in self.sensors),
            *((f"sensors.{sensor.sensor}", sensor.deviation_mm) for sensor in self.sensors),
        ):
            if len(values) != len(self.angle_deg):
                raise problem("needs a value for each angle", name)
        return self

    @classmethod
    def from_file(cls, path: str | Path) -> Footprint:
        """Read a JSON file; InputError if that is not possible."""
        text = read_text(path, "footprint")
        return validate(cls, json_content_of(text, str(path)), str(path))

    @classmethod
    def from_named(cls, path: str | Path | None) -> tuple[Footprint | None, str]:
        """The footprint in a file and the file's SHA-256; no name: none."""
        if not path:
            return None, ""
        return cls.from_file(path), hashlib.sha256(Path(path).read_bytes()).hexdigest()

    def bias_mm(self, sensor: str, angle_deg: float) -> tuple[float, float]:
        """Bias of a sensor at an angle, and its standard deviation; NaN: their means.

        A sensor that is not in the footprint has a bias of 0 and an infinite deviation.
        """
        for entry in self.sensors:
            if entry.sensor == sensor:
                bias, deviation = (
                    np.mean(values)
                    if angle_deg != angle_deg
                    else np.interp(angle_deg, self.angle_deg, values)
                    for values in (entry.bias_mm, entry.deviation_mm)
                )
                return float(bias), float(deviation)
        return 0.0, math.inf


def measured_depths(path: Path) -> tuple[Array, Array]:
    """Angles and depths from a CSV file with the columns ``COLUMNS``, in order of the angle.

    Raises
    ------
    InputError
        If it cannot be read, lacks a column, or holds anything but finite numbers.
    """
    rows = csv.DictReader(StringIO(read_text(path, "footprint")))
    if missing := [name for name in COLUMNS if name not in (rows.fieldnames or ())]:
        raise InputError(f"{path}: lacks the column {', '.join(missing)}")
    try:
        values = np.array([[float(row[name]) for name in COLUMNS] for row in rows])
    except (TypeError, ValueError):
        raise InputError(f"{path}: a value is not a number") from None
    if not values.size or not np.isfinite(values).all():
        raise InputError(f"{path}: holds no depths, or one that is not finite")
    values = values[np.argsort(values[:, 0])]
    if (np.diff(values[:, 0]) <= 0.0).any():
        raise InputError(f"{path}: an angle occurs twice")
    return values[:, 0], values[:, 1]


def biases(
    angle_deg: Array, samples_mm: Mapping[str, Array], at_deg: Array, depth_mm: Array
) -> dict[str, Array]:
    """Bias of each sensor at measured angles: the mean over the ticks nearest to each.

    Parameters
    ----------
    angle_deg, samples_mm : arrays
        Angle of the tool, and samples of each sensor, at the weld's ticks.
    at_deg, depth_mm : arrays
        Measured angles, in order, and depths.

    Returns
    -------
    dict
        By sensor; NaN where it has too few samples.
    """
    middle = 0.5 * (at_deg[1:] + at_deg[:-1])
    first, last = (
        (2.0 * at_deg[end] - middle[end] if middle.size else at_deg[end] + side * _LONE_DEG)
        for end, side in ((0, -1.0), (-1, 1.0))
    )
    place = np.digitize(angle_deg, np.array([first, *middle, last])) - 1
    result = {}
    for name, samples in samples_mm.items():
        known = np.isfinite(samples) & np.isfinite(angle_deg)
        known &= (place >= 0) & (place < at_deg.size)
        count = np.bincount(place[known], minlength=at_deg.size)
        total = np.bincount(place[known], samples[known], minlength=at_deg.size)
        mean = np.full(at_deg.size, np.nan)
        np.divide(total, count, out=mean, where=count >= _LEAST_TICKS)
        result[name] = mean - depth_mm
    return result


def smoothed(
    at_deg: Array, bias_mm: Array, deviation_mm: float, where_deg: Array
) -> tuple[Array, Array]:
    """Bias at angles without the errors of its measurement, and its standard deviation.

    Regression with a Gaussian process of Matern 3/2 (Rasmussen and Williams, "Gaussian Processes
    for Machine Learning", 2006, 2.2 and 5.2), averaged over its variation by their likelihoods.
    The errors are known, so a constant bias stays constant; cross-validation, which does not know
    them, makes them part of the bias where few angles are measured.
    """

    def alike(first: Array, second: Array) -> Array:
        distance = np.sqrt(3.0) * np.abs(first[:, None] - second) / _SIMILAR_DEG
        return np.asarray((1.0 + distance) * np.exp(-distance))

    errors = max(deviation_mm, _EXACT_MM) ** 2 * np.eye(at_deg.size)
    likelihoods: list[float] = []
    means: list[Array] = []
    squares: list[Array] = []
    for variation_mm in _VARIATIONS_MM:
        prior = _MEAN_MM**2 + variation_mm**2 * alike(at_deg, at_deg)
        root = np.linalg.cholesky(prior + errors)
        white = np.linalg.solve(root, bias_mm)
        likelihoods.append(float(-0.5 * white @ white - np.log(np.diagonal(root)).sum()))
        shared = _MEAN_MM**2 + variation_mm**2 * alike(at_deg, where_deg)
        gains = np.linalg.solve(root, shared)
        means.append(gains.T @ white)
        squares.append(_MEAN_MM**2 + variation_mm**2 - (gains**2).sum(0) + means[-1] ** 2)
    weights = np.exp(np.array(likelihoods) - max(likelihoods))
    weights /= weights.sum()
    mean = weights @ np.array(means)
    return mean, np.sqrt(np.maximum(weights @ np.array(squares) - mean**2, 0.0))
