"""The clairvoyant optimum of each standard event, as plain data."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from clairvoyant_bounds.optimum import Clairvoyant
from fsw.progress import ProgressBar
from fsw_control import Reference
from fsw_scenario.standard_cases import DISTURBANCES, EVENTS, REST, SET_POINTS, set_points

#: Weights of 1 mm in °C for the front between both outputs, and for their joint optimum, which is one of them.
_FRONT, _JOINT = (1e4, 1e3, 300.0, 100.0, 30.0, 10.0, 1.0), 100.0


def courses() -> dict[str, tuple[Reference, Reference]]:
    """For each standard event, where the process rests before, and where it has to go."""
    moves = dict(zip(SET_POINTS, pairwise(set_points()), strict=True))
    for name, step in DISTURBANCES.items():
        against = step._replace(depth_mm=-step.depth_mm, temperature_c=-step.temperature_c)
        moves[name] = (REST, against.after(REST))
    return moves


def bounds() -> dict[str, Any]:
    """The clairvoyant optimum of each event: of one output alone, of both, and the front between them."""
    clairvoyant, data = Clairvoyant(), {}
    with ProgressBar("clairvoyant optima", len(EVENTS)) as bar:
        for name, (rest, goal) in courses().items():
            of_depth = EVENTS[name].of_depth
            alone = clairvoyant.best(rest, goal, *((1e4, 1e-3) if of_depth else (1e-3, 1.0)))
            front = {weight: clairvoyant.best(rest, goal, weight, 1.0) for weight in _FRONT}
            data[name] = {
                "alone": alone.iae[0 if of_depth else 1],
                "joint": front[_JOINT].iae,
                "front": [optimum.iae for optimum in front.values()],
                "solved": all(optimum.solved for optimum in (alone, *front.values())),
            }
            bar(len(data))
    return data
