"""Makes a solver by name."""

from __future__ import annotations

from fsw_model import ModelParameters
from fsw_nmpc import kernel_build
from fsw_nmpc.horizon import horizon_of
from fsw_nmpc.ocp import Solver

SOLVERS = ("auto", "rti", "casadi", "reference")


def make_solver(kind: str, parameters: ModelParameters, blocks: int, max_iterations: int) -> tuple[Solver, str]:
    """Make a solver, and say in words which it is.

    Parameters
    ----------
    kind : str
        One of ``SOLVERS``; ``auto`` is ``rti`` wherever that is possible.
    parameters : ModelParameters
    blocks : int
        20 or 54.
    max_iterations : int
        Cap of the interior-point method (of ``rti`` and ``casadi``).

    Raises
    ------
    ValueError
        If there is no such solver, or ``rti`` is asked for and impossible.
    """
    if kind not in SOLVERS:
        raise ValueError(f"solver {kind!r} is unknown; known: {', '.join(SOLVERS)}")
    horizon = horizon_of(parameters, blocks)
    why = ""
    if kind in ("auto", "rti"):
        from fsw_nmpc.solvers.rti import RtiSolver

        try:
            library = kernel_build.ensure()
            solver = RtiSolver(parameters, horizon, library, max_iterations)
            return solver, f"rti, {blocks} blocks, C kernel {library.name}"
        except (RuntimeError, OSError) as error:
            if kind == "rti":
                raise ValueError(f"solver rti: {error}") from None
            why = f" (no C kernel: {error})"
    if kind == "reference":
        from fsw_nmpc.solvers.reference import ReferenceSolver

        return ReferenceSolver(parameters, horizon), f"reference, {blocks} blocks, cold IPOPT: too slow for real time"
    from fsw_nmpc.solvers.casadi_qp import CasadiSolver

    return CasadiSolver(parameters, horizon, max_iterations), f"casadi, {blocks} blocks{why}"
