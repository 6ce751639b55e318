"""Who may do what: login, control, checks of every request."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_hmi.control_room import DONE, REFUSED, ControlRoom
from fsw_hmi.requests import Acknowledge, ChangeMode, Disturb, Fail, Programme, SafeStop, SetReference, Switch

TOKEN = "a token of some length"
GOOD = {
    "safe_stop": ({}, SafeStop()),
    "set_reference": ({"depth_mm": 2.7, "temperature_c": 820, "ramp": True}, SetReference(2.7, 820.0, True)),
    "switch": ({"controller": "nmpc", "wait_s": 3}, Switch("nmpc", 3.0)),
    "mode": ({"mode": "manual", "force_kn": 78, "speed_rpm": 400}, ChangeMode("manual", 78.0, 400.0)),
    "weld": ({"action": "hold"}, Programme("hold")),
    "acknowledge": ({"ids": ["interlock:depth_high"]}, Acknowledge(("interlock:depth_high",))),
    "disturb": ({"channel": "depth", "shape": "step", "amplitude": 0.1}, Disturb("depth", "step", 0.1, 0.0, 0.0)),
    "fault": ({"sensor": "depth", "kind": "bias", "magnitude": 0.1, "duration_s": 5}, Fail("depth", "bias", 0.1, 5.0)),
}


class Desk:
    """A session whose clock goes on by a second at every request."""

    now_s = 0.0

    def __init__(self, room, name=""):
        self.room, self.session = room, room.join()
        if name:
            assert self.ask("login", token=TOKEN, name=name).outcome == DONE

    def send(self, text):
        Desk.now_s += 1.0
        return self.room.handle(self.session, text, Desk.now_s)

    def ask(self, do, **content):
        return self.send(json.dumps({"id": 7, "do": do, **content}))

    def take(self):
        holder = self.room.holder
        return self.ask("take_control", **{"from": holder and holder.id})


@pytest.fixture
def room():
    return ControlRoom(TOKEN)


def test_login_needs_token_and_name(room):
    desk = Desk(room)
    assert desk.ask("login", token="wrong", name="anna").message == "wrong token"
    assert desk.ask("login", token=None, name="anna").outcome == REFUSED
    for name in ("", " ", "x" * 41, "a\nb", "\ud800", None, 3):
        assert desk.ask("login", token=TOKEN, name=name).outcome == REFUSED
        assert not room.control(desk.session)["authenticated"]
        Desk.now_s += 100.0
    verdict = desk.ask("login", token=TOKEN, name=" Ånna ")
    assert (verdict.outcome, verdict.control) == (DONE, True)
    assert room.control(desk.session) == {"holder": None, "you": False, "authenticated": True}
    assert desk.session.who == f"Ånna ({desk.session.id})"


def test_five_wrong_tokens_shut_everybody_out_for_a_minute(room):
    desks = [Desk(room) for _ in range(5)]
    for desk in desks:
        assert desk.ask("login", token="wrong", name="anna").message == "wrong token"
    assert "wait" in desks[0].ask("login", token=TOKEN, name="anna").message
    Desk.now_s += 60.0
    assert desks[0].ask("login", token=TOKEN, name="anna").outcome == DONE


def test_a_wrong_token_now_and_then_shuts_nobody_out(room):
    desk = Desk(room)
    for _ in range(20):
        assert desk.ask("login", token="wrong", name="anna").message == "wrong token"
        Desk.now_s += 20.0


def test_control_is_taken_only_explicitly(room):
    anna, bert = Desk(room, "anna"), Desk(room, "bert")
    assert anna.ask("mode", mode="hold").message == "you do not have control: take it first"
    assert anna.take().outcome == DONE
    assert room.control(bert.session) == {
        **{"holder": {"name": "anna", "session": anna.session.id}, "you": False, "authenticated": True},
    }
    assert bert.ask("take_control", **{"from": None}).outcome == REFUSED  # he has not seen that she has it
    assert bert.ask("mode", mode="hold").action is None
    assert bert.take().outcome == DONE
    assert anna.ask("mode", mode="hold").action is None
    assert anna.ask("release_control").outcome == REFUSED
    assert bert.ask("release_control").outcome == DONE
    assert room.holder is None


def test_control_is_free_when_its_holder_leaves(room):
    anna, bert = Desk(room, "anna"), Desk(room, "bert")
    anna.take()
    assert not room.leave(bert.session)
    assert room.leave(anna.session)
    assert room.holder is None


@pytest.mark.parametrize("do", GOOD)
def test_who_may_ask_for_what(room, do):
    content, action = GOOD[do]
    viewer, anna, holder = Desk(room), Desk(room, "anna"), Desk(room, "bert")
    holder.take()
    assert viewer.ask(do, **content).message == "log in first"
    assert viewer.ask(do, **content).asked == ""  # nothing to record of strangers
    assert anna.ask(do, **content).action == (action if do == "safe_stop" else None)
    verdict = holder.ask(do, **content)
    assert (verdict.id, verdict.outcome, verdict.action) == (7, "", action)
    assert verdict.asked == str(action)


@pytest.mark.parametrize(
    ("do", "change"),
    [
        ("set_reference", {"depth_mm": 1.4}),
        ("set_reference", {"depth_mm": None}),
        ("set_reference", {"depth_mm": "2.7"}),
        ("set_reference", {"depth_mm": True}),
        ("set_reference", {"temperature_c": 951}),
        ("set_reference", {"temperature_c": 10**400}),
        ("set_reference", {"temperature_c": float("nan")}),
        ("set_reference", {"temperature_c": float("inf")}),
        ("set_reference", {"ramp": 1}),
        ("switch", {"wait_s": 11}),
        ("switch", {"wait_s": -1}),
        ("switch", {"controller": ""}),
        ("switch", {"controller": "a/b"}),
        ("switch", {"controller": "x" * 101}),
        ("mode", {"mode": "start"}),
        ("mode", {"mode": ["auto"]}),
        ("mode", {"force_kn": 59}),
        ("mode", {"speed_rpm": None}),
        ("weld", {"action": "begin"}),
        ("acknowledge", {"ids": []}),
        ("acknowledge", {"ids": "all"}),
        ("acknowledge", {"ids": [1]}),
        ("acknowledge", {"ids": ["\ud800"]}),
        ("disturb", {"channel": "else"}),
        ("disturb", {"shape": {}}),
        ("disturb", {"amplitude": 1.1}),
        ("disturb", {"shape": "ramp", "duration_s": 0}),
        ("disturb", {"shape": "sine", "period_s": None}),
        ("fault", {"sensor": "drives"}),
        ("fault", {"kind": "explode"}),
        ("fault", {"magnitude": -6}),
        ("fault", {"kind": "delay", "magnitude": 61}),
        ("fault", {"duration_s": -1}),
    ],
)
def test_wrong_values_are_refused_in_a_line(room, do, change):
    holder = Desk(room, "anna")
    holder.take()
    verdict = holder.ask(do, **GOOD[do][0] | change)
    assert verdict.outcome == REFUSED
    assert verdict.action is None
    assert 0 < len(verdict.message) <= 200
    assert "\n" not in verdict.message


@pytest.mark.parametrize(
    ("content", "action"),
    [
        ({"channel": "depth", "shape": "none"}, Disturb("depth", "none", 0.0, 0.0, 0.0)),
        ({"channel": "depth", "shape": "sine", "amplitude": 0.1, "duration_s": 0, "period_s": 2}, None),
        ({"channel": "torque", "shape": "pulse", "amplitude": 10, "duration_s": 2, "period_s": 0}, None),
    ],
)
def test_values_that_a_shape_does_not_need_are_left_out(room, content, action):
    holder = Desk(room, "anna")
    holder.take()
    found = holder.ask("disturb", **content).action
    assert found is not None
    assert action is None or found == action


def test_too_many_requests_are_refused_and_in_the_end_shut_the_page_out(room):
    desk = Desk(room, "anna")
    desk.take()
    now_s = Desk.now_s + 10.0
    text = json.dumps({"id": 1, "do": "mode", "mode": "hold"})
    verdicts = [room.handle(desk.session, text, now_s) for _ in range(40)]
    assert [one.action is not None for one in verdicts] == [True] * 10 + [False] * 30
    stop = room.handle(desk.session, json.dumps({"id": 2, "do": "safe_stop"}), now_s)
    assert stop.action == SafeStop()  # the one request that has a share of its own
    assert verdicts[-1].close
    assert not verdicts[15].close
    assert room.handle(desk.session, text, now_s + 1.0).action is not None


@pytest.mark.parametrize(
    "text",
    [
        *(None, "", "{", "[]", "7", "[" * 4000, '{"id": 1}', '{"do": "login"}', '{"id": true, "do": "login"}'),
        *('{"id": 1e3, "do": "safe_stop"}', f'{{"id": {2**60}, "do": "x"}}', '{"id": 1, "do": ["login"]}'),
    ],
)
def test_malformed_messages_count_as_offences(room, text):
    desk = Desk(room, "anna")
    verdicts = [desk.send(text) for _ in range(21)]
    assert all(one.action is None and not one.control for one in verdicts)
    assert [one.close for one in verdicts] == [False] * 20 + [True]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=10,
)
words = st.sampled_from(["login", "take_control", "release_control", *GOOD])
keys = st.sampled_from(
    [
        *("id", "do", "token", "name", "from", "depth_mm", "temperature_c", "ramp", "controller", "wait_s", "mode"),
        *("ids", "force_kn", "speed_rpm", "action", "channel", "shape", "amplitude", "duration_s", "period_s", "kind"),
    ]
)
plausible = st.fixed_dictionaries(
    {"id": st.integers(-5, 5) | json_values, "do": words | json_values},
    optional={"mode": st.sampled_from(["auto", "hold"]), "channel": st.just("depth"), "shape": st.just("step")},
)
messages = (
    st.text(max_size=200)
    | json_values.map(json.dumps)
    | st.tuples(plausible, st.dictionaries(keys, json_values, max_size=8)).map(lambda two: json.dumps(two[1] | two[0]))
)


@settings(max_examples=400)
@given(st.lists(messages, max_size=12))
def test_whatever_a_stranger_sends_nothing_acts_and_nothing_breaks(texts):
    room = ControlRoom(TOKEN)
    holder, stranger = Desk(room, "anna"), Desk(room)
    holder.take()
    for text in texts:
        verdict = stranger.send(text)
        assert verdict.action is None
        assert not verdict.control
        assert not verdict.asked
        assert verdict.outcome == REFUSED
        json.dumps([verdict.id, verdict.message], allow_nan=False)
    assert room.holder is holder.session


@settings(max_examples=400)
@given(st.lists(messages, max_size=12))
def test_whatever_a_person_without_control_sends_only_a_safe_stop_acts(texts):
    room = ControlRoom(TOKEN)
    holder, other = Desk(room, "anna"), Desk(room, "bert")
    holder.take()
    for text in texts:
        verdict = other.send(text)
        if verdict.control:  # he has taken control, and has said from whom
            return
        assert verdict.action is None or verdict.action == SafeStop()
        verdict.asked.encode()


@settings(max_examples=400)
@given(st.lists(messages, max_size=12))
def test_whatever_the_holder_sends_an_action_has_good_values(texts):
    room = ControlRoom(TOKEN)
    holder = Desk(room, "anna")
    holder.take()
    for text in texts:
        action = holder.send(text).action
        if isinstance(action, SetReference):
            assert 1.5 <= action.depth_mm <= 4.0
            assert 750.0 <= action.temperature_c <= 950.0
        if action is not None:
            str(action).encode()
