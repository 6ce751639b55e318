"""The NMPC's problem put to other solvers, for ``nmpc.py``: cold IPOPT, GEKKO with APOPT, do-mpc."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import RAD_PER_S_PER_RPM, process_torque_nm
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.ocp import Problem
from fsw_nmpc.solvers.reference import ReferenceSolver

Solve = Callable[[Problem], Any]
KW_PER_NM_RPM = RAD_PER_S_PER_RPM * 1e-3


def rivals(parameters: ModelParameters, horizon: Horizon) -> dict[str, tuple[int, Solve | None]]:
    """By name: how many problems to measure, and the solver (None where it is not installed)."""
    oracle = ReferenceSolver(parameters, horizon)
    return {
        "ipopt": (20, lambda problem: oracle.solve(problem, np.zeros(2 * horizon.n_blocks))),
        "gekko_apopt": (3, gekko_apopt(parameters, horizon) if find_spec("gekko") else None),
        "do_mpc": (3, do_mpc(parameters, horizon) if find_spec("do_mpc") else None),
    }


def gekko_apopt(p: ModelParameters, h: Horizon) -> Solve:
    """The same problem, every step of the same tables written as equations, solved locally by APOPT."""
    from gekko import GEKKO

    def solve(problem: Problem) -> None:
        m, e, lim = GEKKO(remote=False), problem.estimate, problem.limits
        force, speed = problem.applied.force_kn, problem.applied.speed_rpm
        state = [float(v) for v in e.x]
        history = e.history_kw.reshape(-1, 2).tolist()
        costs, interval = [], -1
        weights = problem.weights

        def depth_now() -> Any:
            return p.operating_depth_mm + state[0] + state[1] + state[2] + state[3]

        def power() -> Any:
            node = m.Var(value=43.6)
            torque = e.torque_scale * gekko_torque(m, p, force + e.force_offset_kn, depth_now())
            m.Equation(node == KW_PER_NM_RPM * speed * torque)
            return node

        def kept(value: float, expression: Any) -> Any:
            variable = m.Var(value=value)
            m.Equation(variable == expression)
            return variable

        for k in range(len(h.step_length_s)):
            if h.step_interval[k] != interval:
                interval = int(h.step_interval[k])
                by_force = m.Var(0.0, lb=-lim.force_step_kn, ub=lim.force_step_kn)
                by_speed = m.Var(0.0, lb=-lim.speed_step_rpm, ub=lim.speed_step_rpm)
                for move, weight in ((by_force, weights.move[0]), (by_speed, weights.move[1])):
                    size = m.Var(0.0, lb=0.0)
                    m.Equation(size >= move)
                    m.Equation(size >= -move)
                    costs.append(weight * size)
                before_force, before_speed = force, speed
                force = m.Var(problem.applied.force_kn, lb=lim.force_min_kn, ub=lim.force_max_kn)
                speed = m.Var(problem.applied.speed_rpm, lb=lim.speed_min_rpm, ub=lim.speed_max_rpm)
                m.Equation(force == before_force + by_force)
                m.Equation(speed == before_speed + by_speed)
            mode = h.modes[k].tolist()
            pushed = force + e.force_offset_kn - p.operating_force_kn
            left = power()
            heat = [mode[5] * state[3] + mode[6] * state[4] + mode[8], mode[7] * state[4] + mode[9]]
            for i in range(h.weight_start[k], h.weight_start[k + 1]):
                begin, end = history[h.weight_segment[i]]
                w = h.weight[i].tolist()
                heat = [heat[0] + w[0] * begin + w[1] * end, heat[1] + w[2] * begin + w[3] * end]
            state = [
                kept(float(e.x[0]), state[0] + mode[0] * pushed),
                kept(float(e.x[1]), mode[1] * state[1] + mode[2] * pushed),
                kept(float(e.x[2]), mode[3] * state[2] + mode[4] * pushed),
                kept(float(e.x[3]), heat[0]),
                kept(float(e.x[4]), heat[1]),
            ]
            history.append([left, power()])
            if h.out_step[interval] == k:
                for output, low, high, weight in (
                    (
                        depth_now() + e.depth_offset_mm,
                        problem.depth_low_mm[interval],
                        problem.depth_high_mm[interval],
                        weights.depth[interval],
                    ),
                    (
                        state[4] + e.temperature_offset_c,
                        problem.temperature_low_c[interval],
                        problem.temperature_high_c[interval],
                        weights.temperature[interval],
                    ),
                ):
                    over = m.Var(0.0, lb=0.0)
                    m.Equation(output - over <= float(high))
                    m.Equation(output + over >= float(low))
                    costs.append(float(weight) * over)
        m.Obj(m.sum(costs))
        m.options.SOLVER = 1
        m.options.MAX_ITER = 500
        m.solve(disp=False)

    return solve


def gekko_torque(m: Any, p: ModelParameters, force_kn: Any, depth_mm: Any) -> Any:
    """Process torque (19)-(22) for GEKKO."""
    radius_square = 2.0 * p.shoulder_radius_m * 1e-3 * depth_mm
    area = np.pi * (radius_square - p.contact_inner_radius_m**2)
    volume = 2.0 * np.pi / 3.0 * (radius_square**1.5 - p.contact_inner_radius_m**3) + p.probe_volume_m3
    return (p.sticking_stress_pa + p.friction_coefficient * 1e3 * force_kn / area) * volume


def do_mpc(p: ModelParameters, h: Horizon) -> Solve:
    """As near as do-mpc comes: the discrete model with the dead time as states, 54 intervals of 0.1 s, L1 by slacks."""
    import casadi as ca
    import do_mpc as toolbox

    n_out = h.n_out
    model = toolbox.model.Model("discrete")
    names = ("creep", "slow", "fast", "thermal", "temperature", "force", "speed")
    x = {name: model.set_variable("_x", name) for name in names}
    line = model.set_variable("_x", "line", (h.n_history, 2))
    u_names = ("by_force", "by_speed", "over_depth", "over_temperature", "size_force", "size_speed")
    by_force, by_speed = [model.set_variable("_u", name) for name in u_names][:2]
    model.set_variable("_tvp", "target", (4, 1))
    mode, w = h.modes[0].tolist(), h.weight[0].tolist()
    force, speed = x["force"] + by_force, x["speed"] + by_speed
    pushed = force - p.operating_force_kn

    def depth(creep: Any, slow: Any, fast: Any, thermal: Any) -> Any:
        return p.operating_depth_mm + creep + slow + fast + thermal

    before = depth(x["creep"], x["slow"], x["fast"], x["thermal"])
    delayed = [w[0] * line[0, 0] + w[1] * line[0, 1], w[2] * line[0, 0] + w[3] * line[0, 1]]
    following = {
        "creep": x["creep"] + mode[0] * pushed,
        "slow": mode[1] * x["slow"] + mode[2] * pushed,
        "fast": mode[3] * x["fast"] + mode[4] * pushed,
        "thermal": mode[5] * x["thermal"] + mode[6] * x["temperature"] + mode[8] + delayed[0],
        "temperature": mode[7] * x["temperature"] + mode[9] + delayed[1],
        "force": force,
        "speed": speed,
    }
    after = depth(*(following[name] for name in names[:4]))
    nodes = [KW_PER_NM_RPM * speed * process_torque_nm(p, force, z) for z in (before, after)]
    for name, value in following.items():
        model.set_rhs(name, value)
    model.set_rhs("line", ca.vertcat(line[1:, :], ca.horzcat(*nodes)))
    model.set_expression("depth", after)
    model.set_expression("shown", following["temperature"])
    model.setup()
    u, target, depth_next, shown = model.u, model.tvp["target"], model.aux["depth"], model.aux["shown"]

    mpc = toolbox.controller.MPC(model)
    mpc.settings.n_horizon, mpc.settings.t_step, mpc.settings.store_full_solution = n_out, STEP_S, False
    mpc.settings.supress_ipopt_output()
    paper_weights = (100.0, 1.0, 1.0, 0.01)
    slacks = [u[name] for name in u_names[2:]]
    cost = sum(weight * slack for weight, slack in zip(paper_weights, slacks, strict=True))
    mpc.set_objective(mterm=ca.DM(0), lterm=cost)
    limits = (
        ("high_depth", depth_next - target[1] - u["over_depth"]),
        ("low_depth", target[0] - depth_next - u["over_depth"]),
        ("high_temperature", shown - target[3] - u["over_temperature"]),
        ("low_temperature", target[2] - shown - u["over_temperature"]),
        ("force_up", u["by_force"] - u["size_force"]),
        ("force_down", -u["by_force"] - u["size_force"]),
        ("speed_up", u["by_speed"] - u["size_speed"]),
        ("speed_down", -u["by_speed"] - u["size_speed"]),
    )
    for name, expression in limits:
        mpc.set_nl_cons(name, expression, 0.0)
    for name, low, high in (("by_force", -1.0, 1.0), ("by_speed", -3.0, 3.0)):
        mpc.bounds["lower", "_u", name], mpc.bounds["upper", "_u", name] = low, high
    for name in u_names[2:]:
        mpc.bounds["lower", "_u", name] = 0.0
    mpc.bounds["lower", "_x", "force"], mpc.bounds["upper", "_x", "force"] = 60.0, 95.0
    mpc.bounds["lower", "_x", "speed"], mpc.bounds["upper", "_x", "speed"] = 300.0, 500.0
    template = mpc.get_tvp_template()
    bands = np.zeros((n_out + 1, 4))

    def at(_: float) -> Any:
        for k in range(n_out + 1):
            template["_tvp", k, "target"] = bands[k]
        return template

    mpc.set_tvp_fun(at)
    mpc.setup()

    def solve(problem: Problem) -> None:
        e, now = problem.estimate, problem.applied
        rows = [problem.depth_low_mm, problem.depth_high_mm, problem.temperature_low_c, problem.temperature_high_c]
        bands[:n_out] = np.column_stack(rows)
        bands[n_out] = bands[n_out - 1]
        start = np.concatenate([e.x, [now.force_kn, now.speed_rpm], e.history_kw.reshape(-1, 2).ravel(order="F")])
        mpc.reset_history()
        mpc.x0 = start
        mpc.set_initial_guess()
        mpc.make_step(start)

    return solve
