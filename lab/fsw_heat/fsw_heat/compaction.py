"""Compact model of a canister (``heat_model.py``) from the projection by finite elements."""

from __future__ import annotations

from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np

from fsw_heat.cache import kept, projection_of
from fsw_heat.elements import one_thread
from fsw_heat.heat_model import TYPICAL, Array, Compact, CompactCanister
from fsw_heat.projection import Progress, Projection
from fsw_plant.canister import CanisterParameters

#: Hankel singular value, mean of the positions, below which a direction is left out [K at
#: ``_POWER_KW``]
TOLERANCE_K, _POWER_KW = 0.03, 50.0
#: for which the vectors are chosen: traverse speeds [mm/s]; others are served as well
_SPEEDS_MM_PER_S = (0.0, 43.0 / 60.0, 86.0 / 60.0, 172.0 / 60.0)
_SLOWEST_PER_S = 1e-4
#: most directions of a parity
_MOST = 150


def load_or_compact(
    parameters: CanisterParameters, cache: Path | None = None, progress: Progress | None = None
) -> CompactCanister:
    """The compact model, from the cache or made now.

    Arguments and errors as of ``reduced.load_or_reduce``.
    """

    def make() -> Compact:
        return compact_of(projection_of(parameters, cache, progress), parameters)

    return CompactCanister(parameters, kept(Compact, parameters, cache, make, progress))


def compact_of(
    projection: Projection, parameters: CanisterParameters, tolerance_k: float = TOLERANCE_K
) -> Compact:
    """Choose the vectors by the Gramians of even and odd part, and project on them.

    With heat made and temperature taken at the same places the system in the tool's frame is its
    own adjoint but for the direction of travel, which changes the sign of the odd part alone:
    inputs and outputs have the same Gramians.
    """
    from scipy.linalg import block_diag

    q = projection
    twice = np.where(q.mode == 0, 1.0, np.sqrt(2.0))
    tables = {name: getattr(q, name) * twice for name in ("probe", "shoulder", "rim")}
    decay, turn = q.diagonal(TYPICAL["k"], TYPICAL["surface"], TYPICAL["clamp"])
    decay = np.maximum(decay / TYPICAL["rho_c"], _SLOWEST_PER_S)
    here = [q.turned(table, turn) for table in tables.values()]
    blocks = list(pairwise(q.ends.tolist()))
    parities = []
    for gramian in _gramians(q, here, decay, parameters.outer_radius_mm):
        with one_thread():
            leading = _leading(gramian, tolerance_k)
        parities.append(
            np.concatenate([t @ leading[a:b] for (a, b), t in zip(blocks, turn, strict=True)])
        )

    def projected(matrix: Array) -> Array:
        of_parity = [
            sum(v[a:b].T @ (matrix[a:b, : b - a] @ v[a:b]) for a, b in blocks) for v in parities
        ]
        return np.asarray(block_diag(*of_parity))

    even, odd = parities
    return Compact(
        **{name: projected(getattr(q, name)) for name in ("conduction", "surface", "clamp")},
        transport=even.T @ (q.mode[:, None] * odd),
        **{name: table @ even for name, table in tables.items()},
        rest_k_per_w=q.rest_k_per_w,
        axial_mm=q.axial_mm,
    )


def _gramians(
    q: Projection, tables: list[Array], decay: Array, radius_mm: float
) -> tuple[Array, Array]:
    """Gramians of even and odd part in eigenvectors of typical copper, mean of all places.

    The response to an impulse at a position is known, ``b exp(-decay t)`` times cosine and sine of
    ``s m t``; so are the integrals over all time.
    """
    scale = (
        1e3
        * _POWER_KW
        / (2.0 * pi * TYPICAL["rho_c"] * len(q.axial_mm) * len(tables) * len(_SPEEDS_MM_PER_S))
    )
    products = scale * np.sum([table.T @ table for table in tables], axis=0)
    sums = decay[:, None] + decay
    apart, together = q.mode[:, None] - q.mode, q.mode[:, None] + q.mode
    even, odd = np.zeros_like(products), np.zeros_like(products)
    for speed in _SPEEDS_MM_PER_S:
        slow, fast = (
            0.5 * products * sums / (sums**2 + (speed / radius_mm * m) ** 2)
            for m in (apart, together)
        )
        even += slow + fast
        odd += slow - fast
    return even, odd


def _leading(gramian: Array, tolerance_k: float) -> Array:
    """Its eigenvectors above the tolerance, (states, n)."""
    from scipy.sparse.linalg import eigsh

    count = len(gramian)
    values, vectors = eigsh(
        gramian, k=min(_MOST, count - 1), v0=np.ones(count)
    )  # a start: the same every time
    return np.asarray(vectors[:, values > tolerance_k][:, ::-1])
