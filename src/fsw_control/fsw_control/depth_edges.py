"""Edges of the surface, which pass below leading sensors, tool and trailing sensors in turn.

A sensor that rides on the surface, ``lead`` ahead of the tool at x, shows depth + s(x + lead) -
s(x), where s is the height of the surface; one of the machine's position shows depth - s(x). s is
modelled as piecewise constant: each known edge has its height as a state of the filters, whose
share in a channel is 1 once the edge has reached the channel, less 1 once it has reached the tool.

A step of the foremost sensor may be an edge or a slip. It is an edge if the next sensor, or all
others when the tool is there, step by as much at the known distance; else it is a slip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fsw_control.depth_bank import EDGES, THREE_SECONDS, Array, DepthBank
from fsw_control.depth_channels import DepthChannel

Mask = NDArray[np.bool_]
#: how far from where it is expected an edge may reach a sensor: of a jump, of one found by means
TOLERANCE_MM, SLOW_TOLERANCE_MM = 2.0, 6.0
#: share of an edge's height within which what another sensor shows of it must agree
_ALIKE = 0.5
#: standard deviation of an edge's height when it is first taken into the filters [mm]
_HEIGHT_MM = 0.02


@dataclass(slots=True)
class _Edge:
    """An edge at a place of the tool's path, or a step that may be one."""

    place_mm: float
    tolerance_mm: float
    height_mm: float  #: as first seen; the filters know it better
    passed: Mask  #: by channel, and of the tool at last, whether the edge has reached it
    votes: NDArray[np.int_]  #: by channel, samples that show the step, less those that do not
    slot: int = -1  #: state of the filters; -1: not confirmed
    channel: int = -1  #: that saw it first


class SurfaceEdges:
    """Known edges near the tool, and at most one step that may be another."""

    def __init__(self, channels: Mapping[str, DepthChannel], confirm_samples: int) -> None:
        self._confirm_samples = confirm_samples
        #: of each channel and of the tool; one that does not ride on the surface meets no edge
        self._leads = np.array(
            [*(row.lead_mm if row.rides else -math.inf for row in channels.values()), 0.0]
        )
        self._travel_mm, self._moves = math.nan, False
        self._known: list[_Edge] = []
        self._pending: _Edge | None = None

    def move(self, travel_mm: float) -> None:
        """Take the distance that the tool has travelled along its path; NaN: unknown."""
        self._moves = travel_mm > self._travel_mm
        self._travel_mm = travel_mm

    def suspect(self, channel: int, height_mm: float, usable: Mask, slow: bool) -> bool:
        """Whether a step of a channel may be an edge: no other could have seen it before."""
        lead = self._leads[channel]
        ahead = usable & (self._leads[:-1] > lead)
        if not (self._moves and lead > 0.0) or ahead.any() or self._pending:
            return False
        if len(self._known) == EDGES:
            return False
        self._pending = _Edge(
            self._travel_mm + lead,
            SLOW_TOLERANCE_MM if slow else TOLERANCE_MM,
            height_mm,
            self._leads >= lead,
            np.zeros(len(self._leads), int),
            channel=channel,
        )
        return True

    def doubtful(self, z: Array) -> Mask:
        """Channels that may just show the pending step as an edge: it is not known yet."""
        edge = self._pending
        if edge is None:
            return np.zeros(len(z), bool)
        near = abs(self._beyond(edge)[:-1]) <= edge.tolerance_mm
        return near & ~edge.passed[:-1] & _alike(z, edge.height_mm)

    def review(
        self, bank: DepthBank, values: Array, usable: Mask
    ) -> tuple[int | None, int | None]:
        """The channel whose pending step is an edge after all, and the one where it is a slip."""
        edge, z = self._pending, bank.z[0]
        if edge is None:
            return None, None
        if not math.isnan(values[edge.channel]):
            edge.height_mm += (z[edge.channel] - edge.height_mm) * THREE_SECONDS
        beyond = self._beyond(edge)
        at_tool = -float(np.median(z[usable])) if usable.any() else math.nan
        jumps = np.append(np.where(usable, z, np.nan), at_tool)
        alike = _alike(jumps, edge.height_mm)
        due = ~edge.passed & (self._leads >= 0.0) & ~np.isnan(jumps)
        near = due & (abs(beyond) <= edge.tolerance_mm)
        edge.votes = np.where(near, np.maximum(edge.votes + np.where(alike, 1, -1), 0), 0)
        # all channels follow a change of the depth within a tick: only that tick shows it
        if near[-1] and alike[-1]:
            return self._accept(-1, bank), None
        if edge.votes.max() >= self._confirm_samples:
            return self._accept(int(np.argmax(edge.votes)), bank), None
        if (due & (beyond > edge.tolerance_mm)).any() or math.isnan(self._travel_mm):
            self._pending = None
            return None, edge.channel
        return None, None

    def _beyond(self, edge: _Edge) -> Array:
        """How far each channel, and the tool, is past the place of an edge."""
        return np.asarray(self._travel_mm + self._leads - edge.place_mm)

    def _accept(self, reached: int, bank: DepthBank) -> int:
        """Make the pending step an edge that has also reached another channel, or the tool."""
        edge, self._pending = self._pending, None
        assert edge is not None
        edge.slot = min(set(range(EDGES)) - {one.slot for one in self._known})
        edge.passed |= self._leads >= self._leads[reached]
        self._known.append(edge)
        bank.begin_edge(edge.slot, edge.height_mm, _HEIGHT_MM)
        self._share(edge, bank)
        return edge.channel

    def drop(self, channel: int) -> None:
        """Forget the pending step of a channel, which is back where it was."""
        if self._pending is not None and self._pending.channel == channel:
            self._pending = None

    def arrive(self, bank: DepthBank, usable: Mask) -> bool:
        """Note what the known edges have reached; returns whether the shares have changed.

        The places are known to within the tolerance; there the likelier decides: a sample nearer
        to the height of the edge, or to none.
        """
        z, changed = bank.z[0], False
        for edge in list(self._known):
            height_mm = bank.edge_mm(edge.slot)
            beyond = self._beyond(edge)
            at_tool = -float(np.median(z[usable])) if usable.any() else 0.0
            jumps = np.append(np.where(usable, z, 0.0), at_tool)
            seen = jumps * np.sign(height_mm) > _ALIKE * abs(height_mm)
            now = ~edge.passed & (beyond >= -edge.tolerance_mm)
            now &= seen | (beyond > edge.tolerance_mm)
            if now.any():
                changed = True
                edge.passed |= now
                self._share(edge, bank)
            if edge.passed[np.isfinite(self._leads)].all():
                bank.end_edge(edge.slot)
                self._known.remove(edge)
        return changed

    @staticmethod
    def _share(edge: _Edge, bank: DepthBank) -> None:
        bank.edge_shares[:, edge.slot] = edge.passed[:-1].astype(float) - edge.passed[-1]


def _alike(jumps_mm: Array, height_mm: float) -> Mask:
    return np.asarray(abs(jumps_mm - height_mm) < _ALIKE * abs(height_mm))
