"""The NMPC's problem put to other solvers, cold, for ``nmpc.py``: IPOPT, FATROP, SQP with PIQP, GEKKO, do-mpc.

All of them get the same problem: the steps and tables of the horizon, the moves, bounds,
dead-bands and weights. None gets help from a solution: moves start at zero. What a solver needs to
be told about a problem is made ready before its clock starts. Solvers of CasADi are given the
moves only (``fsw_test_support.nmpc_ipopt``), GEKKO and do-mpc the states of every step too; with
do-mpc the power under way in the dead time is a line of states.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import casadi as ca
import numpy as np

from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import depth_modes, friction_torque_nm, power_kw, process_torque_nm
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.library import Library, SolveStatus, Vector
from fsw_test_support.nmpc_ipopt import (
    ReferenceSolver,
    input_ranges,
    largest_moves,
    move_weights,
    weights,
)
from fsw_test_support.nmpc_prediction import N_START, start_vector


@dataclass(frozen=True, slots=True)
class Answer:
    """CPU time with the processes that a solver starts, its moves (None: failed), and what it says they cost."""

    cpu_s: float
    moves: Vector | None = None
    cost: float = np.nan


#: SQP with exact second derivatives; of CasADi's QP solvers PIQP takes them as they are, and is
#: the fastest that does
SQP = {
    **{f"print_{what}": False for what in ("header", "iteration", "status")},
    **{
        "qpsol": "piqp",
        "qpsol_options": {"error_on_fail": False},
        "error_on_fail": False,
        "max_iter": 50,
    },
}
FATROP = {"fatrop": {"print_level": 0, "max_iter": 500}, "expand": True}
Solve = Callable[[Any], Answer]
Kept = Callable[..., Any]


def rivals(parameters: ModelParameters, library: Library) -> dict[str, Solve | None]:
    """Solvers by name, None where one is not installed; for the library's horizon and its tuning of now."""
    h, t = library.horizon, library.state.tuning
    if h.n_blocks != h.n_out or t.depth_scale_mm or t.temperature_scale_c or t.full_move_cost:
        raise ValueError("the rivals are told L1 costs, and a move in every interval")
    return {
        "ipopt": by_casadi(parameters, library, "ipopt"),
        "sqp_piqp": by_casadi(parameters, library, "sqpmethod", SQP)
        if ca.has_conic("piqp")
        else None,
        "fatrop": by_casadi(parameters, library, "fatrop", FATROP)
        if ca.has_nlpsol("fatrop")
        else None,
        "gekko_apopt": gekko_apopt(parameters, h, t) if find_spec("gekko") else None,
        "do_mpc": DoMpc(parameters, h, t) if find_spec("do_mpc") else None,
    }


def cpu_now_s() -> float:
    """CPU time of this process and of those it has waited for: GEKKO's solvers are programs of their own."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def by_casadi(
    p: ModelParameters, library: Library, method: str, options: dict[str, Any] | None = None
) -> Solve:
    """A cold solver of CasADi on the moves alone."""
    oracle = ReferenceSolver(library, p, method=method, options=options)

    def solve(problem: Any) -> Answer:
        began = cpu_now_s()
        status, moves, _, _ = oracle.solve(problem, np.zeros(2 * library.horizon.n_blocks))
        cpu_s = cpu_now_s() - began
        return Answer(cpu_s, moves, oracle.cost) if status is SolveStatus.OK else Answer(cpu_s)

    return solve


def one_step(
    p: ModelParameters,
    mode: Any,
    state: Sequence[Any],
    inputs: Sequence[Any],
    disturbances: Sequence[Any],
    arriving: Sequence[Any],
    kept: Kept = lambda value: value,
) -> tuple[list[Any], list[Any], Any]:
    """One step of the prediction, as in ``fsw_test_support.nmpc_prediction``, of whatever can be added and multiplied.

    ``mode`` is a row of the horizon's table; ``arriving`` the delayed power on copper and tool.
    ``kept`` is told every value that is worth a variable of its own and returns what stands for
    it. Returns state, power (3) and depth at the end of the step.
    """
    creep, slow, copper, tool, motor = state
    force_offset, heat_offset, scale, speed_offset, gain = disturbances
    poles, gains = depth_modes(p)
    acting, speed = inputs[0] + force_offset, inputs[1] + speed_offset
    pushed = acting - p.operating_force_kn
    settled = p.operating_depth_mm + gain * float(-gains[2] / poles[2]) * pushed
    depth = kept((settled + creep + slow) * (1.0 + p.softening_per_c * tool))
    left = kept(scale * process_torque_nm(p, acting, depth))
    creep, slow = (
        kept(creep + gain * mode[0] * pushed),
        kept(mode[1] * slow + gain * mode[2] * pushed),
    )
    tool = kept(mode[6] * copper + mode[7] * tool + mode[9] * heat_offset + arriving[1])
    copper = kept(mode[5] * copper + mode[8] * heat_offset + arriving[0])
    depth = kept((settled + creep + slow) * (1.0 + p.softening_per_c * tool))
    right = kept(scale * process_torque_nm(p, acting, depth))
    begin, friction = left - mode[4] * (right - left), friction_torque_nm(p, speed)
    rest = kept(motor - friction - begin)
    power = [
        kept(power_kw(begin, speed) - p.operating_power_kw),
        kept(power_kw(right - left, speed)),
        kept(power_kw(rest, speed)),
    ]
    motor = kept(right + friction - mode[4] * (right - left) + mode[3] * rest)
    return [creep, slow, copper, tool, motor], power, depth


def disturbances_of(start: Sequence[float]) -> tuple[float, ...]:
    """What :func:`one_step` is told of a start: offsets of force and heat, scale, offset of speed, depth's gain."""
    return start[7], start[8], start[9], start[12], start[13]


def along(
    p: ModelParameters, h: Horizon, problem: Any, moves: Sequence[Any], kept: Kept
) -> Iterator[tuple[int, Any, Any, Any, Any]]:
    """The whole prediction: interval, depth, temperature, force, speed at every output point."""
    start = start_vector(problem.start, h).tolist()
    depth_drift, temperature_drift = start[N_START : N_START + h.n_out], start[N_START + h.n_out :]
    state, force, speed, depth_offset, temperature_offset = (
        start[:5],
        start[5],
        start[6],
        start[10],
        start[11],
    )
    disturbances = disturbances_of(start)
    history = list(problem.start.history[0 : 3 * h.n_history])
    segments: list[Any] = [history[3 * j : 3 * j + 3] for j in range(h.n_history)]
    interval = -1
    for k in range(len(h.step_length_s)):
        if h.step_interval[k] != interval:
            interval = int(h.step_interval[k])
            force, speed = kept(force + moves[2 * interval]), kept(speed + moves[2 * interval + 1])
        arriving = [0.0, 0.0]
        for e in range(h.weight_start[k], h.weight_start[k + 1]):
            w, segment = h.weight[e].tolist(), segments[h.weight_segment[e]]
            arriving = [
                arriving[i] + sum(w[3 * i + j] * segment[j] for j in range(3)) for i in range(2)
            ]
        mode = h.modes[k].tolist()
        state, power, depth = one_step(
            p, mode, state, (force, speed), disturbances, arriving, kept
        )
        segments.append(power)
        if h.out_step[interval] == k:
            temperature = (
                p.operating_temperature_c
                + state[3]
                + temperature_offset
                + temperature_drift[interval]
            )
            yield interval, depth + depth_offset + depth_drift[interval], temperature, force, speed


def gekko_apopt(p: ModelParameters, h: Horizon, t: Any) -> Solve:
    """Every step's equations in GEKKO, solved locally by APOPT from the path without moves."""
    from gekko import GEKKO

    still = [0.0] * (2 * h.n_out)

    def solve(problem: Any) -> Answer:
        guesses: list[float] = []

        def noted(value: float) -> float:
            guesses.append(value)
            return value

        for _ in along(p, h, problem, still, noted):
            pass
        m, guess = GEKKO(remote=False), iter(guesses)

        def kept(expression: Any) -> Any:
            variable = m.Var(value=next(guess))
            m.Equation(variable == expression)
            return variable

        moves: list[Any] = []
        for j in range(2 * h.n_out):
            largest = largest_moves(t)[j % 2]
            moves.append(m.Var(value=0.0, lb=-largest, ub=largest))
            size = m.Var(value=0.0, lb=0.0)
            m.Equation(size >= moves[j])
            m.Equation(size >= -moves[j])
            m.Minimize(move_weights(t)[j % 2] * size)
        for i, depth, temperature, *inputs in along(p, h, problem, moves, kept):
            for q, output in enumerate((depth, temperature)):
                inputs[q].lower, inputs[q].upper = input_ranges(t)[q]
                if (h.depth_width, h.temperature_width)[q][i] == 0:
                    continue
                over = m.Var(value=0.0, lb=0.0)
                m.Equation(output - over <= problem.high[q][i])
                m.Equation(output + over >= problem.low[q][i])
                m.Minimize(weights(t)[q] * over)
        m.options.SOLVER = 1
        m.options.MAX_ITER = 1000
        began = cpu_now_s()
        try:
            m.solve(disp=False)
            solved = m.options.APPSTATUS == 1
        except Exception:  # GEKKO raises nothing more special when the solver fails
            solved = False
        cpu_s = cpu_now_s() - began
        found = Answer(cpu_s)
        if solved:
            found = Answer(
                cpu_s,
                np.array([move.value[0] for move in moves], dtype=float),
                float(m.options.OBJFCNVAL),
            )
        m.cleanup()
        return found

    return solve


class DoMpc:
    """A discrete model of do-mpc whose tables change with the step; moves are zero where no interval begins."""

    _STATES, _INPUTS = ("creep", "slow", "copper", "tool", "motor"), ("force", "speed")
    _MOVES, _SIZES, _OVERS = (
        ("by_force", "by_speed"),
        ("force_size", "speed_size"),
        ("over_z", "over_t"),
    )

    def __init__(self, p: ModelParameters, h: Horizon, t: Any) -> None:
        self._p, self._h, self._t = p, h, t
        self._n_steps = len(h.step_length_s)
        self._begins = np.diff(h.step_interval, prepend=-1) > 0
        self._reached = np.column_stack([h.depth_width, h.temperature_width]) > 0
        self._bands, self._disturbance = np.zeros((self._n_steps, 4)), np.zeros(5)
        tables = self._tables()
        self._mpc = self._controller(self._model(tables.shape[1]), tables)
        for k in range(self._n_steps):
            held = [] if self._begins[k] else [*self._MOVES, *self._SIZES]
            is_out = k in h.out_step
            held += [
                self._OVERS[q]
                for q in range(2)
                if not (is_out and self._reached[h.step_interval[k], q])
            ]
            for name in held:
                self._mpc.lb_opt_x["_u", k, 0, name] = self._mpc.ub_opt_x["_u", k, 0, name] = 0.0

    def _tables(self) -> Vector:
        """What changes from step to step, a row each: the modes, and the weights of the powers under way."""
        h = self._h
        tables = np.zeros((self._n_steps, 10 + 6 * h.n_history))
        tables[:, :10] = h.modes
        for k in range(self._n_steps):
            for e in range(h.weight_start[k], h.weight_start[k + 1]):
                place = (
                    h.weight_segment[e] - k
                )  # in the line, which has moved on by one segment with every step
                if not 0 <= place < h.n_history:
                    raise ValueError("a step looks back further than the line of states is long")
                tables[k, 10 + 6 * place : 16 + 6 * place] += h.weight[e]
        return tables

    def _model(self, width: int) -> Any:
        import casadi as ca
        import do_mpc as toolbox

        n_line = self._h.n_history
        model = toolbox.model.Model("discrete")
        x = [model.set_variable("_x", name) for name in self._STATES]
        before = [model.set_variable("_x", name) for name in self._INPUTS]
        line = model.set_variable("_x", "line", (n_line, 3))
        move = [model.set_variable("_u", name) for name in self._MOVES]
        for name in (*self._SIZES, *self._OVERS):
            model.set_variable("_u", name)
        table = model.set_variable("_tvp", "table", (width, 1))
        model.set_variable("_tvp", "band", (4, 1))
        disturbance = model.set_variable("_tvp", "disturbance", (5, 1))
        inputs = [before[q] + move[q] for q in range(2)]
        weight = ca.reshape(table[10:], 6, n_line).T
        arriving = [ca.sum1(ca.sum2(weight[:, 3 * i : 3 * i + 3] * line)) for i in range(2)]
        mode, disturbances = ca.vertsplit(table[:10]), ca.vertsplit(disturbance)
        after, power, depth = one_step(self._p, mode, x, inputs, disturbances, arriving)
        for name, value in zip((*self._STATES, *self._INPUTS), (*after, *inputs), strict=True):
            model.set_rhs(name, value)
        model.set_rhs("line", ca.vertcat(line[1:, :], ca.horzcat(*power)))
        for name, value in (("depth", depth), ("tool_end", after[3])):
            model.set_expression(name, value)
        model.setup()
        return model

    def _controller(self, model: Any, tables: Vector) -> Any:
        import casadi as ca
        import do_mpc as toolbox

        t, mpc = self._t, toolbox.controller.MPC(model)
        move, size, over = (
            [model.u[name] for name in names] for names in (self._MOVES, self._SIZES, self._OVERS)
        )
        band, outputs = model.tvp["band"], (model.aux["depth"], model.aux["tool_end"])
        mpc.settings.n_horizon, mpc.settings.t_step, mpc.settings.store_full_solution = (
            self._n_steps,
            STEP_S,
            False,
        )
        mpc.settings.supress_ipopt_output()
        cost = sum(move_weights(t)[q] * size[q] + weights(t)[q] * over[q] for q in range(2))
        mpc.set_objective(mterm=ca.DM(0), lterm=cost)
        mpc.set_rterm(**dict.fromkeys(self._MOVES, 0.0))
        for q, output in enumerate(outputs):
            for name, expression in {
                "low": band[2 * q] - output - over[q],
                "high": output - band[2 * q + 1] - over[q],
                "up": move[q] - size[q],
                "down": -move[q] - size[q],
            }.items():
                mpc.set_nl_cons(f"{name}{q}", expression, 0.0)
            mpc.bounds["lower", "_u", self._MOVES[q]] = -largest_moves(t)[q]
            mpc.bounds["upper", "_u", self._MOVES[q]] = largest_moves(t)[q]
            mpc.bounds["lower", "_u", self._SIZES[q]] = mpc.bounds[
                "lower", "_u", self._OVERS[q]
            ] = 0.0
            name = self._INPUTS[q]
            mpc.bounds["lower", "_x", name], mpc.bounds["upper", "_x", name] = input_ranges(t)[q]
        template = mpc.get_tvp_template()

        def at(_: float) -> Any:
            for k in range(self._n_steps + 1):
                step = min(k, self._n_steps - 1)
                template["_tvp", k, "table"], template["_tvp", k, "band"] = (
                    tables[step],
                    self._bands[step],
                )
                template["_tvp", k, "disturbance"] = self._disturbance
            return template

        mpc.set_tvp_fun(at)
        mpc.setup()
        return mpc

    def __call__(self, problem: Any) -> Answer:
        """Solve a problem; its first moves."""
        h, t, mpc = self._h, self._t, self._mpc
        start = start_vector(problem.start, h)
        drifts = start[N_START:].reshape(2, -1)
        bands = np.tile([-np.inf, np.inf] * 2, (self._n_steps, 1))
        shown = (
            0.0,
            self._p.operating_temperature_c,
        )  # where the outputs that the constraints are on are zero
        for q in range(2):
            reached = self._reached[:, q]
            offset, used = start[10 + q] + shown[q] + drifts[q][reached], h.out_step[reached]
            for column, values in enumerate((problem.low[q], problem.high[q])):
                bands[used, 2 * q + column] = np.array(list(values[0 : h.n_out]))[reached] - offset
        self._bands, self._disturbance = (
            np.clip(bands, -1e4, 1e4),
            np.array(disturbances_of(start)),
        )
        history = np.array(list(problem.start.history[0 : 3 * h.n_history])).reshape(-1, 3)
        first = np.concatenate([start[:7], history.ravel(order="F")])
        mpc.reset_history()
        mpc.x0 = first
        mpc.set_initial_guess()
        began = cpu_now_s()
        mpc.make_step(first)
        cpu_s = cpu_now_s() - began
        if not mpc.solver_stats["success"]:
            return Answer(cpu_s)

        def found(name: str) -> Vector:
            return np.array([float(mpc.opt_x_num["_u", k, 0, name]) for k in range(self._n_steps)])

        costs = [
            move_weights(t)[q] * found(self._SIZES[q]) + weights(t)[q] * found(self._OVERS[q])
            for q in range(2)
        ]
        moves = np.column_stack([found(name)[self._begins] for name in self._MOVES])
        return Answer(cpu_s, moves.ravel(), float(np.sum(costs)))
