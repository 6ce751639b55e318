"""The clairvoyant optimum of each standard event, as plain data."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from controller_comparison.optimum import Clairvoyant
from fsw.console import ProgressBar
from fsw_control import Reference
from fsw_tuning.standard_cases import DISTURBANCES, EVENTS, REST, SET_POINTS, set_points

#: Weights of 1 mm in °C for the front between both outputs, and for their joint optimum, which is
#: one of them.
_FRONT, _JOINT = (1e4, 1e3, 300.0, 100.0, 30.0, 10.0, 1.0), 100.0
#: further searches for the optimum of one output, from random inputs
_STARTS = 8


def courses() -> dict[str, tuple[Reference, Reference]]:
    """For each standard event, where the process rests before, and where it has to go."""
    moves = dict(zip(SET_POINTS, pairwise(set_points()), strict=True))
    for name, step in DISTURBANCES.items():
        against = step._replace(depth_mm=-step.depth_mm, temperature_c=-step.temperature_c)
        moves[name] = (REST, against.after(REST))
    return moves


def bounds() -> dict[str, Any]:
    """The clairvoyant optimum of each event: of one output alone, of both, and the front between them.

    Of one output alone from several starts: the best, from how many it was solved, and how far
    they differ.
    """
    clairvoyant, data = Clairvoyant(), {}
    with ProgressBar("clairvoyant optima", len(EVENTS)) as bar:
        for name, (rest, goal) in courses().items():
            of_depth = EVENTS[name].of_depth
            weights, of = ((1e4, 1e-3), 0) if of_depth else ((1e-3, 1.0), 1)
            generator = np.random.default_rng(1)
            starts = [
                clairvoyant.best(rest, goal, *weights, inputs)
                for inputs in (None, *[generator] * _STARTS)
            ]
            errors = [optimum.iae[of] for optimum in starts if optimum.solved]
            front = {weight: clairvoyant.best(rest, goal, weight, 1.0) for weight in _FRONT}
            data[name] = {
                "alone": min(errors),
                "starts": len(errors),
                "spread": max(errors) / min(errors) - 1.0,
                "joint": front[_JOINT].iae,
                "front": [optimum.iae for optimum in front.values()],
                "solved": starts[0].solved and all(optimum.solved for optimum in front.values()),
            }
            bar(len(data))
    return data
