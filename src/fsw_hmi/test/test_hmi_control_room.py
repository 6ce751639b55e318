"""Who may do what: login, control, checks of every request."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, rule

from fsw_hmi.answers import DONE, REFUSED
from fsw_hmi.control_room import ControlRoom
from fsw_hmi.requests import (
    Acknowledge,
    AcknowledgeStop,
    ChangeMode,
    Programme,
    SafeStop,
    SetReference,
    Switch,
)
from fsw_hmi.users import Users

TOKEN = "a token of some length"


class Known(Users):
    """Whoever knows the token, without the cost of a hash."""

    def check(self, name, password):
        return name if password == TOKEN else ""


KNOWN = Known(token=TOKEN)
#: names that are none, or might be taken for another's
CONFUSING = (
    "",
    " ",
    "x" * 33,
    "a\nb",
    None,
    3,
    "Ånna",
    "аnna",
    "anna b",
    "anna\u200b",
    "-anna",
    ".",
    "a/b",
    "<b>",
)
HERE, THERE = "127.0.0.1", "192.0.2.4"
GOOD = {
    "safe_stop": ({}, SafeStop()),
    "acknowledge_stop": ({}, AcknowledgeStop()),
    "set_reference": (
        {"depth_mm": 2.7, "temperature_c": 820, "ramp": True},
        SetReference(depth_mm=2.7, temperature_c=820.0, ramp=True),
    ),
    "switch": ({"controller": "nmpc", "wait_s": 3}, Switch(controller="nmpc", wait_s=3.0)),
    "mode": (
        {"mode": "manual", "force_kn": 78, "speed_rpm": 400},
        ChangeMode(mode="manual", force_kn=78.0, speed_rpm=400.0),
    ),
    "weld": ({"action": "hold"}, Programme(action="hold")),
    "acknowledge": ({"ids": ["interlock:depth_high"]}, Acknowledge(ids=("interlock:depth_high",))),
}


def handle(room, session, text, now_s):
    """The order of a message, of a login after its check."""
    order = room.handle(session, text, now_s)
    if session.login is None:
        return order
    return room.on_checked(session, room.check(session), now_s)


class Desk:
    """A session whose clock advances by a second at every request."""

    now_s = 0.0

    def __init__(self, room, name="", address=HERE):
        self.room, self.session = room, room.join(address)
        if name:
            assert self.ask("login", token=TOKEN, name=name).answer.outcome == DONE

    def send(self, text):
        Desk.now_s += 1.0
        return handle(self.room, self.session, text, Desk.now_s)

    def ask(self, do, **content):
        return self.send(json.dumps({"id": 7, "do": do, **content}))

    def take(self):
        return self.ask("take_control")

    def control(self):
        return self.room.control(self.session, Desk.now_s)


@pytest.fixture
def room():
    return ControlRoom(KNOWN)


def test_login_needs_token_and_name(room):
    desk = Desk(room)
    assert desk.ask("login", token="wrong", name="anna").answer.code == "wrong_token"
    assert desk.ask("login", token=None, name="anna").answer.outcome == REFUSED
    # half a character is no text of JSON
    assert desk.ask("login", token=TOKEN, name="\ud800").answer.code == "malformed"
    for name in CONFUSING:
        verdict = desk.ask("login", token=TOKEN, name=name)
        assert (verdict.answer.outcome, verdict.answer.code) == (REFUSED, "not_a_name")
        assert not desk.control()["authenticated"]
    verdict = desk.ask("login", token=TOKEN, name=" anna.b ")
    assert verdict.answer.outcome == DONE
    assert desk.control() | {"ticket": ""} == {
        **{"holder": None, "you": False, "request": None, "name": "anna.b"},
        **{
            "authenticated": True,
            "ticket": "",
            "may_stop": True,
            "note": "",
            "note_code": "",
        },
    }
    assert desk.session.who == f"anna.b ({desk.session.id})"


@pytest.mark.requirement("S30")
def test_pages_that_log_in_again_with_an_old_token_shut_nobody_out(room):
    for _ in range(20):
        assert (
            Desk(room).ask("login", token="an older one", name="anna").answer.message
            == "wrong token"
        )
    assert Desk(room).ask("login", token=TOKEN, name="anna").answer.outcome == DONE


@pytest.mark.requirement("S30")
def test_safe_stop_on_this_computer_needs_no_login_unless_configured(room):
    assert Desk(room, address=HERE).ask("safe_stop").asked == "safe stop"
    assert Desk(room, address=THERE).ask("safe_stop").answer.message == "log in first"
    assert (
        Desk(ControlRoom(KNOWN, local_stop=False), address=HERE).ask("safe_stop").answer.message
        == "log in first"
    )


class Misuse(RuleBasedStateMachine):
    """Whatever anybody does.

    Who knows the token gets in, and who has, or is on this computer, can stop, every time.
    """

    pages = Bundle("pages")

    def __init__(self):
        super().__init__()
        self.room, self.now_s, self.allowed = ControlRoom(KNOWN), 0.0, {}

    def send(self, page, **content):
        return handle(self.room, page, json.dumps({"id": 1, **content}), self.now_s)

    @rule(target=pages, address=st.sampled_from([HERE, "::1", THERE, "192.0.2.8", "2001:db8::1"]))
    def open_page(self, address):
        page = self.room.join(address)
        self.allowed[page.id] = page, address in (HERE, "::1")
        return page

    @rule(page=pages)
    def loses_its_connection_or_is_stale(self, page):
        self.room.leave(page)
        self.allowed.pop(page.id, None)

    @rule(page=pages, token=st.text(max_size=3), times=st.integers(1, 30))
    def logs_in_with_wrong_tokens(self, page, token, times):
        for number in range(times):
            assert (
                self.send(page, do="login", token=f"{token}{number}", name="x").answer.outcome
                == REFUSED
            )

    @rule(page=pages)
    def logs_in(self, page):
        answer = self.send(page, do="login", token=TOKEN, name="anna")
        assert answer.answer.outcome == DONE or answer.answer.code == "too_many"  # of this page
        if answer.answer.outcome == DONE and page.id in self.allowed:
            self.allowed[page.id] = page, True

    @rule(address=st.sampled_from([HERE, THERE, "2001:db8::1"]))
    def another_opens_a_page_and_logs_in(self, address):
        self.logs_in(page := self.open_page(address))
        assert page.name == "anna"

    @rule(page=pages, times=st.integers(1, 30))
    def asks_hastily(self, page, times):
        for _ in range(times):
            self.send(page, do="take_control")

    @rule(page=pages)
    def sends_nonsense(self, page):
        self.room.handle(page, "{", self.now_s)

    @rule(passed_s=st.floats(0.0, 100.0))
    def time_passes(self, passed_s):
        self.now_s += passed_s

    @invariant()
    def who_may_stop_can_stop(self):
        for page, allowed in self.allowed.values():
            for _ in range(3):
                verdict = self.send(page, do="safe_stop")
                assert (verdict.action == SafeStop(), verdict.close and allowed) == (
                    allowed,
                    False,
                )


TestMisuse = Misuse.TestCase
TestMisuse.settings = settings(stateful_step_count=30, deadline=None)


def test_control_is_taken_only_explicitly(room):
    anna, bert = Desk(room, "anna"), Desk(room, "bert")
    assert anna.ask("mode", mode="hold").answer.code == "take_first"
    assert anna.take().answer.outcome == DONE
    assert (bert.control()["holder"], bert.control()["you"]) == (
        {"name": "anna", "session": anna.session.id},
        False,
    )
    assert bert.ask("take_control").answer.outcome == REFUSED
    assert bert.ask("mode", mode="hold").action is None
    assert bert.take().answer.code == "ask_first"
    assert bert.ask("request_control").answer.outcome == DONE
    assert bert.take().answer.code == "time_left"
    Desk.now_s += 30.0
    assert bert.take().answer.code == "taken_from_silent"
    assert (anna.control()["note_code"], "bert" in anna.control()["note"]) == ("taken", True)
    assert anna.ask("mode", mode="hold").action is None
    assert anna.ask("release_control").answer.outcome == REFUSED
    assert bert.ask("release_control").answer.outcome == DONE
    assert room.holder is None


def test_control_is_free_when_its_holder_leaves(room):
    anna, bert = Desk(room, "anna"), Desk(room, "bert")
    anna.take()
    room.leave(bert.session)
    assert room.holder is anna.session
    room.leave(anna.session)
    assert room.holder is None


@pytest.mark.requirement("S18")
def test_page_that_was_cut_off_resumes_its_session_with_control(room):
    anna = Desk(room, "anna", THERE)
    anna.take()
    room.lose(anna.session, Desk.now_s)
    room.tick(Desk.now_s + 9.9)
    assert room.join(THERE, anna.session.token) is room.holder is anna.session
    room.tick(Desk.now_s + 60.0)
    assert anna.ask("mode", mode="hold").action


@pytest.mark.requirement("S18")
@pytest.mark.parametrize(
    ("address", "token", "after_s"),
    [("192.0.2.9", None, 1.0), (THERE, "guess", 1.0), (THERE, "", 1.0), (THERE, None, 10.1)],
)
def test_nobody_else_resumes_a_session_nor_anybody_too_late(room, address, token, after_s):
    anna = Desk(room, "anna", THERE)
    anna.take()
    room.lose(anna.session, Desk.now_s)
    records = room.tick(Desk.now_s + after_s)
    other = room.join(address, anna.session.token if token is None else token)
    assert other is not anna.session and not other.name
    lost = [(record.who, record.answer.message) for record in records]
    late = [(anna.session.who, "its page was not connected for 10 s")]
    assert lost == (late if after_s > 10.0 else [])


def test_session_of_a_stranger_ends_with_its_connection(room):
    viewer = Desk(room, address=THERE)
    room.lose(viewer.session, 0.0)
    assert room.join(THERE, viewer.session.token) is not viewer.session


@pytest.mark.requirement("S18")
@pytest.mark.parametrize("do", GOOD)
def test_who_may_ask_for_what(room, do):
    content, action = GOOD[do]
    viewer, anna, holder = Desk(room, address=THERE), Desk(room, "anna"), Desk(room, "bert")
    holder.take()
    assert viewer.ask(do, **content).answer.message == "log in first"
    assert viewer.ask(do, **content).asked == ""  # nothing to record of strangers
    assert anna.ask(do, **content).action == (action if do == "safe_stop" else None)
    verdict = holder.ask(do, **content)
    assert (verdict.id, verdict.answer.outcome, verdict.action) == (7, "", action)
    assert verdict.asked == str(action)


@pytest.mark.requirement("S18")
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
        ("acknowledge", {"ids": ["a"], "up_to": 3}),
        ("acknowledge", {"up_to": 0}),
        ("acknowledge", {"ids": [1]}),
        ("acknowledge", {"ids": ["\ud800"]}),
    ],
)
def test_wrong_values_are_refused_in_a_line(room, do, change):
    holder = Desk(room, "anna")
    holder.take()
    verdict = holder.ask(do, **GOOD[do][0] | change)
    assert verdict.answer.outcome == REFUSED
    assert verdict.action is None
    assert 0 < len(verdict.answer.message) <= 200
    assert "\n" not in verdict.answer.message


def test_too_many_requests_are_refused_and_in_the_end_shut_the_page_out(room):
    desk = Desk(room, "anna")
    desk.take()
    now_s = Desk.now_s + 10.0
    text = json.dumps({"id": 1, "do": "mode", "mode": "hold"})
    verdicts = [room.handle(desk.session, text, now_s) for _ in range(40)]
    assert [verdict.action is not None for verdict in verdicts] == [True] * 10 + [False] * 30
    for _ in range(100):  # as a key that is held down
        stop = room.handle(desk.session, json.dumps({"id": 2, "do": "safe_stop"}), now_s)
        assert (stop.action, stop.close) == (SafeStop(), False)
    assert verdicts[-1].close
    assert not verdicts[15].close
    assert room.handle(desk.session, text, now_s + 1.0).action is not None


@pytest.mark.parametrize(
    "text",
    [
        None,
        "",
        "{",
        "[]",
        "7",
        "[" * 4000,
        '{"id": 1}',
        '{"do": "login"}',
        '{"id": true, "do": "login"}',
        '{"id": 1e3, "do": "safe_stop"}',
        f'{{"id": {2**60}, "do": "x"}}',
        '{"id": 1, "do": ["login"]}',
    ],
)
def test_malformed_messages_count_as_offences(room, text):
    desk = Desk(room, "anna")
    verdicts = [desk.send(text) for _ in range(21)]
    assert all(verdict.action is None for verdict in verdicts)
    assert [verdict.close for verdict in verdicts] == [False] * 20 + [True]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4)
    ),
    max_leaves=10,
)
words = st.sampled_from(["login", "take_control", "release_control", *GOOD])
keys = st.sampled_from(
    [
        "id",
        "do",
        "token",
        "name",
        "from",
        "depth_mm",
        "temperature_c",
        "ramp",
        "controller",
        "wait_s",
        "mode",
        "ids",
        "force_kn",
        "speed_rpm",
        "action",
    ]
)
plausible = st.fixed_dictionaries(
    {"id": st.integers(-5, 5) | json_values, "do": words | json_values},
    optional={"mode": st.sampled_from(["auto", "hold"])},
)
messages = (
    st.text(max_size=200)
    | json_values.map(json.dumps)
    | st.tuples(plausible, st.dictionaries(keys, json_values, max_size=8)).map(
        lambda two: json.dumps(two[1] | two[0])
    )
)


@pytest.mark.requirement("S18")
@given(st.lists(messages, max_size=12))
def test_whatever_a_stranger_sends_nothing_acts_and_nothing_breaks(texts):
    room = ControlRoom(KNOWN)
    holder, stranger = Desk(room, "anna"), Desk(room, address=THERE)
    holder.take()
    for text in texts:
        verdict = stranger.send(text)
        assert verdict.action is None
        assert not verdict.asked
        assert verdict.answer.outcome == REFUSED
        json.dumps([verdict.id, verdict.answer.message], allow_nan=False)
    assert room.holder is holder.session


@pytest.mark.requirement("S18")
@given(st.lists(messages, max_size=12))
def test_whatever_a_person_without_control_sends_only_a_safe_stop_acts(texts):
    room = ControlRoom(KNOWN)
    holder, other = Desk(room, "anna"), Desk(room, "bert")
    holder.take()
    for text in texts:
        verdict = other.send(text)
        if room.holder is other.session:  # he has taken control, and has said from whom
            return
        assert verdict.action is None or verdict.action == SafeStop()
        verdict.asked.encode()


@pytest.mark.requirement("S18")
@given(st.lists(messages, max_size=12))
def test_whatever_the_holder_sends_an_action_has_good_values(texts):
    room = ControlRoom(KNOWN)
    holder = Desk(room, "anna")
    holder.take()
    for text in texts:
        action = holder.send(text).action
        if isinstance(action, SetReference):
            assert 1.5 <= action.depth_mm <= 4.0
            assert 750.0 <= action.temperature_c <= 950.0
        if action is not None:
            str(action).encode()
