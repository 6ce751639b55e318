"""Alarms of the running graph: judged, listed, and published as a journal on ``fsw/alarms``."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from fsw_control import messages_ros as convert
from fsw_control.cause import AlarmChange
from fsw_control.topics_ros import LATCHED
from fsw_hmi.alarm_rules import AlarmRules
from fsw_hmi.alarms import AlarmList, Entry, flood
from fsw_hmi.answers import Answer, Code
from fsw_hmi.requests import Acknowledge, Shelve, Unshelve
from fsw_hmi.watch_ros import Watch
from fsw_msgs.msg import AlarmEvent


class AlarmDesk:
    """Judges what a :class:`Watch` has received; ``setting`` as of :class:`AlarmRules`."""

    def __init__(self, node: Node, watch: Watch, setting: Callable[[str], float]) -> None:
        self.list = AlarmList(flood, self._publish)
        self._node, self._watch, self.now = node, watch, watch.now
        self._rules = AlarmRules(setting)
        self._reach: dict[str, Any] = {"ok": None, "text": ""}
        self._replaced: dict[str, float] | None = None
        self._journal = node.create_publisher(AlarmEvent, "fsw/alarms", LATCHED)

    def judge(self) -> bool:
        """Determine which alarms are present; returns whether the list has changed."""
        now, now_s = self.now, time.monotonic()
        self._look(now_s)
        present = self._rules.present(now, now_s)
        changed = self.list.update(present, now_s)
        listed = {name: entry.alarm for name, entry in self.list.entries.items() if entry.present}
        before = self._reach, self._replaced
        self._reach, goal = self._rules.reach(now, listed), self._rules.replaced
        replaced = goal and {
            "depth_mm": round(goal.depth_mm, 2),
            "temperature_c": round(goal.temperature_c, 1),
        }
        self._replaced = replaced or None
        return changed or before != (self._reach, self._replaced)

    def frame(self) -> dict[str, Any]:
        """Content of the frame ``alarms``."""
        rows = self.list.rows(time.monotonic(), time.time())
        return {"alarms": rows, "reach": self._reach, "attainable": self._replaced}

    def carry_out(self, action: Acknowledge | Shelve | Unshelve, who: str) -> Answer:
        """Carry out an operator's request."""
        if isinstance(action, Acknowledge):
            ids = action.ids if action.up_to is None else self.list.waiting(action.up_to)
            return Code.ACKNOWLEDGED.done(count=self.list.acknowledge(ids, who))
        if isinstance(action, Unshelve):
            return self.list.unshelve(action.alarm, who)
        shelved = action.alarm, action.minutes, who, action.reason
        return self.list.shelve(*shelved, time.monotonic())

    def _look(self, now_s: float) -> None:
        """Determine ages, without the time in which this process stood still."""
        now, watch, view, awake = self.now, self._watch, self._watch.view, self._watch.awake

        def age_s(came_s: float | None) -> float | None:
            return None if came_s is None else awake.age_s(came_s, now_s)

        now.state_age_s = None if now.state is None else age_s(watch.state_s)
        now.tick_age_s, now.command_age_s = age_s(view.tick_s), age_s(view.command_s)
        now.sample_age_s = {
            name: awake.age_s(good_s, now_s) for name, good_s in view.good_s.items()
        }
        now.programme = watch.progress["state"] if watch.progress else ""
        now.programme_age_s = awake.age_s(watch.progress_s, now_s)
        now.parts = watch.parts()
        now.pages = self._node.count_publishers("fsw/alarms")

    def _publish(
        self,
        name: str,
        kind: AlarmChange,
        entry: Entry,
        who: str = "",
        reason: str = "",
        shelved_for_s: float = 0.0,
    ) -> None:
        self._journal.publish(
            AlarmEvent(
                header=convert.header(int(self._node.get_clock().now().nanoseconds)),
                id=name,
                kind=int(kind),
                priority=entry.alarm.priority,
                text=entry.alarm.text,
                count=entry.count,
                who=who,
                reason=reason,
                shelved_for=shelved_for_s,
            )
        )
