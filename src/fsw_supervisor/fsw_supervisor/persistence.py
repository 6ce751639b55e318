"""Duration of an uninterrupted condition."""

from __future__ import annotations

from dataclasses import dataclass

#: a single value may be a spike, however long ago the previous one was
_FEWEST_VALUES = 2
#: longer than any time to compare with [s]
_LONGEST_S = 1000.0


@dataclass(slots=True)
class Persistence:
    """Counts values in a row that meet a condition, and the time that they cover.

    Each covers the time since the previous value, the first one a tick period.
    """

    values: int = 0
    age_s: float = 0.0

    def note(self, shown: bool, elapsed_s: float, period_s: float) -> None:
        """Take a value that arrived ``elapsed_s`` after the previous one."""
        if not shown:
            self.values, self.age_s = 0, 0.0
            return
        self.age_s = min(self.age_s + (elapsed_s if self.values else period_s), _LONGEST_S)
        self.values = min(self.values + 1, _FEWEST_VALUES)

    def reaches(self, limit_s: float, period_s: float) -> bool:
        """Whether it has lasted ``limit_s``, to the nearest tick, in at least two values."""
        return self.values >= _FEWEST_VALUES and self.age_s >= limit_s - period_s / 2.0
