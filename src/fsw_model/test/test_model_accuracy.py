"""The one-step model against an integration of its own: hand-written equations, small steps, true delay."""

from bisect import bisect_right
from itertools import pairwise
from math import pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fsw_model import ProcessModel, nominal

DEAD_TIME_S = 2.8


class Reference:
    """Integrates the delay differential equation by the method of steps.

    Force to depth (17) in controllable canonical form, K (1 + s Tz) / (s (1 + s T1) (1 + s T2)), so not the partial
    fractions of the model. Segments end wherever an input, or the power that arrives, jumps.
    """

    def __init__(self, inputs):
        self.p = nominal()
        self.inputs = inputs  # list of (start_s, force_kn, speed_rpm)
        self.segments = []  # (start_s, dense solution, speed_rpm, force_kn)

    def power_kw(self, depth_mm, force_kn, speed_rpm):
        p = self.p
        outer, inner = sqrt(2 * p.shoulder_radius_m * depth_mm / 1e3), p.contact_inner_radius_m
        sigma = 1e3 * force_kn / (pi * (outer * outer - inner * inner))
        lever = 2 * pi / 3 * (outer**3 - inner**3) + p.probe_volume_m3
        return (p.sticking_stress_pa + p.friction_coefficient * sigma) * lever * speed_rpm * 2 * pi / 60 / 1e3

    def depth_mm(self, y):
        p = self.p
        return p.operating_depth_mm + p.depth_gain_mm_per_kn_s * (y[0] + p.depth_zero_s * y[1]) + y[3]

    def delayed_power_kw(self, time_s):
        if time_s <= 0.0:
            return self.rest_kw
        starts = [segment[0] for segment in self.segments]
        _, solution, force, speed = self.segments[bisect_right(starts, time_s) - 1]
        return self.power_kw(self.depth_mm(solution(time_s)), force, speed)

    def run(self, end_s, start, times_s):
        p = self.p
        self.rest_kw = (start.outputs.temperature_c - p.ambient_temperature_c) / p.thermal_gain_c_per_kw
        changes = [change[0] for change in self.inputs]
        cuts = {c + n * DEAD_TIME_S for c in [0.0, *changes] for n in range(int(end_s / DEAD_TIME_S) + 1)}
        cuts = sorted({round(c, 6) for c in cuts if c < end_s} | {end_s})
        t1t2, t1_plus_t2 = p.depth_pole_slow_s * p.depth_pole_fast_s, p.depth_pole_slow_s + p.depth_pole_fast_s
        y = np.array([0.0, 0.0, 0.0, start.outputs.depth_mm - p.operating_depth_mm, start.outputs.temperature_c])
        for begin, end in pairwise(cuts):
            _, force, speed = self.inputs[bisect_right(changes, begin + 1e-9) - 1]

            def rhs(t, y, force=force, begin=begin):
                # inside a segment the delayed time is strictly between two jumps
                power = self.delayed_power_kw(t - DEAD_TIME_S + (1e-9 if t == begin else 0.0))
                third = (force - p.operating_force_kn - y[1] - t1_plus_t2 * y[2]) / t1t2
                soft = p.softening_gain_mm_per_c * (y[4] - p.operating_temperature_c)
                warm = p.ambient_temperature_c + p.thermal_gain_c_per_kw * power
                return [y[1], y[2], third, (soft - y[3]) / p.softening_time_s, (warm - y[4]) / p.thermal_time_s]

            scale = np.array([1e-12, 1e-12, 1e-10, 1e-13, 1e-10])
            solved = solve_ivp(rhs, (begin, end), y, "LSODA", rtol=1e-11, atol=scale, dense_output=True)
            assert solved.success, solved.message
            self.segments.append((begin, solved.sol, force, speed))
            y = solved.y[:, -1]
        starts = [segment[0] for segment in self.segments]
        rows = []
        for t in times_s:
            _, solution, force, speed = self.segments[max(bisect_right(starts, t - 1e-9) - 1, 0)]
            state = solution(t)
            depth = self.depth_mm(state)
            rows.append((depth, state[4], self.power_kw(depth, force, speed)))
        return np.array(rows).T


# Like the open-loop experiments of Fig. 4 (axial force steps) and Fig. 5 (spindle speed steps); sizes chosen.
FIG_4 = [(0.0, 0.0, 0.0), (5.0, 1.0, 0.0), (25.0, -1.0, 0.0), (45.0, 2.0, 0.0), (60.0, 0.0, 0.0)]
FIG_5 = [(0.0, 0.0, 0.0), (5.0, 0.0, 10.0), (30.0, 0.0, -10.0), (55.0, 0.0, 5.0), (70.0, 0.0, 0.0)]
BOTH = [(0.0, 0.0, 0.0), (0.1, 3.0, 20.0), (7.3, -6.0, 20.0), (7.4, -6.0, -30.0), (20.0, 4.0, 10.0)]


@pytest.mark.parametrize("steps", [FIG_4, FIG_5, BOTH], ids=["fig4_force", "fig5_speed", "both"])
def test_step_sequences_agree(steps):
    model, end_s = ProcessModel(), 90.0
    start = model.equilibrium(2.66, 850.0)
    inputs = [(t, start.force_kn + df, start.speed_rpm + dn) for t, df, dn in steps]
    changes = [change[0] for change in inputs]
    ticks = round(end_s * 10)
    held = [inputs[bisect_right(changes, k / 10 + 1e-9) - 1] for k in range(ticks)]
    run = model.simulate([h[1] for h in held], [h[2] for h in held], start)
    rows = np.arange(1, ticks + 1)
    depth, temperature, power = Reference(inputs).run(end_s, start, rows / 10)
    for name, exact in (("depth_mm", depth), ("temperature_c", temperature), ("power_kw", power)):
        # 1e-6 is asked for; 5e-10 is what it is
        assert np.abs(run[name][rows] / exact - 1.0).max() < 1e-8, name
    # also of what has changed, not only of the whole, so that the operating point cannot hide an error
    moved = np.abs(depth - 2.66).max()
    assert np.abs(run["depth_mm"][rows] - depth).max() < 2e-6 * moved
    assert np.abs(run["temperature_c"][rows] - temperature).max() < 2e-6 * np.abs(temperature - 850.0).max()
