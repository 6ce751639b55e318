"""Projection of the canister's heat, mode by mode, on the few vectors that matter.

The vectors of a mode span its responses to the tool at several positions and time scales (rational
Krylov), less what hardly shows at the tool's rim (balanced truncation). They depend on the
geometry alone; k, c, losses and clamp enter the projected matrices later.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_heat.elements import Elements, elements_of, one_thread
from fsw_heat.heat_model import TYPICAL, Array
from fsw_plant.canister import CanisterParameters

Progress = Callable[[float, str], None]

#: time scales of the responses [1/s]; those slower than a mode's own decay by this factor are left
#: out
_SHIFTS_PER_S = (1e-4, 4e-4, 1.6e-3, 6.4e-3, 0.0256, 0.1, 0.4, 1.6, 6.4)
_SLOWER = 0.1
#: modes that decay faster than this answer at once in what their basis leaves out [1/s]
_FAST_PER_S = 0.1
#: tabulated positions of the tool in a radius of the probe, and how many of them are one apart for
#: the responses
_POSITIONS, _EVERY = 6, 4
#: below this tolerance temperatures away from the tool count, and the responses are to twice as
#: many
_FINE_K = 1e-3
#: power of the tolerance
_POWER_W = 50e3


@dataclass(frozen=True)
class Projection:
    """Basis and projected matrices, all modes one after the other; what the cache keeps."""

    mode: NDArray[np.int64]  #: mode that a basis vector belongs to, (n,)
    vectors: Array  #: orthonormal in the mass matrix, (size, n)
    #: rows of the modes' square blocks at k = h = 1, filled with zeros, (n, q)
    conduction: Array
    surface: Array
    clamp: Array
    #: mean of the basis vectors where heat is made and where the temperature is taken, (positions,
    #: n)
    probe: Array
    shoulder: Array
    rim: Array
    #: integrals of the basis vectors over the copper and its surfaces, (n,); 0 but for mode 0
    ones: Array
    surface_ones: Array
    clamp_ones: Array
    #: what the bases leave out at the rim, of fast modes at rest and at a typical k
    rest_k_per_w: Array  #: of probe and shoulder, (2, positions)
    axial_mm: Array  #: (positions,)

    @property
    def ends(self) -> NDArray[np.int64]:
        """Where the vectors of a mode begin and end."""
        return np.flatnonzero(np.diff(self.mode, prepend=-1, append=-1))

    def diagonal(self, k: float, surface: float, clamp: float) -> tuple[Array, list[Array]]:
        """Eigenvalues (n,) and eigenvectors of each mode for a conductivity and heat transfer."""
        values, turn = [], []
        for a, b in pairwise(self.ends.tolist()):
            conduction, losses, clamped = (
                matrix[a:b, : b - a] for matrix in (self.conduction, self.surface, self.clamp)
            )
            matrix = k * conduction + surface * losses + clamp * clamped
            value, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
            values.append(value)
            turn.append(vectors)
        return np.concatenate(values), turn

    def turned(self, rows: Array, turn: list[Array]) -> Array:
        """Rows of values (..., n) of the basis, in the eigenvectors of :meth:`diagonal`."""
        parts = [
            rows[..., a:b] @ t
            for (a, b), t in zip(pairwise(self.ends.tolist()), turn, strict=True)
        ]
        return np.concatenate(parts, axis=-1)


def project(parameters: CanisterParameters, progress: Progress | None = None) -> Projection:
    """Make the basis of every mode, and project on it.

    ``progress`` gets the share that is done and a text.

    Raises
    ------
    fsw_control.schema.models.InputError
        If scikit-fem is not installed.
    """
    with one_thread():
        return _project(elements_of(parameters), progress)


def _project(elements: Elements, progress: Progress | None) -> Projection:
    parameters = elements.parameters
    low, high = parameters.lowest_mm, parameters.highest_mm
    count = max(4, round(_POSITIONS * (high - low) / parameters.probe_radius_mm) + 1)
    axial_mm = np.linspace(low, high, count)
    count = parameters.modes + 1
    clouds = (elements.probe, elements.shoulder, elements.rim)
    tables = [
        np.array([elements.functional(cloud(1e-3 * a), count) for a in axial_mm])
        for cloud in clouds
    ]
    left_out = np.zeros((2, len(axial_mm)))
    parts: dict[str, list[Array]] = {
        name: [] for name in ("vectors", "conduction", "surface", "clamp", "functionals")
    }
    for mode in range(count):
        loads = np.concatenate([table[:, mode] for table in tables])
        stiffness = elements.stiffness(mode)
        basis = _basis(elements, stiffness, loads.reshape(3, len(axial_mm), -1), mode)
        parts["vectors"].append(basis)
        matrices = (stiffness, elements.surface, elements.clamp)
        for name, matrix in zip(("conduction", "surface", "clamp"), matrices, strict=True):
            parts[name].append(basis.T @ (matrix @ basis))
        parts["functionals"].append(loads @ basis)
        if _own_decay_per_s(mode, elements.outer_m) > _FAST_PER_S:
            left_out += _left_out(
                _typical_matrix(elements, stiffness), loads.reshape(3, len(axial_mm), -1), basis
            )
        if progress:
            progress((mode + 1) / count, f"mode {mode} of {count - 1}")
    widths = [basis.shape[1] for basis in parts["vectors"]]
    first, everywhere = parts["vectors"][0], np.ones(elements.size)
    rest = np.zeros(sum(widths) - widths[0])
    whole = [
        2.0 * pi * (everywhere @ (m @ first))
        for m in (elements.mass, elements.surface, elements.clamp)
    ]
    functionals = np.concatenate(parts["functionals"], axis=1).reshape(3, len(axial_mm), -1)
    blocks = [
        np.concatenate(
            [np.pad(block, ((0, 0), (0, max(widths) - len(block)))) for block in parts[name]]
        )
        for name in ("conduction", "surface", "clamp")
    ]
    return Projection(
        np.repeat(np.arange(count), widths),
        np.concatenate(parts["vectors"], axis=1),
        blocks[0],
        blocks[1],
        blocks[2],
        functionals[0],
        functionals[1],
        functionals[2],
        np.concatenate([whole[0], rest]),
        np.concatenate([whole[1], rest]),
        np.concatenate([whole[2], rest]),
        left_out,
        axial_mm,
    )


def _typical_matrix(elements: Elements, stiffness: Any) -> Any:
    """Conduction and losses of a mode for typical copper."""
    losses = TYPICAL["surface"] * elements.surface + TYPICAL["clamp"] * elements.clamp
    return (TYPICAL["k"] * stiffness + losses).tocsc()


def _own_decay_per_s(mode: int, radius_m: float) -> float:
    """How fast a mode decays at least, by conduction around the canister."""
    return float(TYPICAL["k"] / TYPICAL["rho_c"] * (mode / radius_m) ** 2)


def _left_out(matrix: Any, loads: Array, basis: Array) -> Array:
    """Rim temperature of 1 W of probe and shoulder outside a mode's basis, (2, positions)."""
    *sources, rim = loads
    exact = _factors(matrix).solve(rim.T).T
    kept = np.linalg.solve(basis.T @ (matrix @ basis), (rim @ basis).T).T @ basis.T
    return np.array([((exact - kept) * source).sum(axis=1) / pi for source in sources])


def _factors(matrix: Any) -> Any:
    from scipy.sparse.linalg import splu

    return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})


def _basis(elements: Elements, stiffness: Any, loads: Array, mode: int) -> Array:
    """Vectors for a mode, orthonormal in the mass matrix: its responses, balanced and truncated.

    All is symmetric, and heat is made where the temperature is taken, all but the shoulder's. With
    both as inputs and outputs the two Gramians are one matrix: its eigenvectors balance the
    system, and truncation keeps it symmetric.
    """
    mass, rho_c = elements.mass, TYPICAL["rho_c"]
    matrix = _typical_matrix(elements, stiffness)
    probe, shoulder, rim = loads
    ends = np.stack([probe + TYPICAL["shoulder"] * (shoulder - probe), rim])
    every = 2 if elements.parameters.tolerance_k < _FINE_K else _EVERY
    responses = _responses(
        matrix, rho_c * mass, ends[:, ::every].reshape(-1, elements.size).T, mode, elements.outer_m
    )
    constant = np.full((elements.size, 1), 1.0 / np.sqrt(mass.sum()))
    if mode == 0:
        responses -= constant @ (constant.T @ (mass @ responses))
    responses = _orthonormal(responses, mass)
    if mode == 0:  # with which no heat is lost, and preheating is exact
        responses = np.concatenate([constant, responses], axis=1)
    decay, vectors = np.linalg.eigh(responses.T @ (matrix @ responses) / rho_c)
    inputs = (ends.reshape(-1, elements.size) @ responses) @ vectors / np.sqrt(loads.shape[1])
    decay = np.maximum(decay, _SHIFTS_PER_S[0])
    scale = _POWER_W / (2.0 * pi * rho_c) * (1.0 if mode == 0 else 2.0)
    values, balanced = np.linalg.eigh(scale * (inputs.T @ inputs) / (decay[:, None] + decay))
    kept = vectors @ balanced[:, values > elements.parameters.tolerance_k]
    if mode == 0:
        kept, _ = np.linalg.qr(np.concatenate([np.eye(len(kept), 1), kept], axis=1))
    return np.asarray(responses @ kept)


def _responses(matrix: Any, capacity: Any, loads: Array, mode: int, radius_m: float) -> Array:
    """Responses to loads at several time scales, and at rest except for mode 0."""
    shifts = [s for s in _SHIFTS_PER_S if s > _SLOWER * _own_decay_per_s(mode, radius_m)]
    shifts = [0.0, *shifts] if mode else shifts
    return np.concatenate(
        [_factors((matrix + s * capacity).tocsc()).solve(loads) for s in shifts], axis=1
    )


def _orthonormal(vectors: Array, mass: Any) -> Array:
    """Basis of what the vectors span but for rounding, orthonormal in the mass matrix."""
    for least in (1e-12, 0.0):  # twice: the first time rounding is left
        values, turned = np.linalg.eigh(vectors.T @ (mass @ vectors))
        kept = values > least * values[-1]
        vectors = vectors @ (turned[:, kept] / np.sqrt(values[kept]))
    return vectors
