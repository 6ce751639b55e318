"""Who has control of the weld: at most one session; how it is asked for, handed over and taken. Nothing here acts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

DONE, REFUSED, TIMED_OUT = "done", "refused", "timed_out"
#: how long control may be taken that was asked for in vain; then it has to be asked for again
#: (chosen)
_LAPSE_S = 60.0
#: requests of a session in a second; safe stops do not count
_RATE_PER_S = 10.0

Answer = tuple[str, str]  #: outcome and words


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


@dataclass(slots=True, eq=False)
class Session:
    """One open page."""

    id: str
    client: str = ""  #: that limits count
    local_stop: bool = False  #: whether it may stop without login
    token: str = ""  #: by which its page resumes it after its connection was lost
    lost_s: float | None = None  #: when the connection was lost; None while it stands
    name: str = ""  #: of the person; empty before the login
    role: str = ""
    idle: bool = False  #: nobody has touched the page for so long that only a safe stop is left
    checking: bool = False  #: its password is being checked
    active_s: float = 0.0  #: when somebody who has logged in has last asked for something
    touched_s: float | None = None  #: when anybody has; None: never
    note: str = ""  #: what happened to its control, for its page
    known: dict[str, Any] = field(default_factory=dict)  #: what its page has been told of control
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

    @property
    def authenticated(self) -> bool:
        """Whether requests other than a safe stop are listened to."""
        return bool(self.name) and not self.idle


class Control:
    """Control as a state machine: free or held, and while it is held asked for by at most one other.

    Control that was asked for may be taken without an answer after ``answer_s``.
    """

    def __init__(self, answer_s: float) -> None:
        self._answer_s = answer_s
        self._asked_s = 0.0
        self.holder: Session | None = None
        self.asker: Session | None = None

    def left_s(self, now_s: float) -> float:
        """How long the holder still has to answer; 0: control may be taken."""
        return max(0.0, self._asked_s + self._answer_s - now_s) if self.asker else 0.0

    def shown(self, session: Session, now_s: float) -> dict[str, Any]:
        """Who has control and who asks for it, as a session sees it."""
        holder, asker, left_s = self.holder, self.asker, round(self.left_s(now_s), 1)
        return {
            "holder": holder and {"name": holder.name, "session": holder.id},
            "you": holder is session,
            "request": asker
            and {
                "name": asker.name,
                "session": asker.id,
                "left_s": left_s,
                "you": asker is session,
            },
        }

    def take(
        self, session: Session, seen: object, now_s: float, same_person: bool = False
    ) -> Answer:
        """Take control that is free, or that was asked for in vain; ``seen`` is the holder that the person has seen."""
        holder = self.holder
        if holder is session:
            return DONE, "you have control already"
        if seen != (holder and holder.id):
            return (
                REFUSED,
                f"{holder.who} has control now: look again"
                if holder
                else "control is free now: look again",
            )
        if holder is None:
            self._give(session)
            return DONE, "control taken"
        if same_person:
            self._give(session, f"you have taken control on another page ({session.id})")
            return DONE, f"control taken from {holder.who}, the same person"
        if self.asker is not session:
            return REFUSED, f"{holder.who} has control: ask for it"
        if self.left_s(now_s) > 0.0:
            return REFUSED, f"{holder.who} has {self.left_s(now_s):.0f} s left to answer"
        self._give(
            session, f"{session.name} has taken control: nobody answered for {self._answer_s:g} s"
        )
        return (
            DONE,
            f"control taken from {holder.who}, who did not answer for {self._answer_s:g} s",
        )

    def request(self, session: Session, now_s: float) -> Answer:
        """Ask who has control to hand it over."""
        if self.holder is None or self.holder is session:
            return (
                REFUSED,
                "control is free: take it" if self.holder is None else "you have control already",
            )
        if self.asker is not None and self.asker is not session:
            return REFUSED, f"{self.asker.who} asks for control already"
        if self.asker is None:
            self.asker, self._asked_s = session, now_s
        session.note = ""
        return DONE, f"{self.holder.who} has been asked for control"

    def withdraw(self, session: Session) -> Answer:
        """No longer ask."""
        if self.asker is not session:
            return REFUSED, "you do not ask for control"
        self.asker = None
        return DONE, "control is no longer asked for"

    def answer(self, session: Session, to: object, grant: bool) -> Answer:
        """Hand control over to the session that asks for it, or refuse."""
        if self.holder is not session:
            return REFUSED, "you do not have control"
        asker = self.asker
        if asker is None or asker.id != to:
            return (
                REFUSED,
                "nobody asks for control now"
                if asker is None
                else f"{asker.who} asks now: look again",
            )
        if grant:
            self._give(asker, f"you have handed control over to {asker.name}")
            asker.note = f"{session.name} has handed control over to you"
            return DONE, f"control handed over to {asker.who}"
        self.asker = None
        asker.note = f"{session.name} keeps control"
        return DONE, f"control not handed over to {asker.who}"

    def give_back(self, session: Session) -> Answer:
        """Give back the control that a session has."""
        if self.holder is not session:
            return REFUSED, "you do not have control"
        self.release(session)
        return DONE, "control released"

    def release(self, session: Session) -> None:
        """Give back what a session has, control or the request for it."""
        if self.asker is session:
            self.asker = None
        if self.holder is session:
            if self.asker is not None:
                self.asker.note = "control is free"
            self.holder = self.asker = None

    def lapse(self, now_s: float) -> None:
        """Forget a request that nobody made use of."""
        if now_s - self._asked_s > self._answer_s + _LAPSE_S:
            self.asker = None

    def _give(self, session: Session, note: str = "") -> None:
        if self.holder is not None:
            self.holder.note = note
        if self.asker is not None and self.asker is not session:
            self.asker.note = f"{session.name} has control now"
        self.holder, self.asker, session.note = session, None, ""
