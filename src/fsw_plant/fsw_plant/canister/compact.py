"""The stir zone's heat with some ninety states in the tool's frame, for any speed and position.

In the frame of the tool an amplitude ``y = x exp(i m angle)`` of the reduced model
(``reduced.py``), with even part u and odd part w about the tool, obeys for the tool's angular
speed s

    u' = -decay u - s m w + b(z) P,    w' = -decay w + s m u,    theta = c(z) u.

Even and odd parts are projected on few vectors each by a Galerkin method: the decay stays
symmetric and the transport skew-symmetric, so the model is stable at every speed. Copper, losses
and clamp enter the small matrices afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from fsw_plant.canister.copper import TYPICAL, Array
from fsw_plant.canister.parameters import CanisterParameters
from fsw_plant.canister.stepped import CanisterState, HeatModel

#: number of step matrices (speed, duration) kept
_MOST_KNOWN = 16


@dataclass(frozen=True)
class Compact:
    """Projected matrices, the content of the cache; the even states come first."""

    #: at k = h = 1, (states, states)
    conduction: Array
    surface: Array
    clamp: Array
    transport: Array  #: for one turn of the tool in 2 pi seconds, (even, odd)
    #: as in ``projection.py``, (positions, even), (2, positions) and (positions,)
    probe: Array
    shoulder: Array
    rim: Array
    rest_k_per_w: Array
    axial_mm: Array


class CompactCanister(HeatModel):
    """The stir zone's heat, stepped exactly for constant power, traverse speed and axial position.

    Parameters and compact model must have the same geometry.
    """

    def __init__(self, parameters: CanisterParameters, compact: Compact) -> None:
        p, q = parameters, compact
        source = p.into_copper(q.probe, q.shoulder) / (2.0 * pi * p.heat_capacity_j_per_m3_k)
        rest = p.into_copper(*q.rest_k_per_w) * (TYPICAL["k"] / p.conductivity_w_per_m_k)
        super().__init__(p, q.axial_mm, source, q.rim, rest)
        self._even, odd = q.transport.shape
        self.states = self._even + odd  #: number of real states
        matrix = p.conductivity_w_per_m_k * q.conduction + p.surface_w_per_m2_k * q.surface
        self._decay = (matrix + p.clamp_w_per_m2_k * q.clamp) / p.heat_capacity_j_per_m3_k
        self._transport = q.transport
        self._known: dict[tuple[float, float], tuple[Array, Array]] = {}

    def initial(self, *, axial_mm: float = 0.0) -> CanisterState:
        """See :meth:`HeatModel.initial`."""
        return CanisterState(np.zeros(self.states), 0.0, self._checked(axial_mm))

    def step(
        self,
        state: CanisterState,
        power_kw: float,
        traverse_mm_per_s: float,
        axial_mm: float,
        dt_s: float = 0.1,
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
        """Transition, (states, states), and input matrix of a source, (states, even states)."""
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
            self._known[key] = (
                with_source[:, : self.states],
                with_source[:, self.states :][:, : self._even],
            )
        return self._known[key]

    def stir_zone_temperature_c(self, state: CanisterState) -> float:
        """See :meth:`HeatModel.stir_zone_temperature_c`."""
        _, rim, rest = self._at(state.axial_mm)
        return float(
            self.copper.temperature_c(rim @ state.modes[: self._even] + rest * state.power_kw)
        )

    def tables(self) -> dict[str, Array]:
        """The model as numbers for other languages: matrices of :meth:`over` and tables."""
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
