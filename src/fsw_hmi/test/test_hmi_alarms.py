"""The list of alarms.

Its states, its order, what is told of it, floods, shelves and what came first.
"""

from dataclasses import replace

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from fsw_control.cause import AlarmChange
from fsw_hmi.alarms import FLOOD_ID, RANK, Alarm, AlarmList

LOW, MEDIUM, HIGH = (
    Alarm(f"{name} text", "that follows", "do this", name) for name in ("low", "medium", "high")
)
TRIP = Alarm("stopped", "no weld", "look", "high", trip=True, off_s=0.0)
#: of the wall clock, at the steady clock's zero
WALL_S = 1_700_000_000.0


class Desk:
    """A list with a clock that is set by hand."""

    def __init__(self):
        self.events = []
        self.list = AlarmList(
            lambda count, priority: Alarm(f"{count} more", "", "", priority), self.note
        )
        self.now_s = 0.0

    def update(self, now_s, **present):
        self.now_s = now_s
        return self.list.update(present, now_s)

    def rows(self):
        return self.list.rows(self.now_s, WALL_S + self.now_s)

    def row(self, name):
        return next((row for row in self.rows() if row["id"] == name), None)

    def states(self):
        return {row["id"]: row["state"] for row in self.rows()}

    def acknowledge(self, *names):
        return self.list.acknowledge(names, "anna")

    def shelve(self, name, minutes=1.0):
        return self.list.shelve(name, minutes, "anna", "known", self.now_s)

    def note(self, name, kind, entry, who="", *_):
        self.events.append((name, kind.word, entry.count, who))

    def journal(self):
        events, self.events = self.events, []
        return events


@pytest.fixture
def desk():
    return Desk()


@pytest.mark.requirement("S17")
def test_alarm_goes_through_its_states(desk):
    assert desk.update(1.0, a=HIGH)
    row = desk.row("a")
    assert (row["state"], row["count"], row["raised_s"]) == ("active", 1, WALL_S + 1.0)
    assert (row["text"], row["consequence"], row["advice"]) == (
        "high text",
        "that follows",
        "do this",
    )
    assert not desk.update(2.0, a=HIGH)
    assert desk.acknowledge("a") == 1
    assert desk.acknowledge("a") == 0
    row = desk.row("a")
    assert row["state"] == "acknowledged"
    assert not desk.update(3.0)
    assert desk.update(4.0)
    assert desk.rows() == []
    assert desk.journal() == [
        ("a", "raised", 1, ""),
        ("a", "acknowledged", 1, "anna"),
        ("a", "cleared", 1, ""),
    ]


@pytest.mark.requirement("S17")
def test_alarm_that_is_gone_stays_until_acknowledged_and_comes_again_with_a_new_time_and_a_count(
    desk,
):
    desk.update(1.0, a=HIGH)
    desk.update(2.0)
    desk.update(3.0)
    assert desk.states() == {"a": "cleared"}
    desk.update(4.0, a=HIGH)
    row = desk.row("a")
    assert (row["state"], row["raised_s"], row["count"]) == ("active", WALL_S + 4.0, 2)
    assert row["first_s"] == WALL_S + 1.0
    desk.update(5.0)
    desk.update(6.0)
    assert desk.acknowledge("a", "unknown") == 1
    assert desk.rows() == []
    assert [event for _, event, _, _ in desk.journal()] == [
        "raised",
        "cleared",
        "re-raised",
        "cleared",
        "acknowledged",
    ]


def test_present_ones_stand_above_those_that_are_gone_and_those_above_the_shelved(desk):
    desk.update(1.0, gone=HIGH, shelved=MEDIUM, low=LOW)
    desk.shelve("shelved")
    desk.update(2.0, shelved=MEDIUM, low=LOW, late=MEDIUM)
    desk.update(3.0, shelved=MEDIUM, low=LOW, late=MEDIUM, later=MEDIUM, last=HIGH)
    desk.acknowledge("late")
    assert list(desk.states()) == ["last", "later", "low", "late", "gone", "shelved"]
    desk.acknowledge("last")
    assert list(desk.states()) == ["later", "low", "last", "late", "gone", "shelved"]


@pytest.mark.requirement("S17")
def test_alarm_that_becomes_worse_has_to_be_seen_again(desk):
    desk.update(1.0, a=MEDIUM)
    desk.acknowledge("a")
    desk.shelve("a", 10.0)
    assert desk.update(2.0, a=HIGH)
    row = desk.row("a")
    assert (row["state"], row["priority"], row["raised_s"]) == ("active", "high", WALL_S + 1.0)
    desk.acknowledge("a")
    desk.update(3.0, a=MEDIUM)
    assert desk.states() == {"a": "acknowledged"}
    assert ("a", "worsened", 1, "") in desk.journal()


# ---------------------------------------------------------------- delays


def test_cause_must_last_and_be_gone_for_the_delays_of_its_alarm(desk):
    slow = replace(MEDIUM, on_s=2.0, off_s=3.0)
    desk.update(0.0, a=slow)
    desk.update(1.9, a=slow)
    desk.update(1.95)
    desk.update(2.0, a=slow)
    assert desk.rows() == []
    desk.update(4.0, a=slow)
    assert desk.states() == {"a": "active"}
    desk.update(5.0)
    desk.update(6.0, a=slow)
    desk.update(7.0)
    desk.update(9.9)
    assert desk.states() == {"a": "active"}
    desk.update(10.0)
    assert desk.states() == {"a": "cleared"}


def test_alarm_of_high_priority_is_told_each_time(desk):
    for now_s in range(0, 50, 10):
        desk.update(now_s, a=HIGH)
        desk.update(now_s + 3.0)
        desk.update(now_s + 6.0)
    assert desk.row("a")["count"] == 5


# ---------------------------------------------------------------- floods


LOW_FLOOD = f"{FLOOD_ID}low"


@pytest.mark.parametrize("alarm", [LOW, MEDIUM, HIGH], ids=lambda alarm: alarm.priority)
def test_flood_of_each_priority_is_one_alarm_of_it_that_hides_no_trip(desk, alarm):
    desk.update(0.0, **{f"part:{i}": alarm for i in range(40)}, stop=TRIP, other=MEDIUM)
    listed = [name for name in desk.states() if name.startswith("part:")]
    (group,) = (row for row in desk.rows() if row["id"].startswith(FLOOD_ID))
    assert (len(listed), group["text"], group["priority"]) == (10, "30 more", alarm.priority)
    assert {"stop", "other"} <= desk.states().keys()


def test_flood_of_low_ones_is_one_alarm_with_their_number_and_hides_no_other(desk):
    few = {f"low{i}": LOW for i in range(10)}
    desk.update(0.0, **few)
    assert len(desk.rows()) == 10
    many = {f"low{i}": LOW for i in range(196)}
    desk.update(1.0, **many, bad=HIGH, worse=MEDIUM)
    assert (len(desk.rows()), desk.row(LOW_FLOOD)["text"]) == (13, "186 more")
    assert list(desk.states())[:2] == ["bad", "worse"]
    desk.update(2.0, **many | {"low100": HIGH})
    assert (desk.row("low100")["state"], desk.row(LOW_FLOOD)["text"]) == ("active", "185 more")
    desk.update(30.0, **many)
    assert desk.row(LOW_FLOOD)["text"] == "185 more"
    desk.update(31.0, **few)
    desk.update(33.0, **few)
    assert desk.states()[LOW_FLOOD] == "cleared"
    assert [event for name, event, _, _ in desk.journal() if name == LOW_FLOOD] == [
        "raised",
        "cleared",
    ]


def test_list_has_an_end_but_for_high_priority(desk):
    desk.update(0.0, **{f"medium{i}": MEDIUM for i in range(1000)})
    assert len(desk.rows()) == 301
    desk.update(1.0, **{f"high{i}": HIGH for i in range(5)})
    assert list(desk.states())[:5] == [f"high{i}" for i in range(5)]


# ---------------------------------------------------------------- shelves


def test_shelved_alarm_is_back_when_its_time_is_over(desk):
    desk.update(0.0, a=MEDIUM, b=LOW)
    assert desk.shelve("a", 2.0).outcome == "done"
    assert desk.shelve("b", 2.0).outcome == "done"
    row = desk.row("a")
    assert (row["state"], row["shelved_until_s"], row["shelved"]) == (
        "shelved",
        WALL_S + 120,
        "anna: known",
    )
    assert desk.acknowledge("a") == 0
    desk.update(10.0, a=MEDIUM)
    desk.update(12.0, a=MEDIUM)
    assert desk.states() == {"a": "shelved", "b": "shelved"}
    assert not desk.update(119.9, a=MEDIUM)
    desk.update(120.0, a=MEDIUM)
    assert desk.states() == {"a": "active"}
    assert [event for event in desk.journal() if "shelved" in event[1]] == [
        ("a", "shelved", 1, "anna"),
        ("b", "shelved", 1, "anna"),
        ("a", "unshelved", 1, ""),
        ("b", "unshelved", 1, ""),
    ]


@pytest.mark.parametrize("again", [False, True], ids=["present", "raised again"])
@pytest.mark.parametrize(
    ("cause", "why", "state"), [("late", "3.5 s", "shelved"), ("fails", "", "active")]
)
def test_shelved_alarm_with_another_cause_comes_back(desk, again, cause, why, state):
    desk.update(0.0, a=replace(MEDIUM, cause="late", why="2 s"))
    desk.shelve("a", 60.0)
    if again:
        desk.update(10.0)
        desk.update(20.0)
    desk.update(30.0, a=replace(MEDIUM, cause=cause, why=why))
    assert desk.states() == {"a": state}


def test_all_that_were_on_the_page_are_acknowledged_whatever_their_number(desk):
    desk.update(0.0, **{f"a{n}": MEDIUM for n in range(400)})
    newest = max(row["number"] for row in desk.rows())
    desk.update(900.0, late=HIGH, **{f"a{n}": MEDIUM for n in range(400)})
    waiting = desk.list.waiting(newest)
    assert desk.acknowledge(*waiting) == len(waiting) == 301
    assert [name for name, state in desk.states().items() if state == "active"] == ["late"]


def test_what_has_become_worse_or_left_the_shelf_meanwhile_is_not_acknowledged(desk):
    desk.update(0.0, a=LOW, b=LOW, c=MEDIUM)
    desk.shelve("b")
    newest = max(row["number"] for row in desk.rows())
    desk.update(1.0, a=HIGH, b=LOW, c=MEDIUM)
    desk.list.unshelve("b", "otto")
    assert desk.list.waiting(newest) == ["c"]
    assert desk.list.waiting(max(row["number"] for row in desk.rows())) == ["a", "b", "c"]


def test_shelf_refuses_high_priority_and_what_is_not_there(desk):
    desk.update(0.0, a=HIGH, b=MEDIUM)
    assert desk.shelve("a").code == "high_priority"
    assert desk.shelve("c").code == "not_listed"
    assert desk.list.unshelve("b", "anna").code == "not_shelved"
    desk.shelve("b")
    assert desk.list.unshelve("b", "otto").code == "unshelved"
    assert desk.states() == {"a": "active", "b": "active"}


# ---------------------------------------------------------------- first-out


@pytest.mark.requirement("S17")
def test_what_came_first_before_a_trip_is_marked_until_the_trip_is_acknowledged(desk):
    desk.update(0.0, old=MEDIUM)
    desk.update(100.0, old=MEDIUM, node=LOW)
    desk.update(101.0, old=MEDIUM, node=LOW, cause=MEDIUM)
    assert not any(row["first_out"] for row in desk.rows())
    desk.update(105.0, old=MEDIUM, node=LOW)
    desk.update(106.0, old=MEDIUM, node=LOW, next=HIGH, stop=TRIP)
    assert [row["id"] for row in desk.rows() if row["first_out"]] == ["cause"]
    assert desk.row("stop")["first"] == MEDIUM.text
    desk.acknowledge("cause")
    assert desk.row("stop")["first"] == MEDIUM.text
    desk.acknowledge("stop")
    assert desk.row("stop")["first"] == ""
    assert not any(row["first_out"] for row in desk.rows())


def test_each_trip_has_its_own_first(desk):
    desk.update(0.0, stop=TRIP, cause=MEDIUM)
    desk.update(1.0)
    desk.update(200.0)
    assert desk.row("cause")["first_out"]
    desk.update(201.0, stop=TRIP)
    assert (desk.row("stop")["first_out"], desk.row("cause")["first_out"]) == (True, False)
    assert (desk.row("stop")["first"], desk.row("stop")["count"]) == (TRIP.text, 2)


# ---------------------------------------------------------------- any order of it all

NAMES = st.sampled_from("abcdef")
ALARMS = st.sampled_from(
    [LOW, MEDIUM, HIGH, TRIP, replace(LOW, on_s=2.0), replace(MEDIUM, off_s=5.0)]
)


class AnyOrder(RuleBasedStateMachine):
    """Everything of high priority is listed, alone or as a flood; nothing unseen is lost."""

    def __init__(self):
        super().__init__()
        self.desk, self.present, self.is_raised = Desk(), {}, {}

    @rule(
        present=st.dictionaries(NAMES, ALARMS),
        step_s=st.sampled_from([0.0, 0.5, 2.0, 30.0, 100.0]),
    )
    def look(self, present, step_s):
        unseen = {
            name for name, state in self.desk.states().items() if state in ("active", "cleared")
        }
        self.present = present
        self.desk.update(self.desk.now_s + step_s, **present)
        assert unseen <= self.desk.states().keys()

    @rule(count=st.integers(5, 30), step_s=st.sampled_from([0.5, 2.0, 30.0]))
    def storm(self, count, step_s):
        """Many of a kind at once: those beyond a flood's size are one alarm of their priority."""
        self.look({f"part:{i}": HIGH for i in range(count)} | {"stop": TRIP}, step_s)

    @rule(names=st.sets(NAMES))
    def acknowledge(self, names):
        open_ones = {
            name for name, state in self.desk.states().items() if state in ("active", "cleared")
        }
        assert self.desk.acknowledge(*names) == len(names & open_ones)

    @rule(name=NAMES, minutes=st.sampled_from([1.0, 60.0]))
    def shelve(self, name, minutes):
        row = self.desk.row(name)
        refused = self.desk.shelve(name, minutes).outcome == "refused"
        assert refused == (row is None or row["priority"] == "high")

    @rule(name=NAMES)
    def unshelve(self, name):
        was = self.desk.states().get(name)
        assert (self.desk.list.unshelve(name, "anna").outcome == "done") == (was == "shelved")

    @invariant()
    def high_ones_are_shown(self):
        states = self.desk.states()
        for name, alarm in self.present.items():
            if alarm.priority == "high":
                group = self.desk.list.grouped.get(name)
                assert group is None or not alarm.trip
                shown = name if group is None else f"{FLOOD_ID}{group}"
                assert states.get(shown) in ("active", "acknowledged")
                assert self.desk.row(shown)["priority"] == "high"

    @invariant()
    def the_order_is_by_state_then_priority(self):
        place = {"active": 0, "acknowledged": 1, "cleared": 2, "shelved": 3}
        keys = [(place[row["state"]], RANK[row["priority"]]) for row in self.desk.rows()]
        assert keys == sorted(keys)

    @invariant()
    def the_journal_tells_what_is_present(self):
        for name, kind, *_ in self.desk.journal():
            if kind in (AlarmChange.RAISED.word, AlarmChange.RE_RAISED.word):
                assert not self.is_raised.get(name)
                self.is_raised[name] = True
            elif kind == AlarmChange.CLEARED.word:
                assert self.is_raised[name]
                self.is_raised[name] = False
        present = {name for name, entry in self.desk.list.entries.items() if entry.present}
        assert present == {name for name, is_present in self.is_raised.items() if is_present}

    @invariant()
    def one_first_for_a_trip_at_most(self):
        led = [entry.led_to for entry in self.desk.list.entries.values() if entry.led_to]
        assert len(led) == len(set(led))


AnyOrder.TestCase.settings = settings(stateful_step_count=25, deadline=None)
TestAnyOrder = AnyOrder.TestCase
