"""The stir zone's heat in some ninety states in the tool's frame; traverse speed and position are parameters.

In the frame of the tool an amplitude ``y = x exp(i m angle)`` of the reduced model (``reduced.py``), even part u and
odd part w about the tool, obeys with the angular speed s of the tool

    u' = -decay u - s m w + b(z) P,    w' = -decay w + s m u,    theta = c(z) u.

Even and odd parts are projected on few vectors each, by Galerkin's method: decay stays symmetric and the transport
skew, so that the model is stable at every speed. Copper, losses and clamp enter the small matrices afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np

from fsw_canister.cache import kept, projection_of
from fsw_canister.copper import Array
from fsw_canister.elements import one_thread
from fsw_canister.parameters import CanisterParameters
from fsw_canister.projection import TYPICAL, Progress, Projection
from fsw_canister.stepped import CanisterState, HeatModel

#: Hankel singular value, mean of the positions, below which a direction is left out [K at ``_POWER_KW``]
TOLERANCE_K, _POWER_KW = 0.03, 50.0
#: for which the vectors are chosen: traverse speeds [mm/s]; others are served as well
_SPEEDS_MM_PER_S = (0.0, 43.0 / 60.0, 86.0 / 60.0, 172.0 / 60.0)
_SLOWEST_PER_S = 1e-4
#: most directions of a parity
_MOST = 150
#: steps (speed, duration) that are kept ready
_MOST_KNOWN = 16


@dataclass(frozen=True)
class Compact:
    """Projected matrices; what the cache keeps. The even states come first."""

    #: at k = h = 1, (states, states)
    conduction: Array
    surface: Array
    clamp: Array
    transport: Array  #: at one turn of the tool in 2 pi seconds, (even, odd)
    #: as in ``projection.py``, (positions, even), (2, positions) and (positions,)
    probe: Array
    shoulder: Array
    rim: Array
    rest_k_per_w: Array
    axial_mm: Array


def load_or_compact(
    parameters: CanisterParameters, cache: Path | None = None, progress: Progress | None = None
) -> CompactCanister:
    """The compact model, from the cache or made now; arguments and errors as of ``reduced.load_or_reduce``."""

    def make() -> Compact:
        return compact_of(projection_of(parameters, cache, progress), parameters)

    return CompactCanister(parameters, kept(Compact, parameters, cache, make, progress))


def compact_of(projection: Projection, parameters: CanisterParameters, tolerance_k: float = TOLERANCE_K) -> Compact:
    """Choose the vectors by the Gramians of even and odd part, and project on them.

    With heat made and temperature taken at the same places the system in the tool's frame is its own adjoint but for
    the direction of travel, which changes the sign of the odd part alone: inputs and outputs have the same Gramians.
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
        parities.append(np.concatenate([t @ leading[a:b] for (a, b), t in zip(blocks, turn, strict=True)]))

    def projected(matrix: Array) -> Array:
        of_parity = [sum(v[a:b].T @ (matrix[a:b, : b - a] @ v[a:b]) for a, b in blocks) for v in parities]
        return np.asarray(block_diag(*of_parity))

    even, odd = parities
    return Compact(
        **{name: projected(getattr(q, name)) for name in ("conduction", "surface", "clamp")},
        transport=even.T @ (q.mode[:, None] * odd),
        **{name: table @ even for name, table in tables.items()},
        rest_k_per_w=q.rest_k_per_w,
        axial_mm=q.axial_mm,
    )


def _gramians(q: Projection, tables: list[Array], decay: Array, radius_mm: float) -> tuple[Array, Array]:
    """Gramians of the even and of the odd part, in the eigenvectors of typical copper, mean of positions and speeds.

    The response to an impulse at a position is known, ``b exp(-decay t)`` times cosine and sine of ``s m t``; so are
    the integrals over all time.
    """
    scale = 1e3 * _POWER_KW / (2.0 * pi * TYPICAL["rho_c"] * len(q.axial_mm) * len(tables) * len(_SPEEDS_MM_PER_S))
    products = scale * np.sum([one.T @ one for one in tables], axis=0)
    sums = decay[:, None] + decay
    apart, together = q.mode[:, None] - q.mode, q.mode[:, None] + q.mode
    even, odd = np.zeros_like(products), np.zeros_like(products)
    for speed in _SPEEDS_MM_PER_S:
        one, other = (0.5 * products * sums / (sums**2 + (speed / radius_mm * m) ** 2) for m in (apart, together))
        even += one + other
        odd += one - other
    return even, odd


def _leading(gramian: Array, tolerance_k: float) -> Array:
    """Its eigenvectors above the tolerance, (states, n)."""
    from scipy.sparse.linalg import eigsh

    count = len(gramian)
    values, vectors = eigsh(gramian, k=min(_MOST, count - 1), v0=np.ones(count))  # a start: the same every time
    return np.asarray(vectors[:, values > tolerance_k][:, ::-1])


class CompactCanister(HeatModel):
    """The stir zone's heat, stepped exactly for a power, a traverse speed and an axial position that are held.

    Parameters and compact model are of the same geometry.
    """

    def __init__(self, parameters: CanisterParameters, compact: Compact) -> None:
        p, q = parameters, compact
        source = p.into_copper(q.probe, q.shoulder) / (2.0 * pi * p.heat_capacity_j_per_m3_k)
        rest = p.into_copper(*q.rest_k_per_w) * (TYPICAL["k"] / p.conductivity_w_per_m_k)
        super().__init__(p, q.axial_mm, source, q.rim, rest)
        self._even, odd = q.transport.shape
        self.states = self._even + odd  #: real numbers in a state
        matrix = p.conductivity_w_per_m_k * q.conduction + p.surface_w_per_m2_k * q.surface
        self._decay = (matrix + p.clamp_w_per_m2_k * q.clamp) / p.heat_capacity_j_per_m3_k
        self._transport = q.transport
        self._known: dict[tuple[float, float], tuple[Array, Array]] = {}

    def initial(self, *, axial_mm: float = 0.0) -> CanisterState:
        """See :meth:`HeatModel.initial`."""
        return CanisterState(np.zeros(self.states), 0.0, self._checked(axial_mm))

    def step(
        self, state: CanisterState, power_kw: float, traverse_mm_per_s: float, axial_mm: float, dt_s: float = 0.1
    ) -> CanisterState:
        """See :meth:`HeatModel.step`."""
        self._check(power_kw, traverse_mm_per_s, axial_mm, dt_s)
        source, _, _ = self._at(axial_mm)
        kept_part, response = self.over(traverse_mm_per_s, dt_s)
        modes = kept_part @ state.modes
        modes += response @ (power_kw * source)
        turned = traverse_mm_per_s * dt_s / self.parameters.outer_radius_mm
        return CanisterState(modes, state.angle_rad + turned, axial_mm, power_kw)

    def over(self, traverse_mm_per_s: float, dt_s: float) -> tuple[Array, Array]:
        """What a step keeps of the states, (states, states), and what it makes of a source, (states, even ones)."""
        key = (traverse_mm_per_s, dt_s)
        if key not in self._known:
            from scipy.linalg import expm

            matrix = -self._decay
            turning = traverse_mm_per_s / self.parameters.outer_radius_mm * self._transport
            matrix[: self._even, self._even :] -= turning
            matrix[self._even :, : self._even] += turning.T
            both = np.zeros((2 * self.states, 2 * self.states))
            both[: self.states] = np.concatenate([matrix, np.eye(self.states)], axis=1)
            with_source = expm(dt_s * both)[: self.states]
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[key] = with_source[:, : self.states], with_source[:, self.states :][:, : self._even]
        return self._known[key]

    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """See :meth:`HeatModel.stir_zone_temperature_c`."""
        _, rim, rest = self._at(state.axial_mm)
        return float(self.copper.temperature_c(rim @ state.modes[: self._even] + rest * state.power_kw))

    def tables(self) -> dict[str, Array]:
        """The model as numbers, for another language: of which :meth:`over` is made, and what is tabulated."""
        return {
            "decay": self._decay,
            "transport": self._transport,
            "axial_mm": self._axial_mm,
            "source": self._source,
            "rim": self._rim,
            "rest": self._rest,
            "theta_k": self.copper.theta_k,
            "grid_c": self.copper.grid_c,
        }
