"""Notes of a page about control: why it ended, and who has it now, as codes with one table of words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from fsw_control.coded import Fact, Worded


class Loss(Worded):
    """Why control ended without being released."""

    PAGE_CLOSED = "page_closed", "the page was closed"
    SERVER_ENDED = "server_ended", "the page's server ended"
    SERVER_RESTARTED = "server_restarted", "the page's server was started again"
    NOT_CONNECTED = "not_connected", "its page was not connected for {limit_s:g} s"
    UNTOUCHED = "untouched", "nobody has touched the page for {limit_min:g} min"
    USER_CHANGED = "user_changed", "the user {user} has been changed or removed"
    OTHER_LOGIN = "other_login", "{user} has logged in there"


class Note(Worded):
    """What happened to the control of a page, or of all."""

    LOST = "lost", "{name} has lost control: {why.words}"
    SHUT = "shut", "{why.words}: log in again to command"
    TAKEN_BY_OWN = "taken_by_own", "you have taken control on another page ({session})"
    TAKEN = "taken", "{name} has taken control: nobody answered for {wait_s:g} s"
    HANDED_OVER = "handed_over", "you have handed control over to {name}"
    RECEIVED = "received", "{name} has handed control over to you"
    KEPT = "kept", "{name} keeps control"
    FREE = "free", "control is free"
    OTHER = "other", "{name} has control now"


class Ended(NamedTuple):
    """Who lost control, and why."""

    name: str
    why: Fact

    @property
    def note(self) -> Fact:
        """The same as a note of all pages."""
        return Fact.of(Note.LOST, name=self.name, why=self.why)

    @property
    def fields(self) -> dict[str, str | float]:
        """The same as plain fields, which survive a restart of the server."""
        return {"name": self.name, "code": str(self.why.code), **self.why.data}

    @classmethod
    def of(cls, fields: Mapping[str, str | float]) -> Ended | None:
        """Return what these fields say; None if they are empty, or of another version."""
        data = dict(fields)
        name, code = data.pop("name", ""), data.pop("code", "")
        why = next((Fact(one, data) for one in Loss if one == code), None)
        return cls(str(name), why) if why else None
