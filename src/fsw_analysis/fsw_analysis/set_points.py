"""Which set-points held at which tick of a recorded weld.

The rule is that of the nodes, `fsw_control.references.ReferenceQueue`, which hears here what the recorder received.
What was published before the recording began is heard before its first tick, and what the supervisor states on its own
topic is believed for the beginning. What a controller followed, it states itself: its answers are to be judged by that
(`followed`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fsw_analysis.messages import WeldMessages
from fsw_analysis.weld_signals import MM, IntArray
from fsw_control.contract import Reference
from fsw_control.ranges import set_point_problem
from fsw_control.references import OWN_CLOCK_NS, ReferencePlan, ReferenceQueue
from fsw_control.units import NANOSECONDS, mm_from_m
from fsw_recorder.definitions import Definitions
from fsw_recorder.errors import BagError

#: topics of set-points: as sent, as the supervisor says they hold at present, and as announced
SENT, HELD, PLANNED = "/fsw/reference", "/fsw/supervisor/reference", "/fsw/reference_plan"
#: a recorder that joins has received what was sent before after this time
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
    """Usable set-points that were sent (``SENT``) or stated (``HELD``, of a controller), in order of receipt.

    A statement carries its place in the order as the frame of its header.
    """
    table = messages.table(topic, {"depth": "number", "temperature": "number", "header.frame_id": "text"})
    issued = table.publish_ns.tolist()
    if topic != SENT:
        issued = [int(text) if text.isdecimal() else 0 for text in table.column("header.frame_id")]
    values = (table.column("depth") * MM, table.column("temperature"))
    columns = (table.log_ns.tolist(), issued, table.stamp_ns.tolist(), *(one.tolist() for one in values))
    points = [SetPoint(*row) for row in zip(*columns, strict=True)]
    return [one for one in points if not set_point_problem(one.depth_mm, one.temperature_c)]


def read_plans(messages: WeldMessages) -> list[tuple[int, ReferencePlan]]:
    """Plans that announced set-points, with their receive time [ns], in that order; without those that are refused."""
    plans: list[tuple[int, ReferencePlan]] = []
    topic = messages.topics.get(PLANNED)
    if topic is None:
        return []
    for log_ns, _, data in messages.raw.get(PLANNED, []):
        try:
            plan = Definitions().decode(topic.type_name, topic.definition, data).references
        except BagError as error:
            messages.problems.append(f"{PLANNED}: {error}")
            continue
        points = [
            (
                one.header.stamp.sec * NANOSECONDS + one.header.stamp.nanosec,
                Reference(mm_from_m(one.depth), float(one.temperature)),
            )
            for one in plan
        ]
        if all(before < after for (before, _), (after, _) in pairwise(points)):
            plans.append((log_ns, ReferencePlan(points)))
    return plans


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
        Gets `UNKNOWN_ORDER` when the bag does not show what held when the recording began.
    """
    first = int(stamps[0])
    if sent:
        held = held[:1] if held and 0 < held[0].stamp_ns <= first else []
    # sqlite3 holds no publish times; what came together at first may then be older than the recording
    timed = any(one.issued_ns != one.log_ns for one in sent)
    joined = int(logs[0]) if timed or not sent else max(int(logs[0]), sent[0].log_ns + _JOINING_NS)
    if not timed:
        early = [one for one in sent if one.issued_ns < joined and one.stamp_ns <= first]
        if held:
            sent = [one for one in sent if one not in early]
        elif len(early) > 1 and not all(one.stamp_ns for one in early):
            problems.append(UNKNOWN_ORDER)
    queue = ReferenceQueue()
    queue.join(joined - OWN_CLOCK_NS)  # from when on order of receipt is what counts
    known_from = int(logs[0])
    received = [
        (known_from if one.issued_ns < joined else one.log_ns, is_held, one)
        for is_held, points in ((False, sent), (True, held))
        for one in points
    ]
    coming = deque(sorted(received))
    begun: list[tuple[int, Reference]] = []
    for stamp_ns, log_ns in zip(stamps.tolist(), logs.tolist(), strict=True):
        while coming and coming[0][0] <= log_ns:
            _, is_held, one = coming.popleft()
            if is_held:
                queue.add(one.stamp_ns, one.reference, one.issued_ns)
            else:
                queue.hear(one.stamp_ns, one.reference, one.issued_ns, one.log_ns)
        present = queue.at(stamp_ns)
        if present is not None and (not begun or present != begun[-1][1]):
            begun.append((stamp_ns, present))
    return begun


def followed(stated: Sequence[SetPoint], known: Sequence[SetPoint]) -> list[tuple[int, Reference]]:
    """Set-points that a controller followed, with the stamp of the tick from which it did.

    Parameters
    ----------
    stated : sequence of SetPoint
        Messages on the controller's own topic, in order of receipt.
    known : sequence of SetPoint
        Those that it may have got, to the last bit; conversion on the wire may change that.
    """

    def exact(one: SetPoint) -> SetPoint:
        return next((other for other in known if np.allclose(other[3:], one[3:], rtol=1e-12, atol=0.0)), one)

    return [(one.stamp_ns, exact(one).reference) for one in stated]
