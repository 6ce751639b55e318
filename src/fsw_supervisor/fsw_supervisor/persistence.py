"""How long something has been measured without interruption."""

from __future__ import annotations

from dataclasses import dataclass

#: a single value may be a spike, however long ago the one before was
_FEWEST_VALUES = 2
#: more than the time is ever compared with [s]
_LONGEST_S = 1000.0


@dataclass(slots=True)
class Persistence:
    """Values in a row that show something, and the time that they cover.

    Each covers the time since the value before, the first one a tick period.
    """

    values: int = 0
    age_s: float = 0.0

    def note(self, shown: bool, elapsed_s: float, period_s: float) -> None:
        """Take a value that came ``elapsed_s`` after the one before."""
        if not shown:
            self.values, self.age_s = 0, 0.0
            return
        self.age_s = min(self.age_s + (elapsed_s if self.values else period_s), _LONGEST_S)
        self.values = min(self.values + 1, _FEWEST_VALUES)

    def reaches(self, limit_s: float, period_s: float) -> bool:
        """Whether it has lasted for ``limit_s``, to the nearest tick, in more than one value."""
        return self.values >= _FEWEST_VALUES and self.age_s >= limit_s - period_s / 2.0
