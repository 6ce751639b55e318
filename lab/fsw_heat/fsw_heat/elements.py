"""Finite elements for one Fourier mode of the heat in the canister's end, by scikit-fem.

The canister is a body of revolution and conduction is linear in theta (``heat_model.py``). So its
Fourier modes around the circumference, ``theta = Re sum_m e_m theta_m(r, z) exp(i m angle)``, e_0
= 1 and e_m = 2, do not act on each other, and each is a problem in (r, z): ``rho c mass theta_m' +
(k stiffness(m) + h surface + h_c clamp) theta_m = load_m``. The moving tool only turns the phase
of the load.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fsw_control.schema.extensions import Extra
from fsw_control.schema.models import InputError
from fsw_heat.heat_model import Array
from fsw_plant.canister import CanisterParameters

EXTRA = Extra("fsw-lab", "canister", ("skfem", "meshio", "threadpoolctl"))

#: growth of the elements away from where the tool passes
_GROWTH = 1.4
_LONGEST_M = 0.1


@dataclass(frozen=True)
class Cloud:
    """Weighted points about the tool, at an angle ahead of it; weights add up to 1."""

    r_m: Array
    z_m: Array
    angle_rad: Array
    weight: Array

    def cosines(self, modes: int) -> Array:
        """Weights of each point in the modes 0 to ``modes`` - 1.

        The cloud is even in the angle.
        """
        return np.asarray(self.weight * np.cos(np.arange(modes)[:, None] * self.angle_rad))


def one_thread() -> AbstractContextManager[Any]:
    """Linear algebra in one thread.

    For matrices of this size more of them only wait for each other.
    """
    return extra("threadpoolctl").threadpool_limits(1)  # type: ignore[no-any-return]


def extra(module: str) -> Any:
    """Module of the extra ``canister``; InputError where it is not installed."""
    return EXTRA.module(module, "the canister's heat")


class Elements:
    """Mesh and matrices of the canister's end."""

    def __init__(self, parameters: CanisterParameters) -> None:
        skfem = extra("skfem")  # only the field and the reduction need it
        p = self.parameters = parameters
        self.outer_m, self.inner_m = (
            1e-3 * p.outer_radius_mm,
            1e-3 * (p.outer_radius_mm - p.wall_mm),
        )
        self.rim_m = 1e-3 * p.rim_mm
        self._plate_m = (1e-3 * p.lid_from_mm, 1e-3 * (p.lid_from_mm + p.lid_mm))
        self._has_plate = p.shape == "cylinder" and p.lid_mm > 0.0
        self._r_lines, self._z_lines = self._lines()
        whole = skfem.MeshQuad.init_tensor(self._r_lines, self._z_lines)
        r, z = whole.p[:, whole.t].mean(axis=1)
        low, high = self._plate_m
        self.mesh = whole.restrict(np.flatnonzero((r > self.inner_m) | ((z > low) & (z < high))))
        self.basis = skfem.Basis(self.mesh, skfem.ElementQuad2(), intorder=6)
        self.size = int(self.basis.N)  #: unknowns of one mode
        self._element_at = np.full((len(self._r_lines) - 1, len(self._z_lines) - 1), -1)
        self._element_at[self._cell(*self.mesh.p[:, self.mesh.t].mean(axis=1))] = np.arange(
            self.mesh.t.shape[1]
        )
        self._assemble()

    def _lines(self) -> tuple[Array, Array]:
        """Lines of the mesh in r and z; fine where the tool passes."""
        p = self.parameters
        h = 1e-3 * p.element_mm
        plate = self._plate_m if self._has_plate else (0.0, 0.0)
        fine_m = min(1e-3 * (p.lowest_mm - p.shoulder_radius_mm), plate[0]) - 2.0 * h
        down = fine_m - _growing(fine_m + 1e-3 * p.tube_mm, h)
        lines = [down, np.array([-1e-3 * p.clamp_from_mm, -1e-3 * p.clamp_to_mm])]
        lines += [_even(a, b, h) for a, b in pairwise(sorted({fine_m, *plate, 0.0, self.rim_m}))]
        r = _even(self.inner_m, self.outer_m, h)
        if self._has_plate:
            r = np.concatenate([(self.inner_m - _growing(self.inner_m, h))[::-1], r])
        return np.unique(np.round(r, 7)), np.unique(np.round(np.concatenate(lines), 7))

    def _assemble(self) -> None:
        from skfem import BilinearForm, FacetBasis

        p = self.parameters
        radius = (lambda w: w.x[0]) if p.shape == "cylinder" else (lambda w: self.outer_m)
        mass = BilinearForm(lambda u, v, w: u * v * radius(w))
        gradient = BilinearForm(
            lambda u, v, w: (u.grad[0] * v.grad[0] + u.grad[1] * v.grad[1]) * radius(w)
        )
        around = BilinearForm(lambda u, v, w: u * v / radius(w))
        #: sparse matrices of 1, grad u grad v and u v / r2 in the copper; below, of 1 under the
        #: clamp and in the air
        self.mass, self.gradient, self.around = (
            form.assemble(self.basis).tocsc() for form in (mass, gradient, around)
        )

        clamped = BilinearForm(
            lambda u, v, w: (
                u
                * v
                * radius(w)
                * ((w.x[1] < -1e-3 * p.clamp_from_mm) & (w.x[1] > -1e-3 * p.clamp_to_mm))
            )
        )
        outer = self.mesh.facets_satisfying(
            lambda x: np.isclose(x[0], self.outer_m), boundaries_only=True
        )
        open_to_air = self.mesh.facets_satisfying(self._open_to_air, boundaries_only=True)

        def facets(where: Any) -> Any:
            return FacetBasis(self.mesh, self.basis.elem, facets=where, intorder=8)

        self.clamp = clamped.assemble(facets(outer)).tocsc()
        self.surface = mass.assemble(facets(open_to_air)).tocsc()

    def _open_to_air(self, x: Any) -> Any:
        """Outer surface, edge of the rim, its inside and the lid's top."""
        r, z = x
        is_open = np.isclose(r, self.outer_m) | np.isclose(z, self.rim_m)
        if self._has_plate:
            is_open |= (z > self._plate_m[1]) | np.isclose(z, self._plate_m[1])
        return is_open

    def stiffness(self, mode: int) -> Any:
        """Conduction of a mode at k = 1."""
        return self.gradient + mode**2 * self.around

    def _cell(self, r_m: Array, z_m: Array) -> tuple[Any, Any]:
        def index(lines: Array, x: Array) -> Any:
            return np.clip(np.searchsorted(lines, x, side="right") - 1, 0, len(lines) - 2)

        return index(self._r_lines, r_m), index(self._z_lines, z_m)

    def at(self, r_m: ArrayLike, z_m: ArrayLike) -> Any:
        """Sparse matrix from the unknowns of a mode to its values at n points.

        InputError for one off the copper.
        """
        from scipy.sparse import csr_matrix

        r, z = (np.ravel(np.asarray(x, dtype=np.float64)) for x in np.broadcast_arrays(r_m, z_m))
        close = 1e-6
        element = self._element_at[self._cell(r, z)]
        for dr, dz in (
            (-close, 0.0),
            (close, 0.0),
            (0.0, -close),
            (0.0, close),
        ):  # on an edge of the copper
            element = np.where(element < 0, self._element_at[self._cell(r + dr, z + dz)], element)
        off = (element < 0) | (r > self._r_lines[-1] + close) | (r < self._r_lines[0] - close)
        off |= (
            (z > self._z_lines[-1] + close) | (z < self._z_lines[0] - close) | ~np.isfinite(r + z)
        )
        if off.any():
            where = f"radius {1e3 * r[off][0]:g} mm, {1e3 * z[off][0]:g} mm above the joint line"
            raise InputError(f"no copper at {where}")
        corner = self.mesh.p[:, self.mesh.t[:, element]]
        u, v = corner[:, 1] - corner[:, 0], corner[:, 3] - corner[:, 0]  # sides of a rectangle
        x = np.array([r, z]) - corner[:, 0]
        local = np.array(
            [(x * u).sum(axis=0) / (u * u).sum(axis=0), (x * v).sum(axis=0) / (v * v).sum(axis=0)]
        )
        dofs = self.basis.element_dofs[:, element]
        values = np.array([self.basis.elem.lbasis(local, i)[0] for i in range(len(dofs))])
        columns = np.tile(np.arange(len(r)), (len(dofs), 1))
        return csr_matrix(
            (values.ravel(), (columns.ravel(), dofs.ravel())), shape=(len(r), self.size)
        )

    def functional(self, cloud: Cloud, modes: int) -> Array:
        """Mean over a cloud of each mode's test functions, (modes, size)."""
        return np.asarray((self.at(cloud.r_m, cloud.z_m).T @ cloud.cosines(modes).T).T)

    def probe(self, axial_m: float) -> Cloud:
        """Where the probe makes heat: evenly within its radius, over its length."""
        return self._round(axial_m, *_gauss(8, 0.0, self.parameters.probe_radius_mm), power=1)

    def rim(self, axial_m: float) -> Cloud:
        """Where the stir zone's temperature is taken: at the probe's radius, over its length."""
        return self._round(
            axial_m, np.array([self.parameters.probe_radius_mm]), np.ones(1), power=0
        )

    def shoulder(self, axial_m: float) -> Cloud:
        """Where the shoulder makes heat.

        On the surface outside the probe, torque x speed of an even shear stress.
        """
        p = self.parameters
        radii = _gauss(6, p.probe_radius_mm, p.shoulder_radius_mm)
        return self._round(axial_m, *radii, power=2, surface=True)

    def _round(
        self, axial_m: float, rho_mm: Array, weight: Array, power: int, surface: bool = False
    ) -> Cloud:
        """Points round the tool's axis; weights ``weight rho^power``."""
        depths, shares = np.array([self.outer_m]), np.ones(1)
        if not surface:
            inmost = self.outer_m - 1e-3 * self.parameters.probe_length_mm
            lines = self._r_lines[self._r_lines > inmost + 1e-9]
            pieces = [_gauss(3, a, b) for a, b in zip([inmost, *lines], lines, strict=False)]
            depths, shares = (np.concatenate(part) for part in zip(*pieces, strict=True))
        turn = (np.arange(32) + 0.5) * pi / 32
        rho, theta, r = (
            grid.ravel() for grid in np.meshgrid(1e-3 * rho_mm, turn, depths, indexing="ij")
        )
        share = (weight * rho_mm**power)[:, None, None] * np.ones((1, 32, 1)) * shares
        radius = r if self.parameters.shape == "cylinder" else self.outer_m
        share = share.ravel() / share.sum()
        return Cloud(r, axial_m + rho * np.cos(theta), rho * np.sin(theta) / radius, share)


@lru_cache(maxsize=1)
def elements_of(parameters: CanisterParameters) -> Elements:
    """The elements of a canister; the last ones are kept."""
    return Elements(parameters)


def _even(low: float, high: float, step: float) -> Array:
    return np.linspace(low, high, max(1, round((high - low) / step)) + 1)


def _gauss(points: int, low: float, high: float) -> tuple[Array, Array]:
    """Points and weights of Gauss and Legendre on an interval."""
    x, w = np.polynomial.legendre.leggauss(points)
    half = 0.5 * (high - low)
    return low + half * (x + 1.0), half * w


def _growing(length_m: float, first_m: float) -> Array:
    """From 0 to a length in steps that grow from the first."""
    steps = [first_m]
    while sum(steps) < length_m:
        steps.append(min(_GROWTH * steps[-1], max(_LONGEST_M, first_m)))
    lines = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(lines * (length_m / lines[-1]))
