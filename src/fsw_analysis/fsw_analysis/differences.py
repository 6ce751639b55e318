"""How two courses of the manipulated variables differ."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
#: kN or rpm; the units on the wire are others, and each conversion rounds
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Difference:
    """New minus recorded values of one manipulated variable.

    Attributes
    ----------
    unit : str
        Of all differences.
    largest, largest_s : float
        Largest absolute difference, and its time [s].
    mean : float
        Mean absolute difference.
    first_tick : int
        First tick that differs by more than rounding; -1 when none does.
    first_s, first : float
        Its time [s], and the difference at it; NaN and 0 when none differs.
    differing : int
        Number of ticks that differ by more than rounding.
    """

    unit: str
    largest: float
    largest_s: float
    mean: float
    first_tick: int
    first_s: float
    first: float
    differing: int

    @classmethod
    def of(cls, unit: str, values: FloatArray, ticks: npt.NDArray[np.int64], time_s: FloatArray) -> Difference:
        """Summarise differences.

        Parameters
        ----------
        unit : str
        values : FloatArray, shape (n,)
            New minus recorded.
        ticks : int array, shape (n,)
            Their ticks.
        time_s : FloatArray
            Time of every tick.
        """
        size = np.abs(values)
        differing = np.flatnonzero(size > ROUNDING)
        if not differing.size:
            largest, mean = (float(size.max()), float(size.mean())) if size.size else (0.0, 0.0)
            return cls(unit, largest, float("nan"), mean, -1, float("nan"), 0.0, 0)
        worst, first = ticks[int(np.argmax(size))], ticks[differing[0]]
        return cls(
            unit=unit,
            largest=float(size.max()),
            largest_s=float(time_s[worst]),
            mean=float(size.mean()),
            first_tick=int(first),
            first_s=float(time_s[first]),
            first=float(values[differing[0]]),
            differing=int(differing.size),
        )

    def text(self) -> str:
        """The difference in words."""
        if self.first_tick < 0:
            return "equal " + ("but for rounding" if self.largest else "bit by bit")
        return (
            f"largest {self.largest:.6g} {self.unit} at {self.largest_s:.1f} s, mean {self.mean:.6g} {self.unit}, "
            f"{self.differing} ticks differ, first tick {self.first_tick} at {self.first_s:.1f} s by "
            f"{self.first:+.6g} {self.unit}"
        )

    def values(self) -> dict[str, Any]:
        """The difference as plain values for JSON; NaN becomes None."""
        return {name: None if value != value else value for name, value in asdict(self).items()}
