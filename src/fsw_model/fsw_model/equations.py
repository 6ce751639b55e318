"""The equations of the process, written once in CasADi, with the numbers they have in the paper.

The paper's full text was not at hand when this was written. The forms below are reconstructed from what it publishes
about equations (5)-(27): which block depends on what, its units, its operating point, gains, slopes and time constants.
The coefficients are identified so that all published numbers hold together (``test/test_model_numbers.py``);
``parameters.ORIGIN`` says for each whether it is published, identified or chosen, ``docs/model.md`` tells it at length.

Everything else (the numeric step, the linearisation, the controller's prediction, generated C) is derived from here.
State vector ``x`` (length 5), in this order: creep, slow and fast part of the force-driven depth (17), thermal part
of the depth (27), temperature. Units: mm, kN, rpm, degC, kW, N m, s, but SI inside (19)-(22).
"""

from __future__ import annotations

from math import pi

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model.parameters import ModelParameters

STATE_NAMES = ("depth_creep_mm", "depth_slow_mm", "depth_fast_mm", "depth_thermal_mm", "temperature_c")
N_STATES = len(STATE_NAMES)
RAD_PER_S_PER_RPM = pi / 30.0

Matrix = NDArray[np.float64]


def depth_mm(p: ModelParameters, x: ca.SX) -> ca.SX:
    """Shoulder depth: operating depth plus the parts driven by force (17) and by temperature (27)."""
    return p.operating_depth_mm + x[0] + x[1] + x[2] + x[3]


def process_torque_nm(p: ModelParameters, force_kn: ca.SX, depth: ca.SX) -> ca.SX:
    """Torque of tool on copper, (19)-(22): contact ring of a convex shoulder under the axial force.

    (19) contact area A, (20) pressure sigma = F/A, (21) geometry factor G (shoulder ring plus probe),
    (22) M_sp = (tau_0 + mu sigma) G.
    """
    radius_m = ca.sqrt(2.0 * p.shoulder_radius_m * (depth * 1e-3))
    inner_m = p.contact_inner_radius_m
    area_m2 = pi * (radius_m**2 - inner_m**2)
    sigma_pa = force_kn * 1e3 / area_m2
    geometry_m3 = 2.0 * pi / 3.0 * (radius_m**3 - inner_m**3) + p.probe_volume_m3
    return (p.sticking_stress_pa + p.friction_coefficient * sigma_pa) * geometry_m3


def process_power_kw(torque_nm: ca.SX, speed_rpm: ca.SX) -> ca.SX:
    """Heat that the tool puts into the copper: torque times speed."""
    return torque_nm * speed_rpm * (RAD_PER_S_PER_RPM * 1e-3)


def friction_torque_nm(p: ModelParameters, speed_rpm: ca.SX) -> ca.SX:
    """Friction torque of the spindle bearings (8)."""
    return p.bearing_torque_nm + p.bearing_viscosity_nm_per_rpm * speed_rpm


def inertia_torque_nm(p: ModelParameters, acceleration_rpm_per_s: ca.SX) -> ca.SX:
    """Torque that accelerates the spindle: seen by the motor, not by the copper."""
    return p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * acceleration_rpm_per_s


def linear_blocks(p: ModelParameters) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Continuous-time linear part: dx/dt = A x + b_F F + b_P P(t - dead time) + b_0.

    Depth over force (17) is split into partial fractions, so that each pole stands alone; temperature over delayed
    power is first order; the thermal depth (27) is a lag on the temperature's deviation from the operating point.

    Returns
    -------
    A : (5, 5), b_F : (5,), b_P : (5,), b_0 : (5,) arrays
        Time in s, F in kN, P in kW.
    """
    slow, fast, zero, gain = p.depth_pole_slow_s, p.depth_pole_fast_s, p.depth_zero_s, p.depth_gain_mm_per_kn_s
    residue_slow = gain * (zero - slow) * slow / (slow - fast)
    residue_fast = gain * (zero - fast) * fast / (fast - slow)
    a = np.zeros((N_STATES, N_STATES))
    a[1, 1] = -1.0 / slow
    a[2, 2] = -1.0 / fast
    a[3, 3] = -1.0 / p.softening_time_s
    a[3, 4] = p.softening_gain_mm_per_c / p.softening_time_s
    a[4, 4] = -1.0 / p.thermal_time_s
    b_force = np.array([gain, residue_slow / slow, residue_fast / fast, 0.0, 0.0])
    b_power = np.array([0.0, 0.0, 0.0, 0.0, p.thermal_gain_c_per_kw / p.thermal_time_s])
    b_const = -p.operating_force_kn * b_force
    b_const[3] -= p.softening_gain_mm_per_c * p.operating_temperature_c / p.softening_time_s
    b_const[4] += p.ambient_temperature_c / p.thermal_time_s
    return a, b_force, b_power, b_const


def discretise(p: ModelParameters, step_s: float) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Exact discretisation of the linear blocks over ``step_s``, whatever the stiffness.

    The force is constant over the step; the delayed power is the parabola through its values at the start, the
    middle and the end of the step.

    Returns
    -------
    phi : (5, 5), gamma_force : (5,), gamma_power : (5, 3), gamma_const : (5,) arrays
        x(t + step) = phi x(t) + gamma_force F + gamma_power [P_start, P_middle, P_end] + gamma_const.
    """
    a, b_force, b_power, b_const = linear_blocks(p)
    chain = N_STATES + 5  # x, then F, 1, and the power's parabola as a chain of integrators q0' = q1, q1' = q2
    m = np.zeros((chain, chain))
    m[:N_STATES, :N_STATES] = a
    m[:N_STATES, N_STATES] = b_force
    m[:N_STATES, N_STATES + 1] = b_const
    m[:N_STATES, N_STATES + 2] = b_power
    m[N_STATES + 2, N_STATES + 3] = 1.0
    m[N_STATES + 3, N_STATES + 4] = 1.0
    e = matrix_exponential(m * step_s)
    # P(s) = c0 + c1 (s/h) + c2 (s/h)^2 through the three nodes; q = (c0, c1/h, 2 c2/h^2) at the start
    to_chain = np.array(
        [
            [1.0, 0.0, 0.0],
            [-3.0 / step_s, 4.0 / step_s, -1.0 / step_s],
            [4.0 / step_s**2, -8.0 / step_s**2, 4.0 / step_s**2],
        ]
    )
    gamma_power = e[:N_STATES, N_STATES + 2 :] @ to_chain
    return e[:N_STATES, :N_STATES], e[:N_STATES, N_STATES], gamma_power, e[:N_STATES, N_STATES + 1]


def matrix_exponential(m: Matrix) -> Matrix:
    """exp(m), by scipy (scaling and squaring with Pade approximants)."""
    from scipy.linalg import expm  # heavy to import, needed once per model

    return np.asarray(expm(m), dtype=np.float64)


def output_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, force_kn, speed_rpm) -> depth, temperature, process torque, friction torque, power."""
    x = ca.SX.sym("x", N_STATES)
    force, speed = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")
    depth = depth_mm(p, x)
    torque = process_torque_nm(p, force, depth)
    return ca.Function(
        "process_outputs",
        [x, force, speed],
        [depth, x[4], torque, friction_torque_nm(p, speed), process_power_kw(torque, speed)],
        ["x", "force_kn", "speed_rpm"],
        ["depth_mm", "temperature_c", "process_torque_nm", "friction_torque_nm", "power_kw"],
    )


def step_function(p: ModelParameters, step_s: float) -> ca.Function:
    """CasADi function of one step: (x, delayed power nodes (3), force, speed) -> (x next, power nodes (3)).

    ``delayed`` are the power nodes of the step that lies one dead time back; the returned nodes (start, middle and
    end of this step, the first right after the inputs jump) go to the end of that queue. Because the dead time is
    longer than the step, the temperature within the step is known beforehand and the step is explicit.
    """
    x = ca.SX.sym("x", N_STATES)
    delayed = ca.SX.sym("delayed_kw", 3)
    force, speed = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")

    def after(part: tuple[Matrix, Matrix, Matrix, Matrix], power: ca.SX) -> ca.SX:
        phi, gamma_force, gamma_power, gamma_const = part
        return ca.DM(phi) @ x + ca.DM(gamma_force) * force + ca.DM(gamma_power) @ power + ca.DM(gamma_const)

    # at half step the same parabola, re-sampled at the half step's own three nodes
    quarter = 0.375 * delayed[0] + 0.75 * delayed[1] - 0.125 * delayed[2]
    middle = after(discretise(p, 0.5 * step_s), ca.vertcat(delayed[0], quarter, delayed[1]))
    end = after(discretise(p, step_s), delayed)
    nodes = [process_power_kw(process_torque_nm(p, force, depth_mm(p, state)), speed) for state in (x, middle, end)]
    return ca.Function(
        "process_step",
        [x, delayed, force, speed],
        [end, ca.vertcat(*nodes)],
        ["x", "delayed_kw", "force_kn", "speed_rpm"],
        ["x_next", "power_kw"],
    )
