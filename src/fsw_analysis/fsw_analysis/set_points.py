"""Which set-points were in force at which tick of a recorded weld.

The rule is that of the nodes, `fsw_control.references.ReferenceQueue`, fed with the
recorder's messages: the set-points as sent and as the supervisor reports them. What was published
before the recording began counts from its first tick on. Each controller reports which ones it
followed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fsw_analysis.messages import Kind, WeldMessages
from fsw_analysis.weld_signals import IntArray
from fsw_control.contract import Reference
from fsw_control.ranges import set_point_problem
from fsw_control.references import OWN_CLOCK_NS, ReferenceQueue
from fsw_control.units import NANOSECONDS, mm_from_m

#: topics of set-points: as sent, as the supervisor reports them, and as announced
SENT, HELD, PLANNED = "/fsw/reference", "/fsw/supervisor/reference", "/fsw/reference_plan"
#: time after which a new recorder has received the latched messages
_JOINING_NS = 2 * NANOSECONDS
UNKNOWN_ORDER = (
    f"{SENT}: set-points were sent before the recording began, and this bag does not show in which order: "
    "errors and figures of merit may refer to the wrong ones"
)


class SetPoint(NamedTuple):
    """One message with set-points; times in ns, ``issued_ns`` is its publication or its place in the order."""

    log_ns: int
    issued_ns: int
    stamp_ns: int
    depth_mm: float
    temperature_c: float

    @property
    def reference(self) -> Reference:
        """The set-points themselves."""
        return Reference(self.depth_mm, self.temperature_c)


def read_set_points(messages: WeldMessages, topic: str) -> list[SetPoint]:
    """Valid set-points that were sent (``SENT``) or reported (``HELD``, or by a controller), in order of receipt."""
    fields: dict[str, Kind] = {"depth": "number", "temperature": "number"}
    if topic != SENT:
        fields |= {"issued.sec": "number", "issued.nanosec": "number"}
    table = messages.table(topic, fields)
    issued = table.publish_ns.tolist()
    if topic != SENT:
        parts = zip(
            *(np.nan_to_num(table.column(f"issued.{part}")) for part in ("sec", "nanosec")),
            strict=True,
        )
        issued = [int(sec) * NANOSECONDS + int(nanosec) for sec, nanosec in parts]
    depths_mm = map(mm_from_m, table.column("depth").tolist())
    temperatures = table.column("temperature").tolist()
    rows = zip(
        table.log_ns.tolist(),
        issued,
        table.stamp_ns.tolist(),
        depths_mm,
        temperatures,
        strict=True,
    )
    return [
        point
        for point in map(SetPoint._make, rows)
        if not set_point_problem(point.depth_mm, point.temperature_c)
    ]


def timeline(
    sent: Sequence[SetPoint],
    held: Sequence[SetPoint],
    stamps: IntArray,
    logs: IntArray,
    problems: list[str],
) -> list[tuple[int, Reference]]:
    """Set-points with the stamp of the tick from which each holds, in order.

    Parameters
    ----------
    sent, held : sequence of SetPoint
        Messages on the topics ``SENT`` and ``HELD``, in order of receipt.
    stamps, logs : int array, shape (n_ticks,)
        Stamp and receive time of every tick [ns], in order of stamps.
    problems : list of str
        Gets `UNKNOWN_ORDER` if the set-points in force at the start are ambiguous.
    """
    begin_ns = int(logs[0])
    if sent and all(point.issued_ns == point.log_ns for point in sent):
        # sqlite3 holds no publish times; what came together at first may then be older than the
        # recording
        until_ns = max(begin_ns, sent[0].log_ns + _JOINING_NS)
        early = [item for item in sent if item.log_ns < until_ns and item.stamp_ns <= stamps[0]]
        if len(early) > 1 and not held and not all(point.stamp_ns for point in early):
            problems.append(UNKNOWN_ORDER)
        sent = [p._replace(issued_ns=early.index(p)) if p in early else p for p in sent]
    queue = ReferenceQueue()
    queue.join(begin_ns - OWN_CLOCK_NS)  # from when on the order of receipt counts
    coming = deque(
        sorted(
            (begin_ns if point.issued_ns < begin_ns else point.log_ns, is_held, point)
            for is_held, points in ((False, sent), (True, held))
            for point in points
        )
    )
    begun: list[tuple[int, Reference]] = []
    for stamp_ns, log_ns in zip(stamps.tolist(), logs.tolist(), strict=True):
        while coming and coming[0][0] <= log_ns:
            _, is_held, added = coming.popleft()
            if is_held:
                queue.add(added.stamp_ns, added.reference, added.issued_ns)
            else:
                queue.receive(added.stamp_ns, added.reference, added.issued_ns, added.log_ns)
        present = queue.at(stamp_ns)
        if present is not None and (not begun or present != begun[-1][1]):
            begun.append((stamp_ns, present))
    return begun
