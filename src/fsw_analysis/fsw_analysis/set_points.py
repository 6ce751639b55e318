"""Which set-points held at which tick of a recorded weld.

The rule is that of the nodes (`fsw_control.references`): at a tick those hold that were received last among all whose
stamp has come; when they begin, everything before them is void, also what was sent ahead for later. Only those that are
older than the recording have their order by publish time: a recorder that joins in mid-weld receives them at once, in
any order. What the supervisor states on its own topic is believed for the beginning of the recording. What a controller
followed, it states itself: its answers are to be judged by that (`followed`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fsw_analysis.messages import ISSUED, WeldMessages
from fsw_analysis.weld_signals import MM, IntArray
from fsw_control.contract import Reference
from fsw_control.ranges import set_point_problem
from fsw_control.references import OTHER_CLOCK_NS, OWN_CLOCK_NS, ReferencePlan
from fsw_control.units import NANOSECONDS, mm_from_m
from fsw_recorder.definitions import Definitions
from fsw_recorder.errors import BagError

#: topics of set-points: as sent, as the supervisor says they hold at present, and as announced
SENT, HELD, PLANNED = "/fsw/reference", "/fsw/supervisor/reference", "/fsw/reference_plan"
#: a recorder that joins has received what was sent before after this time
_JOINING_NS = 2 * NANOSECONDS
#: before everything
_LONG_AGO = -(2**62)
UNKNOWN_ORDER = (
    f"{SENT}: set-points were sent before the recording began, and this bag does not show in which order: "
    "errors and figures of merit may refer to the wrong ones"
)


class SetPoint(NamedTuple):
    """One message with set-points; times in ns."""

    log_ns: int
    issued_ns: int
    stamp_ns: int
    depth_mm: float
    temperature_c: float


def read_set_points(messages: WeldMessages, topic: str) -> list[SetPoint]:
    """Usable set-points of one of the topics ``SENT`` and ``HELD``, in order of receipt."""
    table = messages.table(topic, {"depth": "number", "temperature": "number", **ISSUED})
    issued = table.time_ns(*ISSUED)
    times = (table.log_ns, np.where(issued > 0, issued, table.publish_ns), table.stamp_ns)
    values = (table.column("depth") * MM, table.column("temperature"))
    points = [SetPoint(*row) for row in zip(*(one.tolist() for one in (*times, *values)), strict=True)]
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
) -> list[tuple[int, SetPoint]]:
    """Set-points with the stamp from which each holds, in order.

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
    # sqlite3 holds no publish times; what came together at first may then be older than the recording
    timed = any(one.issued_ns != one.log_ns for one in sent)
    joined = int(logs[0]) if timed or not sent else max(int(logs[0]), sent[0].log_ns + _JOINING_NS)
    entries: list[tuple[int, SetPoint]] = []
    stampless = 0
    for one in sorted(sent, key=lambda one: (one.issued_ns >= joined, min(one.issued_ns, joined))):
        if one.issued_ns > one.log_ns + OWN_CLOCK_NS:
            continue  # refused by everyone
        stamped = one.stamp_ns > 0 and abs(one.stamp_ns - first) < OTHER_CLOCK_NS
        begins = one.stamp_ns if stamped else _LONG_AGO
        if one.issued_ns >= joined:  # received at once; the next tick is the first that it can hold for
            row = int(np.searchsorted(logs, one.log_ns))
            begins = max(begins, int(stamps[row]) if row < stamps.size else int(stamps[-1]) + 1)
        elif not timed and not stamped:
            stampless += 1
            entries.insert(0, (begins, one))
            continue
        entries = [entry for entry in entries if entry[0] <= begins]
        entries.append((begins, one))
    if held and (not sent or 0 < held[0].stamp_ns <= first):
        stated = [(one.stamp_ns or first, one) for one in held]
        entries = stated if not sent else [stated[0], *(entry for entry in entries if entry[0] > first)]
    elif stampless and sum(begins <= first for begins, _ in entries) > 1:
        problems.append(UNKNOWN_ORDER)
    return sorted(entries, key=lambda entry: entry[0])


def followed(stated: Sequence[SetPoint], known: Sequence[SetPoint]) -> list[tuple[int, SetPoint]]:
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

    return [(one.stamp_ns, exact(one)) for one in stated]
