"""Compares what a controller proposed in shadow with what was applied in the weld that it was shown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.weld_signals import WeldSignals

FloatArray = npt.NDArray[np.float64]
#: kN or rpm; the units on the wire are others, and each conversion rounds
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class HandleDifference:
    """Shadow minus recorded, of one handle.

    Attributes
    ----------
    unit : str
        Of all differences.
    largest : float
        Largest absolute difference.
    largest_s : float
        When, in seconds since the first tick of the weld.
    mean : float
        Mean absolute difference.
    first_tick : int
        First tick that differs by more than rounding; -1 when none does.
    first_s : float
        Its time [s]; NaN when none differs.
    first : float
        Difference at that tick; 0 when none differs.
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


@dataclass(frozen=True, slots=True)
class ShadowComparison:
    """One comparison over all ticks that both have.

    Attributes
    ----------
    against : str
        What the proposals are compared with, in words.
    ticks : int
        Ticks compared.
    force, speed : HandleDifference
        Axial force [kN] and spindle speed [rpm].
    """

    against: str
    ticks: int
    force: HandleDifference
    speed: HandleDifference


@dataclass(frozen=True, slots=True)
class ShadowReport:
    """What came of a replay with a controller in shadow.

    Attributes
    ----------
    controller : str
    ticks : int
        Ticks that were replayed.
    unanswered : int
        Ticks without a proposal, up to the last that the controller answered.
    unhealthy : int
        Proposals that the controller itself called not healthy.
    missed : int
        Samples that the controller did without, because they reached it too late or never; -1 if it did not say.
    comparisons : list[ShadowComparison]
        With what was applied; and with its own recorded proposals, where the bag has them.
    """

    controller: str
    ticks: int
    unanswered: int
    unhealthy: int
    missed: int
    comparisons: list[ShadowComparison]

    def lines(self) -> list[str]:
        """The report in words."""
        lines = [
            f"{self.controller} in shadow: {self.ticks} ticks replayed, {self.unanswered} without a proposal, "
            f"{self.unhealthy} not healthy"
        ]
        if self.missed < 0:
            lines.append("note: the controller does not say whether it got all samples")
        elif self.missed:
            text = f"{self.missed} samples reached the controller too late or never"
            lines.append(f"note: {text}; at a lower --rate it has more time")
        for one in self.comparisons:
            lines.append(f"compared with {one.against}, {one.ticks} ticks (shadow minus recorded):")
            for name, handle in (("axial force", one.force), ("spindle speed", one.speed)):
                if handle.first_tick < 0:
                    lines.append(f"  {name:13}  equal " + ("but for rounding" if handle.largest else "bit by bit"))
                    continue
                lines.append(
                    f"  {name:13}  largest {handle.largest:.6g} {handle.unit} at {handle.largest_s:.1f} s, "
                    f"mean {handle.mean:.6g} {handle.unit}, {handle.differing} ticks differ, first tick "
                    f"{handle.first_tick} at {handle.first_s:.1f} s by {handle.first:+.6g} {handle.unit}"
                )
        return lines

    def values(self) -> dict[str, Any]:
        """The report as plain values for JSON; NaN becomes None."""

        def handle(one: HandleDifference) -> dict[str, Any]:
            named = {name: getattr(one, name) for name in HandleDifference.__slots__}
            return {name: None if value != value else value for name, value in named.items()}

        return {
            "controller": self.controller,
            "ticks": self.ticks,
            "unanswered": self.unanswered,
            "unhealthy": self.unhealthy,
            "missed": self.missed,
            "comparisons": [
                {"against": one.against, "ticks": one.ticks, "force": handle(one.force), "speed": handle(one.speed)}
                for one in self.comparisons
            ],
        }


def missed_samples(bag: Path, name: str) -> int:
    """Samples that the controller had to do without, as its last diagnostics in the bag tell; -1 if there are none."""
    missed = -1
    with BagReader(bag) as reader:
        for record in reader.records(["/diagnostics"]):
            for status in reader.decode(record).status:
                if status.name == f"fsw_{name}: controller {name}":
                    counts = {entry.key: entry.value for entry in status.values}
                    missed = sum(int(value) for key, value in counts.items() if key.endswith(" missing"))
    return missed


def compare_shadow(weld: WeldSignals, shadow: WeldSignals, name: str, missed: int = -1) -> ShadowReport:
    """Compare the proposals in a shadow bag with the weld that was replayed.

    Parameters
    ----------
    weld : WeldSignals
        The recorded weld.
    shadow : WeldSignals
        What was recorded during its replay; holds the proposals of the controller in shadow.
    name : str
        The controller's name.
    missed : int
        From `missed_samples`.

    Raises
    ------
    BagError
        The controller has proposed nothing, or the two bags have no tick in common.
    """
    if name not in shadow.proposals:
        raise BagError(f"{shadow.path}: {name} has proposed nothing")
    proposal = shadow.proposals[name]
    _, rows, at = np.intersect1d(weld.stamp_ns, shadow.stamp_ns, assume_unique=True, return_indices=True)
    if not rows.size:
        raise BagError(f"{shadow.path}: has no tick of {weld.path}")
    force, speed = proposal.force_kn[at], proposal.speed_rpm[at]
    answered = np.isfinite(force) & np.isfinite(speed)
    last = int(np.flatnonzero(answered)[-1]) + 1 if answered.any() else 0
    sides: list[tuple[str, FloatArray, FloatArray]] = [("what was applied", weld.force_kn, weld.speed_rpm)]
    if name in weld.proposals:
        own = weld.proposals[name]
        sides.append(("its own recorded proposals", own.force_kn, own.speed_rpm))
    comparisons = []
    for against, old_force, old_speed in sides:
        both = answered & np.isfinite(old_force[rows]) & np.isfinite(old_speed[rows])
        ticks = rows[both]
        comparisons.append(
            ShadowComparison(
                against,
                int(both.sum()),
                _difference("kN", force[both] - old_force[ticks], ticks, weld.time_s),
                _difference("rpm", speed[both] - old_speed[ticks], ticks, weld.time_s),
            )
        )
    return ShadowReport(
        controller=name,
        ticks=int(rows.size),
        unanswered=int((~answered[:last]).sum()),
        unhealthy=int((proposal.healthy[at] == 0.0).sum()),
        missed=missed,
        comparisons=comparisons,
    )


def _difference(unit: str, values: FloatArray, ticks: npt.NDArray[np.int64], time_s: FloatArray) -> HandleDifference:
    size = np.abs(values)
    differing = np.flatnonzero(size > ROUNDING)
    if not differing.size:
        largest, mean = (float(size.max()), float(size.mean())) if size.size else (0.0, 0.0)
        return HandleDifference(unit, largest, float("nan"), mean, -1, float("nan"), 0.0, 0)
    worst, first = int(np.argmax(size)), int(differing[0])
    return HandleDifference(
        unit=unit,
        largest=float(size[worst]),
        largest_s=float(time_s[ticks[worst]]),
        mean=float(size.mean()),
        first_tick=int(ticks[first]),
        first_s=float(time_s[ticks[first]]),
        first=float(values[first]),
        differing=int(differing.size),
    )
