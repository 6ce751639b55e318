"""Fit of the disturbances to the published statistics of the cascade.

Three parameters (:data:`welds.FITTED`) for three targets: mean, variance and half the range of the
measured temperature's error in a group of eight welds. One step of Newton's method with one-sided
differences, from the shipped values on; all welds have the same random numbers, so that few welds
suffice for the differences. Other welds, of the page, verify the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np

from fsw_analysis.phase_kpi import PUBLISHED
from realistic import welds
from realistic.welds import FITTED, GROUP, Figures, Task

#: welds of the campaign that are used for the fit, and by nothing else; for the differences
WELDS, DIFFERENCES = range(8), range(4)
#: relative step of the differences, and the largest relative change
_STEP, _LARGEST = 0.2, 0.3


def _targets(statistics: Figures) -> Figures:
    mean, sigma, low, high = np.moveaxis(statistics, -1, 0)
    return np.stack([mean, sigma**2, 0.5 * (high - low)], -1)


def fit(run: Callable[[list[Task]], list[welds.Row]]) -> dict[str, Any]:
    """Fitted values, and what they follow from."""
    shipped = welds.scenario_values()
    wanted = _targets(np.array(astuple(PUBLISHED["cascade"][1])))
    changes = [(), *(((path, 1.0 + _STEP),) for path in FITTED)]
    rows = run(
        [
            Task("decentral", index, change)
            for change in changes
            for index in (DIFFERENCES if change else WELDS)
        ]
    )
    by_change = [
        [row for row in rows if row["changes"] == [list(c) for c in cs]] for cs in changes
    ]
    few = [[row for row in of if row["index"] in DIFFERENCES] for of in by_change]
    now, before = _median(by_change[0]), _median(few[0])
    jacobian = np.array([(_median(of) - before) / _STEP for of in few[1:]]).T
    step = np.clip(np.linalg.solve(jacobian, wanted - now), -_LARGEST, _LARGEST)
    return {
        "values": {path: (1.0 + d) * shipped[path] for path, d in zip(FITTED, step, strict=True)},
        "start": {path: shipped[path] for path in FITTED},
        "wanted": wanted.tolist(),
        "at_start": now.tolist(),
        "jacobian": jacobian.tolist(),
    }


def _median(rows: Sequence[welds.Row]) -> Figures:
    """Targets of a group of eight: medians over groups drawn from the welds."""
    return np.asarray(np.median(_targets(welds.groups(rows, GROUP)), 0))
