"""Control of the weld by at most one session: request, handover and take-over."""

from __future__ import annotations

import secrets
from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from fsw_control.coded import Fact
from fsw_hmi.answers import Answer, Code, Note

#: how long control may be taken that was asked for in vain; then it has to be asked for again
#: (chosen)
_LAPSE_S = 60.0
#: requests of a session in any second; safe stops do not count
_MOST_REQUESTS = 10
#: answers that a page may have missed when its connection was lost
_ANSWERS = 50


class Login(NamedTuple):
    """A login whose password is yet to be checked."""

    id: int  #: of the request
    name: str
    password: str
    asked_s: float


@dataclass(slots=True, eq=False)
class Session:
    """One open page."""

    id: str
    client: str = ""  #: that limits count
    local_stop: bool = False  #: whether it may stop without login
    token: str = ""  #: by which its page resumes it after its connection was lost
    #: by which a browser gets further pages once a user has logged in
    ticket: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    lost_s: float | None = None  #: when the connection was lost; None while it stands
    name: str = ""  #: of the person; empty before the login
    note: Fact | None = None  #: what happened to its control, for its page
    known: dict[str, Any] = field(default_factory=dict)  #: what its page has been told of control
    login: Login | None = None
    wrong: int = 0  #: passwords so far
    offences: int = 0
    #: the last frames with answers: a page that resumes the session may have missed them
    answers: deque[str] = field(default_factory=lambda: deque(maxlen=_ANSWERS))
    asked_s: deque[float] = field(default_factory=lambda: deque(maxlen=_MOST_REQUESTS))

    def may_ask(self, now_s: float) -> bool:
        """Whether another request may pass, which then counts."""
        if len(self.asked_s) == _MOST_REQUESTS and now_s - self.asked_s[0] < 1.0:
            return False
        self.asked_s.append(now_s)
        return True

    @property
    def who(self) -> str:
        """Name and session, for the record."""
        return f"{self.name or 'on this computer'} ({self.id})"

    @property
    def may_stop(self) -> bool:
        """Whether a safe stop is accepted."""
        return self.local_stop or bool(self.name)


class Control:
    """Control as a state machine: free or held, and while held requested by at most one other.

    Control that was asked for may be taken without an answer after ``answer_s``; where names are
    ``proven``, a person may take it from another page of his or her own at any time.
    """

    def __init__(self, answer_s: float, proven: bool) -> None:
        self._answer_s, self._proven = answer_s, proven
        self._asked_s = 0.0
        self.holder: Session | None = None
        self.asker: Session | None = None

    def left_s(self, now_s: float) -> float:
        """Time left for the session in control to answer; 0: control may be taken."""
        return max(0.0, self._asked_s + self._answer_s - now_s) if self.asker else 0.0

    def shown(self, session: Session, now_s: float) -> dict[str, Any]:
        """Session in control and session that requests it, as another session sees them."""
        holder, asker, left_s = self.holder, self.asker, round(self.left_s(now_s), 1)
        return {
            "holder": holder and _of(holder),
            "you": holder is session,
            "request": asker and _of(asker) | {"left_s": left_s, "you": asker is session},
        }

    def take(self, session: Session, now_s: float) -> Answer:
        """Take control that is free, the same person's, or was asked for in vain."""
        holder = self.holder
        if holder is session:
            return Code.HAVE_CONTROL.done()
        if holder is None:
            self._give(session)
            return Code.TAKEN.done()
        if self._proven and holder.name == session.name:
            self._give(session, Fact.of(Note.TAKEN_BY_OWN, session=session.id))
            return Code.TAKEN_FROM_OWN.done(holder=holder.who)
        if self.asker is not session:
            return Code.ASK_FIRST.refused(holder=holder.who)
        if self.left_s(now_s) > 0.0:
            return Code.TIME_LEFT.refused(holder=holder.who, left_s=self.left_s(now_s))
        note = Fact.of(Note.TAKEN, name=session.name, wait_s=self._answer_s)
        self._give(session, note)
        return Code.TAKEN_FROM_SILENT.done(holder=holder.who, limit_s=self._answer_s)

    def request(self, session: Session, now_s: float) -> Answer:
        """Ask the session in control to hand it over."""
        if self.holder is None or self.holder is session:
            return (Code.FREE if self.holder is None else Code.HAVE_CONTROL).refused()
        if self.asker is not None and self.asker is not session:
            return Code.OTHER_ASKER.refused(asker=self.asker.who)
        if self.asker is None:
            self.asker, self._asked_s = session, now_s
        session.note = None
        return Code.ASKED.done(holder=self.holder.who)

    def withdraw(self, session: Session) -> Answer:
        """Withdraw the request for control."""
        if self.asker is not session:
            return Code.NOT_ASKER.refused()
        self.asker = None
        return Code.WITHDRAWN.done()

    def answer(self, session: Session, to: object, grant: bool) -> Answer:
        """Hand control over to the requesting session, or refuse."""
        if self.holder is not session:
            return Code.NOT_HOLDER.refused()
        asker = self.asker
        if asker is None or asker.id != to:
            if asker is None:
                return Code.NOBODY_ASKS.refused()
            return Code.ANOTHER_ASKS.refused(asker=asker.who)
        if grant:
            self._give(asker, Fact.of(Note.HANDED_OVER, name=asker.name))
            asker.note = Fact.of(Note.RECEIVED, name=session.name)
            return Code.HANDED_OVER.done(asker=asker.who)
        self.asker = None
        asker.note = Fact.of(Note.KEPT, name=session.name)
        return Code.KEPT.done(asker=asker.who)

    def give_back(self, session: Session) -> Answer:
        """Release a session's control."""
        if self.holder is not session:
            return Code.NOT_HOLDER.refused()
        self.release(session)
        return Code.RELEASED.done()

    def release(self, session: Session) -> None:
        """Release a session's control or its request for it."""
        if self.asker is session:
            self.asker = None
        if self.holder is session:
            if self.asker is not None:
                self.asker.note = Fact.of(Note.FREE)
            self.holder = self.asker = None

    def lapse(self, now_s: float) -> None:
        """Drop a request that may be taken but was not, after its time."""
        if now_s - self._asked_s > self._answer_s + _LAPSE_S:
            self.asker = None

    def _give(self, session: Session, note: Fact | None = None) -> None:
        if self.holder is not None:
            self.holder.note = note
        if self.asker is not None and self.asker is not session:
            self.asker.note = Fact.of(Note.OTHER, name=session.name)
        self.holder, self.asker, session.note = session, None, None


def _of(session: Session) -> dict[str, Any]:
    return {"name": session.name, "session": session.id}
