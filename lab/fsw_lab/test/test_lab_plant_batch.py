"""Plants side by side are single ones, bit for bit."""

import numpy as np
import pytest

from fsw_control import Command, Limits
from fsw_control.schema.models import InputError
from fsw_control.sensors import REQUIRED
from fsw_lab.plant_batch import CHANNELS, PlantBatch
from fsw_plant import PlantConfig, PlantEmulator
from fsw_plant.event_schema import disturbance

N_TICKS = 1040  # more than one block of random numbers
COLOURED = {
    "sensors.depth_noise_correlation_s": 5.0,
    "sensors.torque_noise_correlation_s": 0.3,
    "sensors.temperature_noise_correlation_s": 1.0,
    "sensors.temperature_lag_s": 3.0,
}

REAL = {
    "machine.depth_sensor": "depth_axial",
    "machine.compliance_mm_per_kn": 0.03,
    "machine.tool_growth_mm_per_kw": 0.005,
    "machine.hardness_variation": 0.03,
}


def commands(k):
    """Steps that meet the bounds and the rates."""
    ticks = np.arange(N_TICKS)
    force = (
        78.4 + 1.2 * np.sin(0.11 * ticks + k) + np.where(ticks % 200 < 3, 30.0 * (-1) ** k, 0.0)
    )
    return np.stack([force, 407.6 + 60.0 * np.sin(0.031 * ticks + 2 * k)])


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"noise": False, "factors.dead_time_s": 0.73, "actuators.dead_time_ticks": 2},
        COLOURED,
        REAL,
    ],
    ids=["default", "dead times", "coloured noise and a slow probe", "a real machine"],
)
def test_each_plant_of_a_batch_equals_a_single_one(settings):
    disturbances = np.zeros((N_TICKS + 2, len(CHANNELS)))
    disturbances[50:, 0], disturbances[300:, 2], disturbances[100:400, 3] = 0.05, 12.0, 0.4
    disturbances[70:, 1] = 4.0
    batch = PlantBatch(PlantConfig.from_values(settings), 3, disturbances)
    batch.reset(np.arange(3), np.array([7, 8, 9]))
    singles = [
        PlantEmulator(PlantConfig.from_values({**settings, "seed": seed})) for seed in (7, 8, 9)
    ]
    for tick in range(1, N_TICKS + 1):
        shown = batch.measure()
        for k, single in enumerate(singles):
            if tick == 50:
                single.begin(disturbance("depth", "step", 0.05))
            if tick == 70:
                single.begin(disturbance("temperature", "step", 4.0))
            reading = single.measure()
            given = [reading.values[name] for name in REQUIRED]
            assert shown[:, k].tolist() == given
            assert batch.acting[:, k].tolist() == list(reading.drives)
            truth = single.truth()
            depth, temperature = batch.truth()
            assert (depth[k], temperature[k]) == (truth.depth_mm, truth.temperature_c)
            if tick in (100, 400):
                single.begin(disturbance("axial_force", "step" if tick == 100 else "none", 0.4))
            if tick == 300:
                single.begin(disturbance("torque", "step", 12.0))
            single.apply(Limits().clip(Command(*commands(k)[:, tick - 1]), None))
            single.step()
        batch.step(np.stack([commands(k)[:, tick - 1] for k in range(3)], axis=1))


def test_one_that_leaves_the_copper_stands_still_and_can_begin_again():
    batch = PlantBatch(PlantConfig.from_values({"start.depth_mm": 1.0}), 2, np.zeros((2000, 5)))
    for _ in range(1000):
        batch.step(np.array([[60.0, 78.4], [407.0, 407.576]]))
    assert batch.stopped.tolist() == [True, False]
    assert np.isfinite(batch.measure()).all()
    batch.reset(np.array([0]), np.array([1]))
    assert not batch.stopped[0] and batch.tick.tolist() == [1, 1001]
    assert batch.truth()[0][0] == pytest.approx(1.0)


def test_fused_depth_is_refused():
    with pytest.raises(InputError, match=r"machine\.depth_channels"):
        PlantBatch(PlantConfig.from_values({"machine.depth_channels": True}), 1, np.zeros((1, 6)))
