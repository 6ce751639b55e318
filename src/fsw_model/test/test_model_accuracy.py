"""The one-step model against the paper's equations (16)-(27), written here from its text and integrated on their own.

Nothing of ``fsw_model`` is used but what is tested: the numbers are typed in, (17) and (16) stand
in canonical form and not in partial fractions, the solver is LSODA at tight tolerance, and the
dead time is taken by the method of steps.
"""

from bisect import bisect_right
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fsw_model import ProcessModel, nominal

SPEED_RPM = 407.57607824382967  # at which 1021.5254 N m are 43.6 kW


class Paper:
    """Integrates (16)-(27) with inputs that jump at given times.

    A list of (from_s, force_kn, speed_rpm).
    """

    def __init__(self, inputs, dead_time_s):
        self.inputs, self.dead_time_s = inputs, dead_time_s
        self.segments = []  # (start_s, dense solution, speed_rpm)

    @staticmethod
    def depth_mm(y):
        delta_l = 0.0016 * (y[0] + 29.6 * y[1])
        return (delta_l + 2.66) * (1 + 0.0021 * y[3])  # (27)

    @staticmethod
    def spindle_torque_nm(depth_mm, force_kn):
        radius = 0.015 + 20 / 3 * depth_mm / 1000
        area = np.pi * radius**2  # (21)
        geometry = 2.3e-5 + 2.408 * (radius**3 - 0.015**3)  # (22)
        return (152800 + 0.435 * force_kn * 1000 / area) * geometry  # (19), (20)

    @staticmethod
    def friction_nm(speed_rpm):
        return 243.11 - 1.305 * speed_rpm + 0.001927 * speed_rpm**2  # (23)

    def delta_power_kw(self, motor_torque_nm, speed_rpm):
        return (
            motor_torque_nm - self.friction_nm(speed_rpm)
        ) * speed_rpm * np.pi / 30000 - 43.6  # (24)

    def delayed_kw(self, time_s):
        if time_s <= 0.0:
            return 0.0
        starts = [segment[0] for segment in self.segments]
        _, solution, speed_rpm = self.segments[bisect_right(starts, time_s) - 1]
        return self.delta_power_kw(solution(time_s)[5], speed_rpm)

    def run(self, end_s, times_s):
        """Depth, temperature, motor torque and power at the times, in the inputs that begin there."""
        changes = [change[0] for change in self.inputs]
        cuts = {
            c + n * self.dead_time_s
            for c in [0.0, *changes]
            for n in range(int(end_s / self.dead_time_s) + 2)
        }
        cuts = sorted({round(c, 9) for c in cuts if c < end_s} | {end_s})
        y = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1021.525436238483 + self.friction_nm(SPEED_RPM)])
        for begin, end in pairwise(cuts):
            _, force, speed = self.inputs[bisect_right(changes, begin + 1e-9) - 1]

            def slopes(t, y, force=force, speed=speed, begin=begin):
                # inside a segment the delayed time is strictly between two jumps
                power = self.delayed_kw(t - self.dead_time_s + (1e-9 if t == begin else 0.0))
                jerk = (force - 78.4 - y[1] - (14.7 + 0.00095) * y[2]) / (14.7 * 0.00095)  # (17)
                bend = (18.1 * power - y[3] - (30.5 + 1.2) * y[4]) / (30.5 * 1.2)  # (16)
                torque = self.spindle_torque_nm(self.depth_mm(y), force) + self.friction_nm(speed)
                return [y[1], y[2], jerk, y[4], bend, (torque - y[5]) / 0.27]  # (18)

            scale = np.array([1e-12, 1e-12, 1e-10, 1e-11, 1e-11, 1e-9])
            solved = solve_ivp(
                slopes, (begin, end), y, "LSODA", rtol=1e-12, atol=scale, dense_output=True
            )
            assert solved.success, solved.message
            self.segments.append((begin, solved.sol, speed))
            y = solved.y[:, -1]
        starts = [segment[0] for segment in self.segments]
        rows = []
        for t in times_s:
            k = bisect_right(starts, t + 1e-9) - 1
            state, speed = self.segments[k][1](t), self.segments[k][2]
            rows.append(
                (
                    self.depth_mm(state),
                    816.4 + state[3],
                    state[5],
                    43.6 + self.delta_power_kw(state[5], speed),
                )
            )
        return np.array(rows).T


FIG_4 = [(0.0, 78.4, SPEED_RPM), (5.0, 82.4, SPEED_RPM), (13.5, 78.4, SPEED_RPM)]
FIG_5 = [
    (0.0, 78.4, SPEED_RPM),
    (2.0, 82.4, SPEED_RPM),
    (10.5, 78.4, SPEED_RPM),
    (19.0, 78.4, SPEED_RPM + 60.0),
    (27.1, 78.4, SPEED_RPM + 40.0),
    (30.3, 78.4, SPEED_RPM + 20.0),
]
LIMITS = [
    (0.0, 78.4, SPEED_RPM),
    (0.1, 95.0, 300.0),
    (7.3, 60.0, 500.0),
    (7.4, 70.0, 310.0),
    (20.0, 90.0, 450.0),
]


@pytest.mark.parametrize("dead_time_s", [2.8, 2.85], ids=["whole_steps", "part_of_a_step"])
@pytest.mark.parametrize("inputs", [FIG_4, FIG_5, LIMITS], ids=["fig4", "fig5", "limits"])
def test_agrees_with_the_integrated_equations(inputs, dead_time_s):
    end_s = 45.0
    model = ProcessModel(nominal().changed(dead_time_s=dead_time_s))
    changes = [change[0] for change in inputs]
    held = [inputs[bisect_right(changes, k / 10 + 1e-9) - 1] for k in range(round(end_s * 10))]
    run = model.simulate([h[1] for h in held], [h[2] for h in held])
    exact = Paper(inputs, dead_time_s).run(end_s, run["time_s"])
    for name, values, rest in zip(
        ("depth_mm", "temperature_c", "motor_torque_nm", "power_kw"),
        exact,
        (2.66, 816.4, 1052.858, 43.6),
        strict=True,
    ):
        # a bend of the temperature within a step costs a little
        assert np.abs(run[name] / values - 1.0).max() < (1e-8 if dead_time_s == 2.8 else 2e-8), (
            name
        )
        # also of what has changed, not only of the whole, so that the operating point cannot hide
        # an error
        assert np.abs(run[name] - values).max() < 1e-6 * np.abs(values - rest).max(), name
