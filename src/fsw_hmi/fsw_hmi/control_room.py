"""Who is at the page, who may command, and what becomes of a request before it reaches the graph."""

from __future__ import annotations

import hmac
import json
import secrets
from dataclasses import dataclass, field
from typing import Any

from fsw_hmi import security, tokens
from fsw_hmi.requests import ACTIONS, Action, SafeStop, read
from fsw_schema.models import InputError

DONE, REFUSED, TIMED_OUT = "done", "refused", "timed_out"
#: requests of a session in a second; safe stops do not count
_RATE_PER_S = 10.0
#: after so many malformed or hasty requests a page is shut out
_MOST_OFFENCES = 20
_LONGEST_NAME = 40
_MAX_ID = 2**53


class Bucket:
    """Lets so many through in a second, as many at once."""

    def __init__(self, per_s: float) -> None:
        self._per_s = self._left = per_s
        self._then_s = 0.0

    def take(self, now_s: float) -> bool:
        """Whether one more may pass."""
        self._left = min(self._per_s, self._left + max(0.0, now_s - self._then_s) * self._per_s)
        self._then_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass(slots=True)
class Session:
    """One open page."""

    id: str
    client: str = ""  #: that limits count
    local_stop: bool = False  #: whether it may stop without login
    name: str = ""  #: of the person, empty before the login
    offences: int = 0
    requests: Bucket = field(default_factory=lambda: Bucket(_RATE_PER_S))

    @property
    def who(self) -> str:
        """Name and session, for the record."""
        return f"{self.name or 'on this computer'} ({self.id})"

    @property
    def may_stop(self) -> bool:
        """Whether a safe stop is accepted."""
        return self.local_stop or bool(self.name)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is to be done about a message of a page.

    Attributes
    ----------
    id : int or None
        Of the request; without one nothing is answered.
    outcome, message : str
        The answer; the outcome is empty when ``action`` is to be carried out and answered first.
    action : Action or None
    asked : str
        What was asked for in words, when it has to be recorded; empty when not.
    control : bool
        Whether sessions or control have changed.
    close : bool
        Whether the page is to be shut out.
    """

    id: int | None = None
    outcome: str = ""
    message: str = ""
    action: Action | None = None
    asked: str = ""
    control: bool = False
    close: bool = False


class ControlRoom:
    """Sessions, login and control. Nothing here acts; it says what may be done.

    Parameters
    ----------
    token : str
        What a person must know to command.
    local_stop : bool, optional
        Whether pages on this computer may stop without login.
    """

    def __init__(self, token: str, local_stop: bool = True) -> None:
        if not token:
            raise ValueError("the token is empty")
        self._token = token.encode()
        self._sessions: dict[str, Session] = {}
        self._holder = ""
        self._local_stop = local_stop
        self._wrong = tokens.WrongTokens()

    # ---------------------------------------------------------------- sessions

    def join(self, address: str = "") -> Session:
        """A page was opened by a browser at this address."""
        number = secrets.token_hex(3)
        while number in self._sessions:
            number = secrets.token_hex(3)
        local_stop = self._local_stop and security.is_loopback(address)
        self._sessions[number] = session = Session(number, security.client_of(address), local_stop)
        return session

    def leave(self, session: Session) -> bool:
        """A page was closed; returns whether control has become free with it."""
        self._sessions.pop(session.id, None)
        if self._holder != session.id:
            return False
        self._holder = ""
        return True

    @property
    def holder(self) -> Session | None:
        """Who has control."""
        return self._sessions.get(self._holder)

    def control(self, session: Session) -> dict[str, Any]:
        """Content of the frame ``control`` for a session."""
        holder = self.holder
        return {
            "holder": holder and {"name": holder.name, "session": holder.id},
            "you": holder is session,
            "authenticated": bool(session.name),
            "may_stop": session.may_stop,
        }

    # ---------------------------------------------------------------- requests

    def handle(self, session: Session, text: str | None, now_s: float) -> Verdict:
        """Judge a message of a page; None stands for one that is no text. Never raises."""
        message = _parse(text)
        number = None if message is None else _id(message)
        if message is None or number is None:
            return self._offence(session, number, "the message is no request")
        do = message.get("do")
        if do == "safe_stop" and session.may_stop:  # before every limit
            return Verdict(number, action=SafeStop(), asked=str(SafeStop()))
        if not session.requests.take(now_s):
            return self._offence(session, number, "too many requests in a second")
        if not isinstance(do, str):
            return self._offence(session, number, "the message names no request")
        if do == "login":
            return self._login(session, number, message, now_s)
        if not session.name:
            return Verdict(number, REFUSED, "log in first")
        if do == "take_control":
            return self._take(session, number, message)
        if do == "release_control":
            return self._release(session, number)
        return self._command(session, number, do, message)

    def _offence(self, session: Session, number: int | None, why: str) -> Verdict:
        session.offences += 1
        return Verdict(number, REFUSED, why, close=session.offences > _MOST_OFFENCES)

    def _login(self, session: Session, number: int, message: dict[str, Any], now_s: float) -> Verdict:
        token, name = message.get("token"), message.get("name")
        given = token.encode("utf-8", "surrogatepass") if isinstance(token, str) else b""
        if not hmac.compare_digest(given, self._token):
            wait_s = self._wrong.add(session.client, given, now_s)
            too_many = f", one of too many from your address: wait {wait_s:.0f} s" if wait_s else ""
            return Verdict(number, REFUSED, f"wrong token{too_many}", close=bool(wait_s))
        name = name.strip() if isinstance(name, str) else ""
        if not (0 < len(name) <= _LONGEST_NAME and name.isprintable()):
            return Verdict(number, REFUSED, f"name: give one of at most {_LONGEST_NAME} characters")
        session.name = name
        return Verdict(number, DONE, f"logged in as {name}", control=True)

    def _take(self, session: Session, number: int, message: dict[str, Any]) -> Verdict:
        holder, asked = self.holder, "take control"
        if holder is session:
            return Verdict(number, DONE, "you have control already")
        if message.get("from") != (holder and holder.id):
            who = f"{holder.who} has control now" if holder else "control is free now"
            return Verdict(number, REFUSED, f"{who}: look again", asked=asked)
        self._holder = session.id
        taken = f"control taken from {holder.who}" if holder else "control taken"
        return Verdict(number, DONE, taken, asked=asked, control=True)

    def _release(self, session: Session, number: int) -> Verdict:
        if self.holder is not session:
            return Verdict(number, REFUSED, "you do not have control", asked="release control")
        self._holder = ""
        return Verdict(number, DONE, "control released", asked="release control", control=True)

    def _command(self, session: Session, number: int, do: str, message: dict[str, Any]) -> Verdict:
        try:
            action = read(do, message)
        except InputError as error:
            asked = do if do in ACTIONS else "unknown request"
            return Verdict(number, REFUSED, str(error)[:200], asked=asked)
        if self.holder is not session:
            return Verdict(number, REFUSED, "you do not have control: take it first", asked=str(action))
        return Verdict(number, action=action, asked=str(action))


def _parse(text: str | None) -> dict[str, Any] | None:
    try:
        message = json.loads(text or "")
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


def _id(message: dict[str, Any]) -> int | None:
    number = message.get("id")
    if isinstance(number, bool) or not isinstance(number, int) or not -_MAX_ID <= number <= _MAX_ID:
        return None
    return number
