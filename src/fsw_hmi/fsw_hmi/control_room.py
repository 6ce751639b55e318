"""Sessions, login and control of the page: which requests reach the graph."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from fsw_control.cause import RequestKind
from fsw_control.coded import Fact, RefusedError
from fsw_control.schema.models import InputError, json_content_of
from fsw_hmi.answers import DONE, REFUSED, Answer, Code, Loss, Note, invalid
from fsw_hmi.control import Control, Login, Session
from fsw_hmi.gate import client_of, is_loopback
from fsw_hmi.requests import ACTIONS, Action, SafeStop, read
from fsw_hmi.users import LONGEST, Users, checked_name

#: after so many malformed or hasty requests a page is shut out
_MOST_OFFENCES = 20
#: clients whose wrong logins are counted, at most (chosen)
_MOST_CLIENTS = 4096
_NONE_WRONG = 0, -inf
#: of the wrong logins of a client one is recorded in so long (chosen)
_RECORD_S = 60.0
#: not answered here
UNDECIDED = Answer("", "", "")
#: a page that was cut off may resume its session for so long (chosen: a stall, or a short loss of
#: radio, but not an absence)
_RESUME_S = 10.0
#: for the record: an operator lost control without releasing it
LOST = "lose control"
_PAGE_CLOSED = Fact.of(Loss.PAGE_CLOSED)
#: requests about control, of a session at a time, to another session
_CONTROL: dict[str, Callable[[Control, Session, float, Any], Answer]] = {
    "take_control": lambda control, session, now_s, _: control.take(session, now_s),
    "request_control": lambda control, session, now_s, _: control.request(session, now_s),
    "withdraw_request": lambda control, session, _, __: control.withdraw(session),
    "release_control": lambda control, session, _, __: control.give_back(session),
    "hand_over_control": lambda control, session, _, to: control.answer(session, to, True),
    "keep_control": lambda control, session, _, to: control.answer(session, to, False),
}


class _Request(BaseModel):
    """Fields common to all messages of a page; ``do`` determines the others."""

    model_config = ConfigDict(extra="allow", strict=True)

    id: Annotated[int, Field(ge=-(2**53), le=2**53)]
    do: str


@dataclass(frozen=True, slots=True)
class Order:
    """Decision about a message of a page, and what is to be recorded of it."""

    who: str = ""  #: name and session
    kind: RequestKind = RequestKind.UNKNOWN  #: what was asked for
    asked: str = ""  #: the same in words, when it has to be recorded; empty when not
    #: undecided when ``action`` is to be carried out, or while a password is to be checked
    answer: Answer = UNDECIDED
    action: Action | None = None
    id: int | None = None  #: of the request; without one nothing is answered
    close: bool = False  #: whether the page is to be shut out
    holder: str = ""  #: who has control then
    reply: Callable[[Answer], None] = lambda _: None  #: gets the outcome, in the server's loop


class ControlRoom:
    """Sessions, login and control. Decides what is permitted; does not act itself.

    ``users`` may command; the rest are parameters of the node, which ``parameters.py`` describes.
    """

    def __init__(
        self, users: Users, local_stop: bool = True, handover_timeout_s: float = 30.0
    ) -> None:
        self._users, self._local_stop = users, local_stop
        # wrong logins by client: how many, and when one was recorded last
        self._wrong: dict[str, tuple[int, float]] = {}
        self._checks = 0  # of passwords so far
        self._sessions: dict[str, Session] = {}  # by token, in the order of opening
        # a name that came with a password proves who it is
        self._control = Control(handover_timeout_s, users.kind == "password")
        self._records: list[Order] = []
        #: why nobody has control any longer, until somebody takes it
        self.ended: Fact | None = None

    @property
    def login(self) -> str:
        """Kind of credentials: ``token`` or ``password``."""
        return self._users.kind

    # ---------------------------------------------------------------- sessions

    def join(self, address: str = "", resume: str = "") -> Session:
        """A page was opened by a browser at this address, or connects again with its token."""
        client = client_of(address)
        session = self._sessions.get(resume)
        if session is not None and session.client == client:
            session.lost_s = None
            return session
        numbers = {other.id for other in self._sessions.values()}
        while (number := secrets.token_hex(3)) in numbers:
            pass
        local_stop = self._local_stop and is_loopback(address)
        token = secrets.token_urlsafe(16)
        self._sessions[token] = session = Session(number, client, local_stop, token)
        return session

    def admits(self, ticket: str) -> bool:
        """Whether a ticket is that of a session in which a user has logged in."""
        return any(
            other.name and secrets.compare_digest(other.ticket.encode(), ticket.encode())
            for other in self._sessions.values()
        )

    def lose(self, session: Session, now_s: float) -> None:
        """The connection of a page was lost; for a short time it may resume its session."""
        if session.name:
            session.lost_s = now_s
        else:
            self.leave(session)

    def leave(self, session: Session, why: Fact = _PAGE_CLOSED) -> None:
        """A page was closed."""
        self._sessions.pop(session.token, None)
        self._free(session, why)

    def tick(self, now_s: float) -> list[Order]:
        """Apply time-outs; returns what is to be recorded."""
        for session in [*self._sessions.values()]:
            if session.lost_s is not None and now_s - session.lost_s > _RESUME_S:
                self.leave(session, Fact.of(Loss.NOT_CONNECTED, limit_s=_RESUME_S))
        self._control.lapse(now_s)
        records, self._records = self._records, []
        return [replace(record, holder=self._holder) for record in records]

    def _free(self, session: Session, why: Fact) -> None:
        """Remove a session's control, or its request for control."""
        if self.holder is session:
            self.ended = Fact.of(Note.LOST, name=session.name, why=why)
            answer = Answer(DONE, why.code, why.words)
            self._records.append(Order(session.who, RequestKind.LOSE_CONTROL, LOST, answer))
        self._control.release(session)

    @property
    def holder(self) -> Session | None:
        """Session in control."""
        return self._control.holder

    @property
    def _holder(self) -> str:
        return self.holder.who if self.holder else ""

    def control(self, session: Session, now_s: float) -> dict[str, Any]:
        """Content of the frame ``control`` for a session."""
        note = session.note or (None if self.holder else self.ended)
        return self._control.shown(session, now_s) | {
            "name": session.name,
            "authenticated": bool(session.name),
            "ticket": session.ticket if session.name else "",
            "may_stop": session.may_stop,
            "note": note.words if note else "",
            "note_code": str(note.code) if note else "",
        }

    def news(self, session: Session, now_s: float) -> dict[str, Any] | None:
        """Content of the frame ``control``, if more than the remaining time has changed."""
        control = self.control(session, now_s)
        request = control["request"]
        known = control | {"request": request and request | {"left_s": bool(request["left_s"])}}
        if known == session.known:
            return None
        session.known = known
        return control

    # ---------------------------------------------------------------- requests

    def handle(self, session: Session, text: str | None, now_s: float) -> Order:
        """Judge a message of a page; None: not a text message. Never raises."""
        try:
            request = _Request.model_validate(json_content_of(text or "", "request"))
        except ValueError:
            return self._offence(session, Code.MALFORMED)
        return self._signed(self._judge(session, request, now_s), session, request.id)

    def _signed(self, order: Order, session: Session, request: int) -> Order:
        return replace(order, id=request, who=session.who, holder=self._holder)

    def _judge(self, session: Session, request: _Request, now_s: float) -> Order:
        do, message = request.do, request.model_extra or {}
        if do == "safe_stop" and session.may_stop:  # before every limit
            return _order(do, SafeStop())
        if not session.may_ask(now_s):
            return self._offence(session, Code.TOO_MANY)
        if do == "login":
            return self._login(session, request.id, message, now_s)
        if not session.name:
            return Order(answer=Code.LOG_IN.refused())
        if do in _CONTROL:
            return self._change_control(session, do, message, now_s)
        return self._command(session, do, message)

    def _offence(self, session: Session, why: Code) -> Order:
        session.offences += 1
        return Order(answer=why.refused(), close=session.offences > _MOST_OFFENCES)

    # ---------------------------------------------------------------- login

    def _login(
        self, session: Session, request: int, message: dict[str, Any], now_s: float
    ) -> Order:
        name, given = (
            value if isinstance(value := message.get(key), str) else ""
            for key in ("name", self.login)
        )
        try:
            name = checked_name(name.strip())
        except RefusedError as error:
            return Order(answer=Answer(REFUSED, error.fact.code, error.fact.words))
        if session.login is not None:
            return Order(answer=Code.BUSY.timed_out())
        if len(given) > LONGEST:
            return Order(answer=Code.TOO_LONG.refused(longest=LONGEST))
        session.login = Login(request, name, given, now_s)
        return Order()

    def next_login(self) -> Session | None:
        """The open page whose password is to be checked next; None if none waits.

        Alternates between the oldest waiting login, so that nobody waits for ever, and the one
        with the fewest failed attempts, by client, then page. Of equal ones the newest comes
        first, as it may be that of an operator among many that begin to guess; where the client
        has failed attempts, every second time the oldest: guessers may connect again.
        """
        waiting = sorted(
            (session.login.asked_s, place, session)
            for place, session in enumerate(self._sessions.values())
            if session.login and session.lost_s is None
        )
        pages = [session for _, _, session in waiting]
        if self._checks % 2 or not pages:
            return pages[0] if pages else None
        newest = self._checks % 4 == 2

        def turn(place: int) -> tuple[int, int, int]:
            count, _ = self._wrong.get(pages[place].client, _NONE_WRONG)
            return count, pages[place].wrong, -place if newest or not count else place

        return pages[min(range(len(pages)), key=turn)]

    def check(self, session: Session) -> str:
        """Check a login's password; returns the user's name, or nothing; slow, thread-safe."""
        login = session.login
        return self._users.check(login.name, login.password) if login else ""

    def on_checked(self, session: Session, user: str | None, now_s: float) -> Order:
        """Judge a login whose password is ``user``'s, nobody's if empty.

        None: it could not be checked.
        """
        login, session.login = session.login, None
        self._checks += 1
        assert login is not None
        return self._signed(self._judge_login(session, login, user, now_s), session, login.id)

    def _judge_login(
        self, session: Session, login: Login, user: str | None, now_s: float
    ) -> Order:
        if user is None:
            return Order(answer=Code.BUSY.timed_out())
        if not user:
            return self._wrong_login(session, login.name, now_s)
        if session.name != user:
            session.answers.clear()
            # what one person has, another does not get by a login
            self._free(session, Fact.of(Loss.OTHER_LOGIN, user=user))
        session.name, session.note = user, None
        answer = Code.LOGGED_IN.done(name=user)
        return Order(answer=answer, kind=RequestKind.LOGIN, asked="log in")

    def _wrong_login(self, session: Session, name: str, now_s: float) -> Order:
        wrong = Code[f"WRONG_{self.login.upper()}"].refused()
        count, recorded_s = self._wrong.pop(session.client, _NONE_WRONG)
        is_due = now_s - recorded_s >= _RECORD_S
        self._wrong[session.client] = count + 1, now_s if is_due else recorded_s
        session.wrong += 1
        if len(self._wrong) > _MOST_CLIENTS:  # the one whose last wrong login is the oldest
            del self._wrong[next(iter(self._wrong))]
        if is_due:
            # what was typed in as a name may be a password
            who = f"{self._users.name(name) or 'unknown name'} ({session.id})"
            address = session.client or "an unknown address"
            answer = Code.WRONG_FROM.refused(what=wrong.message, address=address)
            self._records.append(Order(who, RequestKind.LOGIN, "log in", answer))
        return Order(answer=wrong)

    # ---------------------------------------------------------------- control and commands

    def _change_control(
        self, session: Session, do: str, message: dict[str, Any], now_s: float
    ) -> Order:
        answer = _CONTROL[do](self._control, session, now_s, message.get("to"))
        if answer.outcome == DONE:
            self.ended = None
        return Order(kind=RequestKind.of(do), asked=do.replace("_", " "), answer=answer)

    def _command(self, session: Session, do: str, message: dict[str, Any]) -> Order:
        try:
            action = read(do, message)
        except InputError as error:
            asked = do if do in ACTIONS else "unknown request"
            return Order(answer=invalid(error), kind=RequestKind.of(do), asked=asked)
        order = _order(do, action)
        if self.holder is not session:
            return replace(order, action=None, answer=Code.TAKE_FIRST.refused())
        return order


def _order(do: str, action: Action) -> Order:
    return Order(action=action, kind=RequestKind.of(do), asked=str(action))
