"""Compares what a controller proposed in shadow with what was applied in the weld that it was shown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.differences import Difference
from fsw_analysis.weld_signals import WeldSignals
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError


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
        names = ("controller", "ticks", "unanswered", "unhealthy", "missed")
        comparisons = [
            {"against": one.against, "ticks": one.ticks, "force": one.force.values(), "speed": one.speed.values()}
            for one in self.comparisons
        ]
        return {name: getattr(self, name) for name in names} | {"comparisons": comparisons}


def missed_samples(bag: Path, name: str) -> int:
    """Samples that the controller had to do without, from its last diagnostics in the bag; -1 if there are none."""
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
    sides = [("what was applied", weld.force_kn, weld.speed_rpm)]
    if name in weld.proposals:
        sides.append(("its own recorded proposals", weld.proposals[name].force_kn, weld.proposals[name].speed_rpm))
    comparisons = []
    for against, old_force, old_speed in sides:
        both = answered & np.isfinite(old_force[rows]) & np.isfinite(old_speed[rows])
        ticks = rows[both]
        comparisons.append(
            ShadowComparison(
                against,
                int(both.sum()),
                Difference.of("kN", force[both] - old_force[ticks], ticks, weld.time_s),
                Difference.of("rpm", speed[both] - old_speed[ticks], ticks, weld.time_s),
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
