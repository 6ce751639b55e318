"""Named users at the page: logins, and control that is asked for, handed over and taken."""

import json

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    initialize,
    invariant,
    multiple,
    rule,
)

from fsw_control.cause import RequestKind
from fsw_hmi.answers import DONE, REFUSED, TIMED_OUT, Code
from fsw_hmi.control_room import ControlRoom
from fsw_hmi.requests import SafeStop
from fsw_hmi.users import Users, new_user

PASSWORD = "correct horse battery"
THERE = "192.0.2.4"
USERS = ("otto", "olga", "egon")
CONTENT = {
    "set_reference": {"depth_mm": 2.7, "temperature_c": 820},
    "switch": {"controller": "nmpc"},
    "mode": {"mode": "hold"},
    "weld": {"action": "hold"},
    "acknowledge": {"ids": ["x"]},
    "acknowledge_stop": {},
}


def named_users():
    return Users(new_user(name, PASSWORD) for name in USERS)


class Place:
    """A page whose clock is that of all."""

    def __init__(self, hall, name="", address=THERE):
        self.hall, self.session = hall, hall.room.join(address)
        if name:
            assert self.log_in(name).answer.outcome == DONE

    def ask(self, do, **content):
        self.hall.now_s += 1.0
        return self.send(do, **content)

    def send(self, do, **content):
        return self.hall.room.handle(
            self.session, json.dumps({"id": 7, "do": do, **content}), self.hall.now_s
        )

    def log_in(self, name, password=PASSWORD):
        order = self.ask("login", name=name, password=password)
        return order if self.session.login is None else self.hall.check(self.session)

    def take(self):
        return self.ask("take_control")

    @property
    def control(self):
        return self.hall.room.control(self.session, self.hall.now_s)


class Hall:
    def __init__(self, **rules):
        self.now_s = 1000.0
        self.room = ControlRoom(named_users(), **rules)

    def check(self, session):
        return self.room.on_checked(session, self.room.check(session), self.now_s)

    def news(self, *places):
        return [self.room.news(place.session, self.now_s) is not None for place in places]


@pytest.fixture
def hall():
    return Hall()


def test_login_is_told_as_the_file_spells_the_name(hall):
    place = Place(hall)
    assert place.log_in("EGON").answer == Code.LOGGED_IN.done(name="egon")
    assert place.session.who == f"egon ({place.session.id})"
    place.ask("login", name="egon", token=PASSWORD)
    assert place.session.login.password == ""  # a token is none


@pytest.mark.requirement("S30")
def test_page_with_wrong_passwords_keeps_nobody_out_not_even_its_own_address(hall):
    stranger = Place(hall)
    for number in range(100):
        verdict = stranger.log_in("egon", f"guess {number}")
        assert (verdict.answer.code, verdict.close) == ("wrong_password", False)
    assert Place(hall).log_in("egon").answer.outcome == DONE
    assert stranger.log_in("egon").answer.outcome == DONE


@pytest.mark.requirement("S30")
def test_one_password_of_a_page_waits_and_a_busy_check_is_no_refusal(hall):
    place = Place(hall)
    assert place.ask("login", name="otto", password=PASSWORD).answer.outcome == ""
    assert place.ask("login", name="otto", password=PASSWORD).answer.code == "busy"
    assert hall.room.on_checked(place.session, None, hall.now_s).answer.outcome == TIMED_OUT
    assert place.ask("login", name="otto", password="x" * 129).answer.code == "too_long"
    assert place.log_in("otto").answer.outcome == DONE


def guess(hall, places, number):
    for place in places:
        place.ask("login", name="otto", password=f"guess {number}")


def checked_before(hall, place):
    """How many others are checked before a page."""
    for count in range(1000):
        session = hall.room.next_login()
        answer = hall.check(session).answer
        if session is place.session:
            return count
        assert answer.code == "wrong_password"
    raise AssertionError


@pytest.mark.requirement("S30")
def test_login_comes_before_those_of_guessers_elsewhere_even_after_a_mistake(hall):
    guessers = [Place(hall, address=f"192.0.2.{number}") for number in range(64)]
    guess(hall, guessers, 0)
    otto = Place(hall, address="192.0.2.99")
    for number in range(1, 4):  # already before the first guess, and after mistakes
        otto.ask("login", name="otto", password="a mistake")
        assert checked_before(hall, otto) <= 1
        for place in 2 * guessers:
            guess(hall, [place], number)
            hall.check(place.session)
        guess(hall, guessers, number)


@pytest.mark.requirement("S30")
def test_login_comes_before_those_of_pages_at_its_address_that_have_guessed(hall):
    guessers = [Place(hall) for _ in range(64)]
    for number in range(2):
        guess(hall, guessers, number)
        for place in guessers if number == 0 else ():
            hall.check(place.session)
    otto = Place(hall)
    otto.ask("login", name="otto", password=PASSWORD)
    guess(hall, [Place(hall)], 2)  # one that connects again does not come before
    assert checked_before(hall, otto) <= 1


@pytest.mark.requirement("S30")
def test_login_comes_soon_when_many_at_its_address_begin_to_guess(hall):
    guess(hall, guessers := [Place(hall) for _ in range(64)], 0)
    hall.check(guessers[0].session)
    otto = Place(hall)
    otto.ask("login", name="otto", password=PASSWORD)
    assert checked_before(hall, otto) <= 3


@pytest.mark.requirement("S30")
def test_login_waits_at_most_twice_as_many_checks_as_logins_waited_before_it(hall):
    """Even when every check is followed by a guess from an address without a wrong one."""
    places = [Place(hall, address=f"192.0.2.{number}") for number in range(5)]
    guess(hall, places, 0)
    otto = Place(hall, address="192.0.2.99")
    for _ in range(2):  # the first is a mistake
        before = sum(place.session.login is not None for place in places)
        otto.ask("login", name="otto", password="a mistake")
        for number in range(2 * before + 2):
            places.append(Place(hall, address=f"198.51.{len(places)}.1"))
            guess(hall, places[-1:], number)
            hall.check(session := hall.room.next_login())
            if session is otto.session:
                break
        assert session is otto.session


def test_logins_of_pages_that_leave_are_forgotten(hall):
    places = [Place(hall) for _ in range(3)]
    guess(hall, places, 0)
    for place in places[:2]:
        hall.room.leave(place.session)
    assert hall.room.next_login() is places[2].session
    hall.room.leave(places[2].session)
    assert hall.room.next_login() is None


def test_another_person_does_not_get_control_by_logging_in_at_the_same_page(hall):
    place = Place(hall, "otto")
    place.take()
    place.log_in("otto")
    assert place.control["you"]
    place.log_in("olga")
    assert hall.room.holder is None


def test_control_is_asked_for_and_handed_over(hall):
    otto, olga, egon = Place(hall, "otto"), Place(hall, "olga"), Place(hall, "egon")
    assert olga.ask("request_control").answer.code == "free"
    otto.take()
    assert otto.ask("request_control").answer.code == "have_control"
    assert olga.ask("request_control").answer.outcome == DONE
    asked = {"name": "olga", "session": olga.session.id, "left_s": 30.0}
    assert otto.control["request"] == {**asked, "you": False}
    assert olga.control["request"] == {**asked, "you": True}
    assert egon.ask("request_control").answer.code == "other_asker"
    assert olga.ask("hand_over_control", to=olga.session.id).answer.code == "not_holder"
    assert otto.ask("hand_over_control", to=egon.session.id).answer.code == "another_asks"
    verdict = otto.ask("hand_over_control", to=olga.session.id)
    assert (verdict.asked, verdict.answer.code) == ("hand over control", "handed_over")
    assert hall.room.holder is olga.session
    assert otto.ask("mode", mode="hold").action is None
    assert (otto.control["note_code"], olga.control["note_code"]) == ("handed_over", "received")
    assert "olga" in otto.control["note"] and "otto" in olga.control["note"]


def test_request_is_refused_withdrawn_or_lapses(hall):
    otto, olga = Place(hall, "otto"), Place(hall, "olga")
    otto.take()
    olga.ask("request_control")
    assert otto.ask("keep_control", to=olga.session.id).answer.outcome == DONE
    assert (olga.control["note_code"], olga.control["request"]) == ("kept", None)
    hall.now_s += 1000.0
    assert olga.take().answer.outcome == REFUSED
    assert olga.ask("withdraw_request").answer.code == "not_asker"
    olga.ask("request_control")
    assert olga.ask("withdraw_request").answer.outcome == DONE
    assert otto.ask("keep_control", to=olga.session.id).answer.code == "nobody_asks"
    olga.ask("request_control")
    hall.news(otto, olga)
    hall.now_s += 20.0
    assert hall.news(otto, olga) == [False, False]  # the time left is the page's own to count
    hall.now_s += 11.0
    assert hall.news(otto, olga) == [True, True]  # that it may be taken
    assert hall.news(otto, olga) == [False, False]
    hall.now_s += 60.0
    assert hall.room.tick(hall.now_s) == []
    assert hall.news(otto, olga) == [True, True]
    assert olga.take().answer.code == "ask_first"
    assert hall.room.holder is otto.session


def test_asking_again_does_not_wind_the_clock_up(hall):
    otto, olga = Place(hall, "otto"), Place(hall, "olga")
    otto.take()
    olga.ask("request_control")
    hall.now_s += 20.0
    olga.ask("request_control")
    assert olga.take().answer == Code.TIME_LEFT.refused(holder=otto.session.who, left_s=8.0)
    hall.now_s += 7.0
    verdict = olga.take()
    assert (verdict.answer.outcome, verdict.asked) == (DONE, "take control")
    assert verdict.answer.code == "taken_from_silent"


def test_who_asks_is_told_when_control_becomes_free(hall):
    otto, olga = Place(hall, "otto"), Place(hall, "olga")
    otto.take()
    olga.ask("request_control")
    hall.room.leave(otto.session)
    assert (olga.control["note_code"], olga.control["request"], hall.room.holder) == (
        "free",
        None,
        None,
    )


def test_same_person_takes_control_along_to_another_page(hall):
    first, second, stranger = Place(hall, "otto"), Place(hall, "otto"), Place(hall, "olga")
    first.take()
    assert stranger.take().answer.outcome == REFUSED
    assert second.take().answer.code == "taken_from_own"
    token = ControlRoom(Users(token="a token of some length"))
    pages = [token.join(THERE) for _ in range(2)]
    for page in pages:  # with a token a name proves nothing
        token.handle(page, json.dumps({"id": 1, "do": "login", "name": "otto", "token": "x"}), 0.0)
        token.on_checked(page, "otto", 0.0)
    token.handle(pages[0], json.dumps({"id": 2, "do": "take_control"}), 0.0)
    again = token.handle(pages[1], json.dumps({"id": 2, "do": "take_control"}), 0.0)
    assert again.answer.outcome == REFUSED


def lost(hall):
    """Who lost control by what, as recorded since the last look."""
    orders = hall.room.tick(hall.now_s)
    assert {(order.kind, order.answer.outcome) for order in orders} <= {
        (RequestKind.LOSE_CONTROL, DONE)
    }
    return [(order.who, order.answer.code) for order in orders]


def test_who_loses_control_is_recorded_and_everybody_is_told_why(hall):
    otto, olga = Place(hall, "otto"), Place(hall, "olga")
    otto.take()
    hall.room.leave(otto.session)
    assert lost(hall) == [(otto.session.who, "page_closed")]
    assert (olga.control["note_code"], "otto" in olga.control["note"]) == ("lost", True)
    olga.take()
    assert olga.control["note"] == ""
    olga.log_in("egon")
    assert lost(hall) == [(f"olga ({olga.session.id})", "other_login")]
    olga.take()
    olga.ask("release_control")
    assert (olga.control["note"], hall.room.tick(hall.now_s)) == ("", [])


def test_logins_are_recorded_without_what_a_stranger_has_typed_in(hall):
    place = Place(hall)
    right = place.log_in("OTTO")
    answer = Code.LOGGED_IN.done(name="otto")
    assert (right.asked, right.answer) == ("log in", answer)
    stranger = Place(hall)
    for name, password in (("Otto", "x"), ("Otto", "x"), ("my-secret-password", "y")):
        stranger.log_in(name, password)
    (refused,) = hall.room.tick(hall.now_s)
    assert (refused.who.split(" (")[0], refused.asked, refused.answer.outcome) == (
        "otto",
        "log in",
        REFUSED,
    )
    assert refused.answer.code == "wrong_from" and THERE in refused.answer.message
    for number in range(9):
        stranger.log_in("egon", f"guess {number}")
    assert hall.room.tick(hall.now_s) == [], "no flood of them in the bag"
    Place(hall, address="192.0.2.9").log_in("my-secret-password", "y")
    (refused,) = hall.room.tick(hall.now_s)
    assert refused.who.startswith("unknown name (")
    hall.now_s += 60.0
    stranger.log_in("egon", "another guess")
    assert len(hall.room.tick(hall.now_s)) == 1
    token = ControlRoom(Users(token="a token of some length"))
    page = token.join(THERE)
    request = {"id": 1, "do": "login", "name": "secret", "token": "also-secret"}
    token.handle(page, json.dumps(request), 0.0)
    token.on_checked(page, "", 0.0)
    (recorded,) = token.tick(0.0)
    assert "secret" not in str(recorded)


class Passing(RuleBasedStateMachine):
    """Whatever anybody does, at most one has control, has a right to it, and everybody who has logged in can stop."""

    places = Bundle("places")

    @initialize(target=places)
    def begin(self):
        self.hall = Hall()
        self.all = [Place(self.hall, name) for name in USERS]
        self.logged_in = set(self.all)
        self.all[0].take()
        return multiple(*self.all)

    @rule(target=places)
    def open_page(self):
        self.all.append(place := Place(self.hall))
        return place

    @rule(place=places, name=st.sampled_from(sorted(USERS)), right=st.booleans())
    def log_in(self, place, name, right):
        if place.log_in(name, PASSWORD if right else "wrong").answer.outcome == DONE:
            self.logged_in.add(place)

    @rule(
        place=places,
        do=st.sampled_from(["request_control", "withdraw_request", "release_control"]),
    )
    def ask(self, place, do):
        place.ask(do)

    @rule(place=places)
    def takes(self, place):
        before, asked = self.hall.room.holder, place.control["request"]
        took = place.take().answer.outcome == DONE
        if took and before not in (None, place.session) and before.name != place.session.name:
            assert asked["you"] and asked["left_s"] <= 1.0  # a second passes with the request

    @rule(place=places, passed_s=st.floats(0.0, 100.0))
    def asks_and_takes(self, place, passed_s):
        place.ask("request_control")
        self.hall.now_s += passed_s
        self.takes(place)

    @rule(place=places, other=places, do=st.sampled_from(["hand_over_control", "keep_control"]))
    def answers(self, place, other, do):
        place.ask(do, to=other.session.id)

    @rule(place=places, do=st.sampled_from(sorted(CONTENT)))
    def commands(self, place, do):
        allowed = place.control["you"]
        assert (place.ask(do, **CONTENT[do]).action is not None) == allowed

    @rule(place=places)
    def leaves(self, place):
        self.hall.room.leave(place.session)
        self.logged_in.discard(place)
        self.all = [other for other in self.all if other is not place]

    @rule(passed_s=st.floats(0.0, 700.0))
    def time_passes(self, passed_s):
        self.hall.now_s += passed_s
        self.hall.room.tick(self.hall.now_s)

    @invariant()
    def at_most_one_has_control_and_has_a_right_to_it(self):
        controls = [place.control for place in self.all]
        assert sum(control["you"] for control in controls) <= 1
        assert all(control["authenticated"] for control in controls if control["you"])
        assert not any(
            control["you"] and control["request"] and control["request"]["you"]
            for control in controls
        )
        assert all(control["holder"] for control in controls if control["request"])

    @invariant()
    def whoever_has_logged_in_can_stop_at_once(self):
        for place in self.logged_in:
            assert all(place.send("safe_stop").action == SafeStop() for _ in range(3))


TestPassing = Passing.TestCase
TestPassing.settings = settings(stateful_step_count=30, deadline=None)
