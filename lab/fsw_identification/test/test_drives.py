"""Rates of drives from their feedback: found where they limit, and only there."""

from types import SimpleNamespace

import numpy as np
import pytest

from fsw_control.weld import TICK_S
from fsw_identification.drives import drive_rates
from fsw_plant.library import KERNEL

LARGEST = (1.0, 3.0)  # moves of the commands [kN], [rpm]


def commanded(largest, seed):
    """Random set-points that a controller approaches with its largest moves."""
    random, command, commands = np.random.default_rng(seed), 0.0, []
    for goal in random.uniform(-4.0, 4.0, 20) * largest:
        for _ in range(random.integers(10, 50)):
            command += np.clip(goal - command, -largest, largest)
            commands.append(command)
    return np.array(commands[:500])


def followed(commands, step, lag_s, dead_ticks):
    """Feedback of a drive of the emulator."""
    drive = KERNEL.new("fsw_plant_drive", setpoint=commands[0], position=commands[0])
    KERNEL.lib.fsw_plant_drive_configure(drive, step, lag_s, dead_ticks)
    acting = [commands[0]]
    for command in commands[:-1]:
        KERNEL.lib.fsw_plant_drive_advance(drive, command)
        acting.append(drive.position)
    return np.array(acting)


@pytest.mark.parametrize(
    "lag_s, dead_ticks, shares",
    [
        (0.02, 0, (0.3, None)),
        (0.3, 0, (None, None)),
        (0.3, 0, (None, 0.5)),
        (0.02, 2, (None, None)),
        (0.15, 1, (0.2, 0.4)),
    ],
)
def test_a_rate_is_found_where_it_limits(lag_s, dead_ticks, shares):
    """Neither a lag nor a dead time passes for one, nor does noise of the feedback."""
    noise, commands, acting, expected = np.random.default_rng(1), [], [], []
    for seed, (largest, share) in enumerate(zip(LARGEST, shares, strict=True)):
        step = (share or 10.0) * largest
        commands.append(commanded(largest, seed))
        exact = followed(commands[-1], step, lag_s, dead_ticks)
        acting.append(exact + 0.01 * largest * noise.standard_normal(exact.size))
        expected.append(pytest.approx(step / TICK_S, rel=0.05) if share else None)
    drives = SimpleNamespace(force_kn=acting[0], speed_rpm=acting[1])
    weld = SimpleNamespace(force_kn=commands[0], speed_rpm=commands[1], drives=drives)
    assert drive_rates([weld]) == tuple(expected)
    weld.drives = None
    assert drive_rates([weld]) == (None, None)
