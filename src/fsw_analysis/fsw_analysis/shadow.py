"""Compares what a controller proposed in shadow with what was applied in the weld that it was shown."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.weld_signals import FloatArray, IntArray, WeldSignals
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError

#: kN or rpm; the units on the wire are others, and each conversion rounds
_ROUNDING = 1e-9


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
    first_tick, first_s, first : int, float, float
        First tick that differs by more than rounding, its time [s], and the difference at it.
    differing : int
        Number of ticks that differ by more than rounding; with none of them, ``first_tick`` is -1 and times are None.
    """

    unit: str
    largest: float
    largest_s: float | None
    mean: float
    first_tick: int
    first_s: float | None
    first: float
    differing: int

    @classmethod
    def of(cls, unit: str, values: FloatArray, ticks: IntArray, time_s: FloatArray) -> Difference:
        """Summarise the differences at some of the ticks; ``time_s`` is that of every tick."""
        size = np.abs(values)
        largest, mean = (float(size.max()), float(size.mean())) if size.size else (0.0, 0.0)
        differing = np.flatnonzero(size > _ROUNDING)
        if not differing.size:
            return cls(unit, largest, None, mean, -1, None, 0.0, 0)
        first = int(ticks[differing[0]])
        return cls(
            unit=unit,
            largest=largest,
            largest_s=float(time_s[ticks[np.argmax(size)]]),
            mean=mean,
            first_tick=first,
            first_s=float(time_s[first]),
            first=float(values[differing[0]]),
            differing=int(differing.size),
        )

    def text(self) -> str:
        """The difference in words."""
        if not self.differing:
            return "equal " + ("but for rounding" if self.largest else "bit by bit")
        return (
            f"largest {self.largest:.6g} {self.unit} at {self.largest_s:.1f} s, mean {self.mean:.6g} {self.unit}, "
            f"{self.differing} ticks differ, first tick {self.first_tick} at {self.first_s:.1f} s by "
            f"{self.first:+.6g} {self.unit}"
        )


@dataclass(frozen=True, slots=True)
class ShadowComparison:
    """One comparison: with what, in words, and the differences over the ticks that both have."""

    against: str
    ticks: int
    force: Difference
    speed: Difference


@dataclass(frozen=True, slots=True)
class ShadowReport:
    """Result of a replay with a controller in shadow.

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
    comparisons : list of ShadowComparison
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
            lines.append(f"note: {text}; a lower --rate gives it more time")
        for one in self.comparisons:
            lines.append(f"compared with {one.against}, {one.ticks} ticks (shadow minus recorded):")
            lines += [f"  axial force    {one.force.text()}", f"  spindle speed  {one.speed.text()}"]
        return lines

    def values(self) -> dict[str, Any]:
        """The report as plain values for JSON."""
        return asdict(self)


def missed_samples(bag: Path, name: str) -> int:
    """Samples that the controller had to do without, from its last diagnostics in the bag; -1 if there are none."""
    missed = -1
    with BagReader(bag) as reader:
        for record in reader.records(["/diagnostics"]):
            for status in reader.decode(record).status:
                if status.name == f"fsw_{name}: controller {name}":
                    missed = sum(int(entry.value) for entry in status.values if entry.key.endswith(" missing"))
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
    answered = np.isfinite(proposal.force_kn[at]) & np.isfinite(proposal.speed_rpm[at])
    last = int(np.flatnonzero(answered)[-1]) + 1 if answered.any() else 0
    sides = [("what was applied", weld.force_kn, weld.speed_rpm)]
    if name in weld.proposals:
        sides.append(("its own recorded proposals", weld.proposals[name].force_kn, weld.proposals[name].speed_rpm))
    comparisons = []
    for against, old_force, old_speed in sides:
        force, speed = proposal.force_kn[at] - old_force[rows], proposal.speed_rpm[at] - old_speed[rows]
        both = np.isfinite(force) & np.isfinite(speed)
        forces = Difference.of("kN", force[both], rows[both], weld.time_s)
        speeds = Difference.of("rpm", speed[both], rows[both], weld.time_s)
        comparisons.append(ShadowComparison(against, int(both.sum()), forces, speeds))
    return ShadowReport(
        controller=name,
        ticks=int(rows.size),
        unanswered=int((~answered[:last]).sum()),
        unhealthy=int((proposal.healthy[at] == 0.0).sum()),
        missed=missed,
        comparisons=comparisons,
    )
