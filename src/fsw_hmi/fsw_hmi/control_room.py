"""Sessions, login and control of the page: which requests reach the graph."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from fsw_control.coded import Fact, RefusedError
from fsw_control.journal import RequestKind
from fsw_control.schema.models import InputError, json_content_of
from fsw_hmi import security
from fsw_hmi.answers import DONE, REFUSED, Answer, Code, Loss, Note, invalid
from fsw_hmi.control import Control, Session
from fsw_hmi.requests import ACTIONS, Action, SafeStop, read
from fsw_hmi.users import LONGEST, Users, checked_name

#: after so many malformed or hasty requests a page is shut out
_MOST_OFFENCES = 20
#: passwords that are checked or wait for it, at most: of one client, so few that a guesser delays
#: nobody elsewhere by more than two checks, and of all; of a session one (chosen)
_OF_CLIENT, _OF_ALL = 2, 64
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
_CONTROL = (
    *("take_control", "release_control", "request_control", "withdraw_request"),
    *("hand_over_control", "keep_control"),
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Decision about a message of a page."""

    id: int | None = None  #: of the request; without one nothing is answered
    #: empty when ``action`` is to be carried out or ``credentials`` to be checked first
    answer: Answer = UNDECIDED
    action: Action | None = None
    kind: RequestKind = RequestKind.UNKNOWN  #: what was asked for
    asked: str = ""  #: the same in words, when it has to be recorded; empty when not
    close: bool = False  #: whether the page is to be shut out
    #: name and password to be checked; then :meth:`ControlRoom.on_checked` judges
    credentials: tuple[str, str] | None = None


class _Request(BaseModel):
    """Fields common to all messages of a page; ``do`` determines the others."""

    model_config = ConfigDict(extra="allow", strict=True)

    id: Annotated[int, Field(ge=-(2**53), le=2**53)]
    do: str


@dataclass(frozen=True, slots=True)
class Order:
    """An action for the graph; without one, the record of a request that was refused."""

    who: str  #: name and session
    kind: RequestKind  #: what was asked for
    asked: str  #: the same in words
    answer: Answer = UNDECIDED  #: for the record
    action: Action | None = None
    reply: Callable[[Answer], None] = lambda _: None  #: gets the outcome, in the server's loop
    holder: str = ""  #: who has control when it is delivered


class ControlRoom:
    """Sessions, login and control. Decides what is permitted; does not act itself.

    ``users`` may command; the rest are parameters of the node, which ``parameters.py`` describes.
    """

    def __init__(
        self, users: Users, local_stop: bool = True, handover_timeout_s: float = 30.0
    ) -> None:
        self._users, self._local_stop = users, local_stop
        self._waiting: dict[str, str] = {}  # client of each session that waits for a check
        self._sessions: dict[str, Session] = {}
        self._control = Control(handover_timeout_s)
        self._recorded_s: dict[str, float] = {}  # when a wrong login of each client was
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
        client = security.client_of(address)
        for session in self._sessions.values():
            same = hmac.compare_digest(_bytes(session.token), _bytes(resume))
            if same and session.client == client:
                session.lost_s = None
                return session
        number = secrets.token_hex(3)
        while number in self._sessions:
            number = secrets.token_hex(3)
        local_stop = self._local_stop and security.is_loopback(address)
        token = secrets.token_urlsafe(16)
        self._sessions[number] = session = Session(number, client, local_stop, token)
        return session

    def lose(self, session: Session, now_s: float) -> None:
        """The connection of a page was lost; for a short time it may resume its session."""
        if session.name:
            session.lost_s = now_s
        else:
            self.leave(session)

    def leave(self, session: Session, why: Fact = _PAGE_CLOSED) -> None:
        """A page was closed."""
        self._sessions.pop(session.id, None)
        self._free(session, why)

    def tick(self, now_s: float) -> list[Order]:
        """Apply time-outs; returns what is to be recorded."""
        for session in [*self._sessions.values()]:
            if session.lost_s is not None and now_s - session.lost_s > _RESUME_S:
                self.leave(session, Fact.of(Loss.NOT_CONNECTED, limit_s=_RESUME_S))
        self._control.lapse(now_s)
        records, self._records = self._records, []
        return records

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

    def control(self, session: Session, now_s: float) -> dict[str, Any]:
        """Content of the frame ``control`` for a session."""
        note = session.note or (None if self.holder else self.ended)
        return self._control.shown(session, now_s) | {
            "name": session.name,
            "authenticated": bool(session.name),
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

    def handle(self, session: Session, text: str | None, now_s: float) -> Verdict:
        """Judge a message of a page; None: not a text message. Never raises."""
        try:
            request = _Request.model_validate(json_content_of(text or "", "request"))
        except ValueError:
            return self._offence(session, Code.MALFORMED)
        return replace(self._judge(session, request, now_s), id=request.id)

    def _judge(self, session: Session, request: _Request, now_s: float) -> Verdict:
        do, message = request.do, request.model_extra or {}
        if do == "safe_stop" and session.may_stop:  # before every limit
            return _order(do, SafeStop())
        if not session.may_ask(now_s):
            return self._offence(session, Code.TOO_MANY)
        if do == "login":
            return self._login(session, message)
        if not session.name:
            return Verdict(answer=Code.LOG_IN.refused())
        if do in _CONTROL:
            return self._change_control(session, do, message, now_s)
        return self._command(session, do, message)

    def _offence(self, session: Session, why: Code) -> Verdict:
        session.offences += 1
        return Verdict(answer=why.refused(), close=session.offences > _MOST_OFFENCES)

    # ---------------------------------------------------------------- login

    def _login(self, session: Session, message: dict[str, Any]) -> Verdict:
        name, given = (
            value if isinstance(value := message.get(key), str) else ""
            for key in ("name", self.login)
        )
        try:
            name = checked_name(name.strip())
        except RefusedError as error:
            return Verdict(answer=Answer(REFUSED, error.fact.code, error.fact.words))
        clients, client = list(self._waiting.values()), session.client
        full = len(clients) >= _OF_ALL or clients.count(client) >= _OF_CLIENT
        if session.id in self._waiting or full:
            return Verdict(answer=Code.BUSY.timed_out())
        if len(given) > LONGEST:
            return Verdict(answer=Code.TOO_LONG.refused(longest=LONGEST))
        self._waiting[session.id] = client
        return Verdict(credentials=(name, given))

    def check(self, name: str, password: str) -> str:
        """Check name and password; returns the user's name, or nothing; slow, thread-safe."""
        return self._users.check(name, password)

    def on_checked(
        self, session: Session, credentials: tuple[str, str], user: str, now_s: float
    ) -> Verdict:
        """Judge a login after its password has been checked; ``user`` owns the password."""
        self._waiting.pop(session.id, None)
        if not user:
            return self._wrong_login(session, credentials[0], now_s)
        if session.name != user:
            # what one person has, another does not get by a login
            self._free(session, Fact.of(Loss.OTHER_LOGIN, user=user))
        session.name, session.note = user, None
        answer = Code.LOGGED_IN.done(name=user)
        return Verdict(answer=answer, kind=RequestKind.LOGIN, asked="log in")

    def on_busy(self, session: Session) -> Verdict:
        """Judge a login whose password could not be checked."""
        self._waiting.pop(session.id, None)
        return Verdict(answer=Code.BUSY.timed_out())

    def _wrong_login(self, session: Session, name: str, now_s: float) -> Verdict:
        wrong = Code[f"WRONG_{self.login.upper()}"].refused()
        recent = {key: s for key, s in self._recorded_s.items() if now_s - s < _RECORD_S}
        self._recorded_s = {session.client: now_s} | recent
        if session.client not in recent:
            # what was typed in as a name may be a password
            who = f"{self._users.name(name) or 'unknown name'} ({session.id})"
            address = session.client or "an unknown address"
            answer = Code.WRONG_FROM.refused(what=wrong.message, address=address)
            self._records.append(Order(who, RequestKind.LOGIN, "log in", answer))
        return Verdict(answer=wrong)

    # ---------------------------------------------------------------- control and commands

    def _change_control(
        self, session: Session, do: str, message: dict[str, Any], now_s: float
    ) -> Verdict:
        if do == "take_control" and self.holder is session:
            return Verdict(answer=Code.HAVE_CONTROL.done())
        answer = self._ask_control(session, do, message, now_s)
        if answer.outcome == DONE:
            self.ended = None
        return Verdict(answer=answer, kind=RequestKind.of(do), asked=do.replace("_", " "))

    def _ask_control(
        self, session: Session, do: str, message: dict[str, Any], now_s: float
    ) -> Answer:
        control, holder = self._control, self.holder
        if do == "take_control":
            # a name that came with a password proves who it is
            proven = self.login == "password"
            same = proven and holder is not None and holder.name == session.name
            return control.take(session, now_s, same)
        if do == "request_control":
            return control.request(session, now_s)
        if do == "withdraw_request":
            return control.withdraw(session)
        if do == "release_control":
            return control.give_back(session)
        return control.answer(session, message.get("to"), do == "hand_over_control")

    def _command(self, session: Session, do: str, message: dict[str, Any]) -> Verdict:
        try:
            action = read(do, message)
        except InputError as error:
            asked = do if do in ACTIONS else "unknown request"
            return Verdict(answer=invalid(error), kind=RequestKind.of(do), asked=asked)
        order = _order(do, action)
        if self.holder is not session:
            return replace(order, action=None, answer=Code.TAKE_FIRST.refused())
        return order


def _order(do: str, action: Action) -> Verdict:
    return Verdict(action=action, kind=RequestKind.of(do), asked=str(action))


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")
