"""``fsw/Weld-v0``.

The rules of Gymnasium, and the same weld and figures of merit as the closed loop.
"""

import doctest

import numpy as np
import pytest

import fsw

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from fsw_control.schema.models import InputError  # noqa: E402
from fsw_lab import weld_env  # noqa: E402


def policy(seen):
    """Both set-points by hand, without elegance."""
    return np.array([0.5 * (seen[5] - seen[0]), 0.4 * (seen[6] - seen[2])])


def test_environment_passes_the_checks_of_gymnasium(recwarn):
    check_env(gymnasium.make("fsw/Weld-v0", scenario="quick").unwrapped, skip_render_check=True)
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.parametrize("scenario", ["quick", "ramp_and_sine"])
def test_an_episode_has_the_figures_of_the_closed_loop(scenario):
    weld = fsw.simulate(scenario, weld_env.PolicyController(policy), noise=False)
    env = gymnasium.make("fsw/Weld-v0", scenario=scenario, noise=False)
    seen, _ = env.reset(seed=0)
    over, total = False, 0.0
    while not over:
        seen, reward, lost, over, info = env.step(policy(seen))
        total += reward
    assert not lost
    for name, value in info["kpi"].items():
        assert value == pytest.approx(
            weld.kpi[name], rel=1e-5
        )  # observations are single precision
    start = (
        weld.kpi["iae_depth_mm_s"] / weld_env.COST_MM
        + weld.kpi["iae_temperature_c_s"] / weld_env.COST_C
    )
    assert -total == pytest.approx(start, rel=1e-3)


def test_welds_at_once_are_single_ones_and_begin_again():
    envs = gymnasium.make_vec(
        "fsw/Weld-v0", num_envs=3, vectorization_mode="vector_entry_point", scenario="quick"
    )
    seen, _ = envs.reset(seed=5)
    single = gymnasium.make("fsw/Weld-v0", scenario="quick", noise=False)
    single.reset(seed=0)
    assert len({tuple(row) for row in seen}) == 3  # each has its own noise
    for _ in range(599):
        seen, _, lost, over, info = envs.step(np.zeros((3, 2)))
        _, _, _, ended, details = single.step(np.zeros(2))
        assert bool(over[0]) == ended
    assert over.all() and not lost.any()
    assert info["kpi"]["iae_depth_mm_s"] == pytest.approx(
        np.full(3, details["kpi"]["iae_depth_mm_s"])
    )
    _, reward, _, over, _ = envs.step(np.zeros((3, 2)))
    assert not over.any() and reward.tolist() == [0.0, 0.0, 0.0]


def test_losing_the_copper_ends_one_weld_alone():
    envs = gymnasium.make_vec(
        "fsw/Weld-v0",
        num_envs=2,
        vectorization_mode="vector_entry_point",
        plant={"start.depth_mm": 1.0},
    )
    envs.reset(seed=0)
    for _ in range(2000):
        _, reward, lost, _, _ = envs.step(np.array([[-1.0, 0.0], [0.0, 0.0]]))
        if lost.any():
            break
    assert lost.tolist() == [True, False]
    assert reward[0] < -weld_env.LOST < reward[1]


def test_scenario_that_cannot_be_welded_is_refused_by_name():
    with pytest.raises(InputError, match="paper's process"):
        gymnasium.make("fsw/Weld-v0", scenario="canister_weld_heat")


@pytest.mark.parametrize(
    "example", doctest.DocTestFinder().find(weld_env), ids=lambda example: example.name
)
def test_the_examples_in_the_docstrings(example):
    printed = []
    runner = doctest.DocTestRunner()
    runner.run(example, out=printed.append)
    assert runner.failures == 0, "".join(printed)
