"""do-mpc on the process model of this project: .venv/bin/python examples/do_mpc_loop.py

Needs the extra fsw-control[science]. Two set-point steps, without noise; do-mpc knows the whole
state. The same model in the form that acados takes: see acados_model().
"""

import casadi as ca
import numpy as np
from do_mpc.controller import MPC
from do_mpc.simulator import Simulator

import fsw


def controller(model, depth_mm, temperature_c, horizon=60):
    mpc = MPC(model)
    mpc.set_param(
        n_horizon=horizon,
        t_step=0.1,
        store_full_solution=False,
        nlpsol_opts={"ipopt.print_level": 0},
    )
    mpc.settings.supress_ipopt_output()
    errors = (
        (model.aux["depth_mm"] - depth_mm) / 0.1,
        (model.aux["temperature_c"] - temperature_c) / 5.0,
    )
    cost = errors[0] ** 2 + errors[1] ** 2
    mpc.set_objective(lterm=cost, mterm=ca.SX(0))
    mpc.set_rterm(force_kn=0.01, speed_rpm=1e-4)
    for name, low, high in (("force_kn", 60.0, 95.0), ("speed_rpm", 300.0, 500.0)):
        mpc.bounds["lower", "_u", name], mpc.bounds["upper", "_u", name] = low, high
    mpc.setup()
    return mpc


def acados_model():
    """What acados' AcadosModel takes for a discrete model.

    Names, symbols and the explicit step.
    """
    discrete = fsw.model().discrete
    x, u = (ca.SX.sym(name, discrete.size1_in(name)) for name in ("x", "u"))
    after, y = discrete(x, u)
    return {
        "name": "weld",
        "x": x,
        "u": u,
        "disc_dyn_expr": after,
        "cost_y_expr": ca.vertcat(y[:2], u),
    }


def main(n_ticks=40):
    process = fsw.model()
    model = process.to_do_mpc()
    mpc, simulator = controller(model, 2.76, 818.4), Simulator(model)
    simulator.set_param(t_step=0.1)
    simulator.setup()
    mpc.x0 = simulator.x0 = process.state()
    mpc.u0 = simulator.u0 = np.array([[78.4], [407.576]])
    mpc.set_initial_guess()
    state, depth_mm = process.state(), process.parameters.operating_depth_mm
    for tick in range(n_ticks):
        u = mpc.make_step(state)
        state = np.asarray(simulator.make_step(u))
        depth_mm, temperature_c, _ = process.discrete(state, u)[1].full().ravel()
        if tick % 10 == 9:
            print(f"{0.1 * (tick + 1):4.1f} s  {u[0, 0]:6.2f} kN  {u[1, 0]:6.1f} rpm", end="  ")
            print(f"{depth_mm:.3f} mm  {temperature_c:.1f} degC")
    return depth_mm


if __name__ == "__main__":
    main()
