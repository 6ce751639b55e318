"""The NMPC's problem by itself: predicted, solved, by another solver.

Random ones over the whole working range.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fsw_control import Limits
from fsw_model import ModelParameters, nominal
from fsw_nmpc import NmpcController
from fsw_nmpc.horizon import Horizon, horizon_of
from fsw_nmpc.library import KERNEL, Library, SolveStatus, State, pointer, tuning_of
from fsw_nmpc.tuning import PAPER, Settings, Tuning

Vector = NDArray[np.float64]
LIMITS = Limits()


def make_library(
    blocks: int = 20,
    parameters: ModelParameters | None = None,
    tuning: Tuning | None = None,
    max_iterations: int = 100,
    horizon: Horizon | None = None,
) -> Library:
    """A library with the horizon of ``blocks`` blocks, or with ``horizon``."""
    p = parameters or nominal()
    settings = Settings(p, tuning or Tuning(), LIMITS, max_iterations=max_iterations)
    return Library(p, horizon or horizon_of(p, blocks), tuning_of(settings))


class Solver(Protocol):
    """Solves the problem of a tick in place of the library's own solver."""

    def solve(self, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
        """SolveStatus, moves and the outputs they lead to; never raises on a bad problem."""
        ...


def use_solver(controller: NmpcController, solver: Solver) -> None:
    """Let a controller solve its problems by another solver, as long as its horizon stays."""
    library = controller.library

    def step() -> None:
        if begin(library):
            moves = np.array(list(library.state.plan.start[0 : 2 * library.horizon.n_blocks]))
            status, *results = solver.solve(problem_of(library), moves)
            arrays = (pointer(np.ascontiguousarray(array)) for array in results)
            library.lib.fsw_nmpc_end(library.state, *arrays, status, library.output)

    library.step = step  # type: ignore[method-assign]


def problem_of(library: Library) -> Any:
    """The problem of the tick, a ``fsw_problem *`` into the library's state."""
    return KERNEL.ffi.addressof(library.state, "problem")


def begin(library: Library) -> bool:
    """First half of a tick; whether there is a problem to solve."""
    return bool(library.lib.fsw_nmpc_begin(library.state, library.input, library.output))


def predict(library: Library, start: Any, moves: Vector) -> tuple[Vector, Vector, Vector, Vector]:
    """Outputs (n_out,) and their sensitivities (n_out, 2 n_blocks) along moves (2 n_blocks,) from a ``fsw_start *``.

    Raises
    ------
    FloatingPointError
        If the prediction is not finite.
    """
    h, w, model = library.horizon, library.state.workspace, library.state.model
    address = KERNEL.ffi.addressof
    if library.lib.fsw_predict(
        address(library.state, "model"), start, pointer(np.ascontiguousarray(moves)), address(w)
    ):
        raise FloatingPointError("the prediction is not finite")
    outputs, by = (np.frombuffer(KERNEL.ffi.buffer(part)) for part in (w.output, w.by))
    outputs = outputs[: 2 * h.n_out].reshape(2, -1).copy()
    widths = np.array([*model.depth_width[0 : h.n_out], *model.temperature_width[0 : h.n_out]])
    rows = by.reshape(len(w.by), -1)[: 2 * h.n_out, : 2 * h.n_blocks]
    within = np.arange(2 * h.n_blocks) < widths[:, np.newaxis]
    return *outputs, *np.where(within, rows, 0.0).reshape(2, h.n_out, -1)


def solve(library: Library, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
    """One real-time iteration about ``moves`` (2 n_blocks,): status, moves, outputs.

    The rest is in ``output``.
    """
    matrices = (
        np.array(moves, dtype=np.float64),
        np.zeros(library.horizon.n_out),
        np.zeros(library.horizon.n_out),
    )
    status = library.lib.fsw_solve(library.state, problem, *map(pointer, matrices), library.output)
    return SolveStatus(status), *matrices


def random_tuning(rng: np.random.Generator) -> Tuning:
    """A preset, or weights drawn over decades."""
    if rng.random() < 0.5:
        return PAPER if rng.random() < 0.5 else Tuning()

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    return Tuning(
        trajectory="recentred",
        dead_band_depth_mm=decades(-4, -2),
        dead_band_temperature_c=decades(-2, 0),
        weight_depth_per_mm=decades(0, 2.5),
        weight_temperature_per_c=decades(-1, 1),
        depth_scale_mm=float(rng.choice([0.0, decades(-2.5, 0)])),
        temperature_scale_c=float(rng.choice([0.0, decades(-1, 1)])),
        move_force_per_kn=decades(-2, 0.5),
        move_speed_per_rpm=decades(-3, 0),
        full_move_cost=float(rng.choice([0.0, decades(-1, 0)])),
    )


def random_start(rng: np.random.Generator, horizon: Horizon, parameters: ModelParameters) -> Any:
    """A start that a weld could pose.

    Any state, history, input and disturbance that limits allow.
    """
    p, n = parameters, horizon.n_history
    rise = rng.normal(0.0, 20.0, 2)
    history = np.zeros((n, 3))
    history[:, 0] = rise[1] / p.thermal_gain_c_per_kw + np.cumsum(rng.normal(0.0, 0.3, n))
    history[:, 1:] = rng.normal(0.0, 0.3, (n, 2))
    start = KERNEL.new(
        "fsw_start",
        x=(
            rng.uniform(-0.4, 0.4),
            rng.normal(0.0, 0.05),
            rise[0],
            rise[0] + rng.normal(),
            rng.uniform(900.0, 1200.0),
        ),
        force_kn=rng.uniform(LIMITS.force_min_kn, LIMITS.force_max_kn),
        speed_rpm=rng.uniform(LIMITS.speed_min_rpm, LIMITS.speed_max_rpm),
    )
    start.x[State.FORCE], start.x[State.HEAT] = rng.normal(0.0, 0.5), rng.normal()
    start.x[State.SCALE] = rng.uniform(0.85, 1.15)
    start.x[State.DEPTH_OFFSET], start.x[State.TEMP_OFFSET] = rng.normal(0.0, (0.05, 3.0))
    start.speed_offset_rpm = rng.normal(0.0, 2.0)
    start.x[State.DEPTH_GAIN] = rng.uniform(0.7, 1.4)
    for q, rate in enumerate(rng.normal(0.0, (2e-3, 0.2))):
        start.drift[q][0 : horizon.n_out] = (
            30.0 * rate * -np.expm1(-horizon.time_s / 30.0)
        ).tolist()
    start.history[0 : 3 * n] = history.ravel().tolist()
    return start


def random_problem(
    rng: np.random.Generator,
    library: Library,
    parameters: ModelParameters,
    tuning: Tuning | None = None,
) -> Any:
    """A problem from a random start to a random set-point.

    Gives the library a random tuning unless one is given.
    """
    p, h = parameters, library.horizon
    tuning = tuning or random_tuning(rng)
    library.configure(
        tuning_of(Settings(p, tuning, LIMITS, max_iterations=library.state.tuning.max_iterations))
    )
    start = random_start(rng, h, p)
    problem = KERNEL.new("fsw_problem", start=start[0])
    temperature = p.operating_temperature_c + start.x[3] + start.x[State.TEMP_OFFSET]
    softening = 1.0 + p.softening_per_c * start.x[3]
    depth = (p.operating_depth_mm + start.x[0] + start.x[1]) * softening
    depth += start.x[State.DEPTH_OFFSET]
    small = rng.random() < 0.3
    set_points = (
        (depth + rng.normal(0.0, 1e-3) if small else rng.uniform(2.2, 3.1)),
        temperature + rng.normal(0.0, 0.1 if small else 20.0),
    )
    bands = tuning.dead_band_depth_mm, tuning.dead_band_temperature_c
    for q, (now, goal) in enumerate(zip((depth, temperature), set_points, strict=True)):
        centre = goal + (now - goal) * np.exp(-h.time_s / max(rng.uniform(0.0, 8.0), 1e-3))
        problem.low[q][0 : h.n_out] = (centre - bands[q]).tolist()
        problem.high[q][0 : h.n_out] = (centre + bands[q]).tolist()
    return problem


def random_moves(rng: np.random.Generator, horizon: Horizon) -> Vector:
    """Moves (2 n_blocks,) anywhere within their limits."""
    largest = np.tile([LIMITS.force_step_kn, LIMITS.speed_step_rpm], horizon.n_blocks)
    return np.asarray(
        largest * rng.uniform(-1.0, 1.0, 2 * horizon.n_blocks) * 10.0 ** rng.uniform(-2.0, 0.0)
    )
