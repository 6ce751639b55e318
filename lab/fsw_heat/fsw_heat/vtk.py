"""Temperatures of the whole canister's end for ParaView, by meshio."""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from fsw_heat.elements import Elements, elements_of, extra
from fsw_heat.history import HeatHistory

#: points around the circumference to the shortest wave of the model
_POINTS_PER_WAVE = 3


def write_vtk(history: HeatHistory, times_s: Sequence[float], folder: Path) -> list[Path]:
    """Write a file for each moment into a folder that exists, and one that has them in order of time.

    Returns their paths, ``canister.vtu.series`` first.
    """
    meshio = extra("meshio")
    canister = history.canister
    elements = elements_of(canister.parameters)
    angles = np.linspace(
        0.0, 2.0 * pi, _POINTS_PER_WAVE * canister.parameters.modes, endpoint=False
    )
    points, cells = _solid(elements, angles)
    r, z = 1e3 * elements.mesh.p
    files: list[tuple[Path, float]] = []
    for time_s in times_s:
        at_s, state = history.at(time_s)
        field = canister.temperature_c(state, r, angles[:, None], z).ravel()
        path = folder / f"canister_{at_s:06.0f}s.vtu"
        meshio.Mesh(points, cells, point_data={"temperature_c": field.astype(np.float32)}).write(
            path
        )
        files.append((path, at_s))
    series = folder / "canister.vtu.series"
    named = [{"name": path.name, "time": at_s} for path, at_s in files]
    series.write_text(
        json.dumps({"file-series-version": "1.0", "files": named}, indent=1) + "\n",
        encoding="utf-8",
    )
    return [series, *(path for path, _ in files)]


def _solid(elements: Elements, angles: Any) -> tuple[Any, list[tuple[str, Any]]]:
    """Points [mm] and cells of the section, swept around the axis, or along a plate."""
    section, (r, z) = elements.mesh.t, 1e3 * elements.mesh.p
    around = elements.mesh.p.shape[1]
    if elements.parameters.shape == "plate":
        x, y = np.broadcast_arrays(elements.parameters.outer_radius_mm * angles[:, None], r)
        here = np.arange(angles.size - 1)
    else:
        x, y = np.cos(angles)[:, None] * r, np.sin(angles)[:, None] * r
        here = np.arange(angles.size)
    points = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1).reshape(-1, 3)
    there = (here + 1) % angles.size
    near, far = (section[None] + around * one[:, None, None] for one in (here, there))
    hexahedra = np.concatenate([near, far], axis=1).transpose(0, 2, 1).reshape(-1, 8)
    return points.astype(np.float32), [("hexahedron", hexahedra)]
