"""What earlier welds say of the parameters, as the prior of the next estimate.

The logarithms of the parameters take a random step from weld to weld, so that the estimates of a
series are a Kalman filter: each starts from the last one's mean and covariance, widened by that
step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.simulation import CANDIDATES, OF_TEMPERATURE
from fsw_model import ModelParameters, ParameterCovariance

#: standard deviation of a parameter's relative change from weld to weld of a type (chosen)
STEP = 0.01
#: the same to a weld of another type: wall, rim and lid lead the heat away differently; the
#: machine is the same (chosen)
_TYPE_STEP, _TYPE_STEP_THERMAL = 0.05, 0.2
#: standard deviation of the relative error of what no weld has shown yet
UNSEEN = 0.2
#: prior standard deviation of a logarithm without earlier welds: practically uninformative
_NONE = 2.0
#: of the tool where a lag of the thermocouple is estimated, of the thermocouple in model files
_SHOWN = ("tool_lag_s", "dead_time_s")


@dataclass(frozen=True)
class Prior:
    """Mean and covariance of the parameters' logarithms; without a mean, no prior."""

    mean: ModelParameters | None = None
    covariance: FloatArray | None = None  #: in the order of ``CANDIDATES``

    @classmethod
    def of(
        cls, mean: ModelParameters, known: ParameterCovariance, other_type: bool = False
    ) -> Prior:
        """Prior of the next weld, from the estimate of the last one."""
        at = {name: i for i, name in enumerate(CANDIDATES)}
        rows = [i for i, name in enumerate(known.parameters) if name in at]
        seen = [at[known.parameters[i]] for i in rows]
        covariance = np.diag(np.full(len(CANDIDATES), UNSEEN**2))
        covariance[np.ix_(seen, seen)] = known.matrix[np.ix_(rows, rows)]
        steps = [
            (_TYPE_STEP_THERMAL if name in OF_TEMPERATURE[:2] else _TYPE_STEP)
            if other_type
            else STEP
            for name in CANDIDATES
        ]
        return cls(mean, covariance + np.diag(np.square(steps)))

    def covariance_of(self, names: Sequence[str], lagged: bool = False) -> FloatArray:
        """Covariance of these parameters, (n, n); ``lagged``: those of the tool are not known."""
        if self.covariance is None:
            return np.diag(np.full(len(names), _NONE**2))
        at = [CANDIDATES.index(name) for name in names]
        covariance = self.covariance[np.ix_(at, at)].copy()
        for i in [i for i, name in enumerate(names) if lagged and name in _SHOWN]:
            covariance[i], covariance[:, i] = 0.0, 0.0
            covariance[i, i] = _NONE**2
        return covariance

    def lacks(self, p: ModelParameters, names: Sequence[str]) -> FloatArray:
        """What the logarithms of parameters lack of the mean, (n,)."""
        if self.mean is None:
            return np.zeros(len(names))
        return np.array([np.log(getattr(self.mean, name) / getattr(p, name)) for name in names])
