"""All tuning of the NMPC as data, with the presets ``paper`` and ``default``."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isfinite

PRESETS: dict[str, dict[str, float | str]] = {
    # (28)-(37) of the paper
    "paper": {
        "corridor": "recentred",
        "corridor_depth_s": 5.0,
        "corridor_temperature_s": 5.0,
        "dead_band_depth_mm": 2e-3,
        "dead_band_temperature_c": 0.1,
        "weight_depth_per_mm": 100.0,
        "weight_temperature_per_c": 1.0,
        "square_depth_per_mm2": 0.0,
        "square_temperature_per_c2": 0.0,
        "move_force_per_kn": 1.0,
        "move_speed_per_rpm": 0.01,
        "move_force_square": 0.0,
        "move_speed_square": 0.0,
    },
    "default": {},
}


@dataclass(frozen=True, slots=True)
class Tuning:
    """Weights, dead-bands and corridors of the cost.

    Attributes
    ----------
    corridor : str
        ``continuing``: the filtered set-point goes on by itself, so a disturbance is met at once; ``recentred``: as in
        the paper, the corridor starts at the measurement in every cycle.
    corridor_depth_s, corridor_temperature_s : float
        Time constants of the first-order set-point corridors.
    dead_band_depth_mm, dead_band_temperature_c : float
        Half widths of the dead-bands.
    weight_depth_per_mm, weight_temperature_per_c : float
        L1 weights outside the dead-band, per output point.
    square_depth_per_mm2, square_temperature_per_c2 : float
        Quadratic weights on the deviation from the corridor's centre, per output point.
    move_force_per_kn, move_speed_per_rpm : float
        L1 weights on the moves of an interval.
    move_force_square, move_speed_square : float
        Quadratic weights on the moves of an interval, per kN^2 and per (3 rpm)^2.
    interval_weighting : float
        0: every output point counts the same, as in the paper; 1: in proportion to its interval's length over 0.1 s;
        between: the length to this power.
    """

    corridor: str = "continuing"
    corridor_depth_s: float = 5.0
    corridor_temperature_s: float = 5.0
    dead_band_depth_mm: float = 3e-4
    dead_band_temperature_c: float = 0.02
    weight_depth_per_mm: float = 55.0
    weight_temperature_per_c: float = 1.0
    square_depth_per_mm2: float = 0.0
    square_temperature_per_c2: float = 0.0
    move_force_per_kn: float = 0.3
    move_speed_per_rpm: float = 0.01
    move_force_square: float = 0.3
    move_speed_square: float = 0.3
    interval_weighting: float = 0.0

    def __post_init__(self) -> None:
        if self.corridor not in ("continuing", "recentred"):
            raise ValueError(f"tuning 'corridor' is {self.corridor!r}: must be 'continuing' or 'recentred'")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "corridor" and not (isfinite(value) and value >= 0.0):
                raise ValueError(f"tuning {field.name!r} is {value!r}: must be a finite number >= 0")

    @classmethod
    def preset(cls, name: str) -> Tuning:
        """A named set, see ``PRESETS``.

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name not in PRESETS:
            raise ValueError(f"tuning preset {name!r} is unknown; known: {', '.join(PRESETS)}")
        return replace(cls(), **PRESETS[name])  # type: ignore[arg-type]
