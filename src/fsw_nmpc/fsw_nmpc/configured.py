"""The NMPC made from parameters, which may change while it runs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from fsw_control import Command, Measurement, Proposal, Reference
from fsw_control.parameters import defaults, load
from fsw_model import ModelParameters, nominal
from fsw_nmpc import kernel_build
from fsw_nmpc.controller import NmpcController
from fsw_nmpc.ocp import Solver
from fsw_nmpc.settings import Settings
from fsw_nmpc.solvers.choice import make_solver


class ConfiguredNmpc:
    """A :class:`fsw_control.Controller` made from the values of ``nmpc.yaml``.

    Every parameter but the model acts at runtime without a bump. A new solver is made in the background; the present
    one works on until it is ready.

    Parameters
    ----------
    values : mapping of str to Any, optional
        Parameters; what is missing has its default.
    log : callable, optional
        Told in one line which solver is used.

    Raises
    ------
    ValueError
        If the values cannot be used.
    """

    name = NmpcController.name
    tolerated_sensors: tuple[str, ...] = NmpcController.tolerated_sensors

    def __init__(self, values: Mapping[str, Any] | None = None, log: Callable[[str], object] | None = None) -> None:
        self._log = log or (lambda text: None)
        self._values = defaults(load("fsw_nmpc", "nmpc.yaml")) | dict(values or {})
        self.settings = s = Settings.of(self._values)
        self._parameters = ModelParameters.from_file(s.model) if s.model else nominal()
        solver, words = make_solver(s.solver, self._parameters, s.blocks, s.max_iterations)
        self.core = NmpcController(solver, self._parameters, s.tuning, s.limits, s.estimator, s.plan_reuse)
        self._maker: threading.Thread | None = None
        self._made: tuple[Settings, Solver, str] | None = None
        self._log(f"solver: {words}")

    def check(self, values: Mapping[str, Any]) -> str | None:
        """Return why these parameters cannot be used, or None."""
        try:
            settings = Settings.of(self._values | dict(values))
        except ValueError as error:
            return str(error)
        if settings.solver == "rti" and kernel_build.find() is None and kernel_build.compiler() is None:
            return "solver rti: the kernel is not built and there is no C compiler; use auto or casadi"
        return None

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take new parameters at runtime; the proposals do not jump.

        Raises
        ------
        ValueError
            If the values cannot be used.
        """
        merged = self._values | dict(values)
        new, old = Settings.of(merged), self.settings
        self._values, self.settings = merged, new
        self.core.plan_reuse = new.plan_reuse
        self.core.limits = new.limits
        self.core.estimator.configure(new.estimator)
        self.core.configure(new.tuning)
        if _solver_key(new) != _solver_key(old):
            self._prepare(new)

    def _prepare(self, settings: Settings) -> None:
        if self._maker is None:
            self._maker = threading.Thread(target=self._make, args=(settings,), name="nmpc solver", daemon=True)
            self._maker.start()

    def _make(self, settings: Settings) -> None:
        s = settings
        try:
            solver, words = make_solver(s.solver, self._parameters, s.blocks, s.max_iterations)
        except Exception as error:
            # Whatever keeps a solver from being made must not stop the one that works.
            solver, words = self.core.solver, f"{self.core.solver.name} as before, since {s.solver} failed: {error}"
        self._made = (s, solver, words)

    def _take(self) -> None:
        """Go on with the solver that was made in the background, if it is ready."""
        if self._made is None:
            return
        made_for, solver, words = self._made
        self._maker = self._made = None
        if _solver_key(made_for) != _solver_key(self.settings):
            self._prepare(self.settings)
            return
        self.core.replace_solver(solver)
        self._log(f"solver: {words}")

    def finish_changes(self, timeout_s: float = 60.0) -> None:
        """Wait until a new solver is in use; for tests and offline studies."""
        while (maker := self._maker) is not None:
            maker.join(timeout_s)
            if maker.is_alive():
                raise TimeoutError(f"the solver is not ready after {timeout_s} s")
            self._take()

    def step(self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float) -> Proposal:
        """See :meth:`fsw_control.Controller.step`."""
        self._take()
        return self.core.step(measurement, reference, applied, dt_s)

    def reset(self, applied: Command) -> None:
        """Forget the past; the next step starts from ``applied``."""
        self.core.reset(applied)


def _solver_key(settings: Settings) -> tuple[str, int, int]:
    return settings.solver, settings.blocks, settings.max_iterations
