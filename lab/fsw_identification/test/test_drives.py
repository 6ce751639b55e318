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


def weld_of(commands, acting):
    """A weld with the commands and feedback of force and speed."""
    pair = [
        SimpleNamespace(force_kn=force, speed_rpm=speed) for force, speed in (commands, acting)
    ]
    pair[0].drives = pair[1]
    return pair[0]


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
def test_limiting_drive_rate_is_identified(lag_s, dead_ticks, shares):
    """Neither a lag nor a dead time passes for one, nor does noise of the feedback."""
    noise, commands, acting, expected = np.random.default_rng(1), [], [], []
    for seed, (largest, share) in enumerate(zip(LARGEST, shares, strict=True)):
        step = (share or 10.0) * largest
        commands.append(commanded(largest, seed))
        exact = followed(commands[-1], step, lag_s, dead_ticks)
        acting.append(exact + 0.01 * largest * noise.standard_normal(exact.size))
        expected.append(pytest.approx(step / TICK_S, rel=0.05) if share else None)
    weld = weld_of(commands, acting)
    assert drive_rates([weld]) == (*expected, ())
    weld.drives = None
    assert drive_rates([weld]) == (None, None, ())


#: commands of force [kN] and speed [rpm]
AROUND_REST = [50.0 + commanded(LARGEST[0], 0), 1000.0 + commanded(LARGEST[1], 1)]


def stuck(acting, tick):
    """Feedback that stays at its value of a tick."""
    return np.where(np.arange(acting.size) < tick, acting, acting[tick])


def stepped(acting, size):
    """Feedback with an offset from the middle on."""
    return acting + size * (np.arange(acting.size) >= acting.size // 2)


@pytest.mark.parametrize(
    "changed, unknown",
    [
        (lambda acting, _: 1.02 * acting, False),
        (lambda acting, largest: acting + 5.0 * largest, False),
        (lambda acting, largest: stepped(acting, 2.0 * largest), True),
        (lambda acting, _: stuck(acting, 0), True),
        (lambda acting, _: stuck(acting, acting.size // 3), True),
    ],
    ids=["gain", "offset", "step", "stuck", "stuck later"],
)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_wrong_feedback_gives_no_drive_rate(changed, unknown, noise):
    """An error of the feedback of drives without a limit does not pass for slow drives."""
    random, acting = np.random.default_rng(1), []
    for commands, largest in zip(AROUND_REST, LARGEST, strict=True):
        exact = followed(commands, 10.0 * largest, 0.02, 0)
        noisy = exact + noise * largest * random.standard_normal(exact.size)
        acting.append(changed(noisy, largest))
    drives = ("force", "speed") if unknown else ()
    assert drive_rates([weld_of(AROUND_REST, acting)]) == (None, None, drives)


def test_drive_rate_is_identified_despite_gain_and_offset_of_its_feedback():
    """And in that of several welds, if they agree."""
    steps = 0.3 * np.array(LARGEST)

    def weld(factor):
        pairs = zip(AROUND_REST, factor * steps, strict=True)
        return weld_of(
            AROUND_REST, [1.02 * followed(of, step, 0.02, 0) + 5.0 for of, step in pairs]
        )

    rates = drive_rates([weld(1.0), weld(1.05)])
    assert rates[:2] == pytest.approx(1.025 * steps / TICK_S, rel=0.05) and not rates.unknown
    rates = drive_rates([weld(1.0), weld(1.6)])
    assert rates == (None, None, ("force", "speed")) and len(rates.notes) == 2
