"""Closed loops on (16)-(27) integrated on their own, with events between ticks.

The emulator's peaks are right.

Nothing of the emulator is used: the equations and the lag of the drives are written here from the
paper, and integrated with cuts where an input jumps. The peak of the temperature in a step of the
depth is what the torque's jumps and the speed's moves leave of each other, so an error of either
would show there.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fsw_control import Command
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make, name_of
from fsw_scenario.plants import Outputs

pytestmark = pytest.mark.slow

TICK_S, DEAD_S, LAG_S, STEP_S = 0.1, 2.8, 0.02, 1.0
SPEED_RPM = 407.57607824382967
REST_C, REST_MM = 816.4, 2.66
DEEPER = {"at_s": STEP_S, "reference": {"depth_mm": 2.86}}
PUSHED = {
    "at_s": STEP_S,
    "disturbance": {"channel": "axial_force", "shape": "step", "amplitude_kn": 1.0},
}


def friction_nm(speed_rpm):
    return 243.11 - 1.305 * speed_rpm + 0.001927 * speed_rpm**2  # (23)


def depth_mm(y):
    return (0.0016 * (y[0] + 29.6 * y[1]) + REST_MM) * (1.0 + 0.0021 * y[3])  # (27)


class Integrated:
    """The process with its drives; from ``at_s`` on, something pushes the tool."""

    def __init__(self, at_s=np.inf, more_kn=0.0):
        self.at_s, self.more_kn = at_s, more_kn

    def start(self):
        self.now_s, self.pieces, self.inertia_nm = 0.0, [], 0.0
        motor_nm = 1021.525436238483 + friction_nm(SPEED_RPM)
        self.y = np.array([0.0, 0.0, 0.0, 0.0, 0.0, motor_nm, 78.4, SPEED_RPM])
        return Command(78.4, SPEED_RPM), self.shown

    @property
    def shown(self):
        return Outputs(depth_mm(self.y), REST_C + self.y[3], self.y[5] + self.inertia_nm)

    @property
    def acting(self):
        """As a load cell at the tool and the drive of the spindle report them."""
        pushed = self.more_kn if self.now_s > self.at_s + 1e-9 else 0.0
        return Command(self.y[6] + pushed, self.y[7])

    def delayed_kw(self, time_s):
        if time_s <= 0.0:
            return 0.0
        begin_s, end_s, solution = next(
            piece for piece in reversed(self.pieces) if time_s > piece[0] - 1e-12
        )
        y = solution(min(max(time_s, begin_s), end_s))
        return (y[5] - friction_nm(y[7])) * y[7] * np.pi / 30000.0 - 43.6  # (24)

    def step(self, command):
        end_s, speed_rpm = self.now_s + TICK_S, self.y[7]
        inside = (
            s for s in (self.at_s, self.at_s + DEAD_S) if self.now_s + 1e-9 < s < end_s - 1e-9
        )
        for begin, end in pairwise(sorted({self.now_s, end_s, *inside})):
            pushed = self.more_kn if begin >= self.at_s - 1e-9 else 0.0

            def slopes(t, y, begin=begin, pushed=pushed):
                force, speed = y[6] + pushed, y[7]
                radius = 0.015 + 20.0 / 3.0 * depth_mm(y) / 1000.0
                shear = 152800.0 + 0.435 * force * 1000.0 / (np.pi * radius**2)  # (19), (21)
                torque = shear * (2.3e-5 + 2.408 * (radius**3 - 0.015**3))  # (20), (22)
                power = self.delayed_kw(max(t, begin + 1e-10) - DEAD_S)
                return [
                    y[1],
                    y[2],
                    (force - 78.4 - y[1] - (14.7 + 0.00095) * y[2]) / (14.7 * 0.00095),  # (17)
                    y[4],
                    (18.1 * power - y[3] - (30.5 + 1.2) * y[4]) / (30.5 * 1.2),  # (16)
                    (torque + friction_nm(speed) - y[5]) / 0.27,  # (18)
                    (command.force_kn - y[6]) / LAG_S,
                    (command.speed_rpm - y[7]) / LAG_S,
                ]

            scale = [1e-7, 1e-7, 1e-5, 1e-6, 1e-6, 1e-4, 1e-6, 1e-5]
            solved = solve_ivp(
                slopes, (begin, end), self.y, "LSODA", rtol=1e-7, atol=scale, dense_output=True
            )
            self.pieces.append((begin, end, solved.sol))
            self.y = solved.y[:, -1]
        self.now_s = end_s
        # 2 kg m2 of the spindle, seen by the sensor only
        self.inertia_nm = 2.0 * np.pi / 30.0 * (self.y[7] - speed_rpm) / TICK_S
        return self.shown


def peak_c(label, duration_s, event=None, plant=None):
    """Largest error of the temperature in a closed loop, without noise.

    On the emulator without plant.
    """
    name = name_of(label)
    content = {"name": "step", "duration_s": duration_s, "controller": name}
    content |= {"events": [event]} if event else {}
    content |= {} if plant else {"plant": {"noise": False}}
    loop = ClosedLoop(scenario_file.read(content, "step"), {name: make(label, {})}, plant=plant)
    if plant:  # with the drives' feedback, as the emulator has it
        measure = loop.plant.measure
        loop.plant.measure = lambda: measure()._replace(drives=plant.acting)
    signals = loop.run()
    shown = signals if plant else signals.truth
    return np.abs(shown.temperature_c - REST_C).max()


@pytest.mark.parametrize("label", ["nmpc:default", "decentral:smith"])
def test_the_peak_of_a_step_of_the_depth_is_that_of_the_integrated_loop(label):
    emulated = peak_c(label, 9.0, DEEPER)
    assert peak_c(label, 9.0, DEEPER, Integrated()) == pytest.approx(emulated, rel=0.03)


def test_a_push_between_ticks_is_met_no_worse_than_one_at_a_tick():
    """The drives' feedback shows it at the next tick, when less of it has passed."""
    emulated = peak_c("nmpc:default", 9.0, PUSHED)
    integrated = [
        peak_c("nmpc:default", 9.0, plant=Integrated(STEP_S - TICK_S + late_s, 1.0))
        for late_s in (0.0, 0.05)
    ]
    assert integrated[0] == pytest.approx(emulated, rel=0.05)
    assert integrated[1] < integrated[0]
