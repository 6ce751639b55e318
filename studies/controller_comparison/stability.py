"""Whether a loop is stable, found by simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from fsw_control.contract import Command
from fsw_scenario.standard_runs import Job, loop_of


class _LateForce:
    """A plant whose drive gets its commands of the force some ticks late; all else is the plant's."""

    def __init__(self, plant: Any, ticks: int) -> None:
        self._plant = plant
        self._under_way = deque([plant.applied.force_kn] * ticks)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def apply(self, command: Command, stamp_ns: int, source: str) -> None:
        self._under_way.append(command.force_kn)
        self._plant.apply(Command(self._under_way.popleft(), command.speed_rpm), stamp_ns, source)


def is_stable(
    controller: str, plant: Mapping[str, float], force_ticks: int = 0, parameters: Mapping[str, Any] | None = None
) -> bool:
    """Whether small steps of both set-points die out, without noise, with the force so many ticks late."""
    loop = loop_of(Job(controller, "small_steps", plant=plant, parameters=parameters or {}))
    loop.plant = _LateForce(loop.plant, force_ticks)  # type: ignore[assignment]
    truth = loop.run().truth
    assert truth is not None  # a simulation has it
    for value, floor in ((truth.depth_mm, 1e-4), (truth.temperature_c, 1e-2)):
        earlier, later = np.ptp(value[-1200:-600]), np.ptp(value[-600:])
        if later > max(0.9 * earlier, floor):
            return False
    return True
