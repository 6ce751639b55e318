#!/usr/bin/env python3
"""Steps per second of the environment fsw/Weld-v0: one weld, and many at once in one process and in one per core.

usage: weld_env.py [--quick] [--json FILE]

Every step has random actions, sensor noise, observations and rewards. Every figure is of this run
on this machine.
"""

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(extras=("gym",))

import gymnasium
import numpy as np
from report import parser, save, show

import fsw_lab.weld_env  # noqa: F401  (makes the environment known)

AIMS = {"many_on_all_cores_steps_per_s": 20_000.0}


def single(n_steps: int) -> float:
    """Steps per second of one weld."""
    env = gymnasium.make("fsw/Weld-v0")
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (n_steps, 2)).astype(np.float32)
    begin = time.perf_counter()
    for action in actions:
        *_, lost, over, _ = env.step(action)
        if lost or over:
            env.reset()
    return n_steps / (time.perf_counter() - begin)


def many(n: int, n_steps: int) -> tuple[int, float]:
    """Steps of all welds together, and how long they took."""
    envs = gymnasium.make_vec("fsw/Weld-v0", num_envs=n, vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (50, n, 2)).astype(np.float32)
    begin = time.perf_counter()
    for i in range(n_steps):
        envs.step(actions[i % 50])
    return n * n_steps, time.perf_counter() - begin


def main() -> None:
    """Measure and print."""
    cli = parser(__doc__, "fewer steps")
    arguments = cli.parse_args()
    n_steps, cores = 300 if arguments.quick else 3000, os.cpu_count() or 1
    steps, seconds = many(256, n_steps)
    with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as pool:
        runs = list(pool.map(many, [256] * cores, [n_steps] * cores))
    figures = {
        "cores": cores,
        "single_steps_per_s": single(10 * n_steps // 3),
        "many_in_one_process_steps_per_s": steps / seconds,
        "many_on_all_cores_steps_per_s": sum(count for count, _ in runs)
        / max(taken for _, taken in runs),
    }
    show(figures, AIMS)
    save(figures, arguments.json)


if __name__ == "__main__":
    main()
