"""Codes of answers to the page's requests and of notes about control, with their texts."""

from __future__ import annotations

from typing import NamedTuple

from fsw_control.coded import Worded
from fsw_control.schema.errors import InputError
from fsw_hmi.frames import readable

DONE, REFUSED, TIMED_OUT = "done", "refused", "timed_out"


class Answer(NamedTuple):
    """What became of a request."""

    outcome: str  #: ``DONE``, ``REFUSED`` or ``TIMED_OUT``; empty while it is not decided
    code: str  #: of :class:`Code`, or of the service that answered
    message: str  #: the same in words


class Code(Worded):
    """Kind of an answer."""

    def done(self, **data: object) -> Answer:
        """Return the answer to a request that is carried out."""
        return Answer(DONE, self, self.words.format_map(data))

    def refused(self, **data: object) -> Answer:
        """Return the answer to a request that is refused."""
        return Answer(REFUSED, self, self.words.format_map(data))

    def timed_out(self, **data: object) -> Answer:
        """Return the answer to a request without an answer in time."""
        return Answer(TIMED_OUT, self, self.words.format_map(data))

    # the message
    MALFORMED = "malformed", "the message is no request"
    NO_REQUEST = "no_request", "{reason}"
    MISSING = "missing", "{reason}"
    OUTSIDE = "outside", "{reason}"
    CONTRADICTS = "value_error", "{reason}"
    INVALID = "invalid", "{reason}"
    TOO_MANY = "too_many", "too many requests in a second"
    # login
    LOG_IN = "log_in", "log in first"
    LOGGED_IN = "logged_in", "logged in as {name}"
    WRONG_TOKEN = "wrong_token", "wrong token"
    WRONG_PASSWORD = "wrong_password", "wrong name or password"
    WRONG_FROM = "wrong_from", "{what}, from {address}"
    TOO_LONG = "too_long", "password: at most {longest} characters"
    BUSY = "busy", "your password cannot be checked now: try again in some seconds"
    # control
    NOT_HOLDER = "not_holder", "you do not have control"
    TAKE_FIRST = "take_first", "you do not have control: take it first"
    HAVE_CONTROL = "have_control", "you have control already"
    TAKEN = "taken", "control taken"
    TAKEN_FROM_OWN = "taken_from_own", "control taken from {holder}, the same person"
    TAKEN_FROM_SILENT = (
        "taken_from_silent",
        "control taken from {holder}, silent for {limit_s:g} s",
    )
    ASK_FIRST = "ask_first", "{holder} has control: ask for it"
    TIME_LEFT = "time_left", "{holder} has {left_s:.0f} s left to answer"
    FREE = "free", "control is free: take it"
    OTHER_ASKER = "other_asker", "{asker} asks for control already"
    ASKED = "asked", "{holder} has been asked for control"
    NOT_ASKER = "not_asker", "you do not ask for control"
    WITHDRAWN = "withdrawn", "control is no longer asked for"
    NOBODY_ASKS = "nobody_asks", "nobody asks for control now"
    ANOTHER_ASKS = "another_asks", "{asker} asks now: look again"
    HANDED_OVER = "handed_over", "control handed over to {asker}"
    KEPT = "kept", "control not handed over to {asker}"
    RELEASED = "released", "control released"
    # answers of the graph
    NO_SERVICE = "no_service", "there is no {service} to ask"
    SILENT = "silent", "the {service} did not answer in time"
    ASKED_AGAIN = "asked_again", "no {service} answers; it is asked for up to {wait_s:g} s more"
    NOT_ASKED = "not_asked", "the {service} could not be asked: {error}"
    SERVICE = "service", "{message}"
    ABORTED = "aborted", "the weld is aborted"
    NO_WELD = "no_weld", "no weld is under way that could be aborted"
    # alarms
    ACKNOWLEDGED = "acknowledged", "{count} acknowledged"
    SHELVED = "shelved", "shelved"
    UNSHELVED = "unshelved", "back in the list"
    NOT_LISTED = "not_listed", "this alarm is no longer in the list"
    HIGH_PRIORITY = "high_priority", "an alarm of high priority cannot be shelved"
    NOT_SHELVED = "not_shelved", "this alarm is not shelved"


#: by the kind of what is wrong with a value
_INVALID = {
    str(code): code for code in (Code.NO_REQUEST, Code.MISSING, Code.OUTSIDE, Code.CONTRADICTS)
}


def invalid(error: InputError) -> Answer:
    """Return the answer to a request whose content is invalid, by its first problem.

    Its words are the schema's, which name each key and its range.
    """
    kind = error.problems[0].kind if error.problems else ""
    return _INVALID.get(kind, Code.INVALID).refused(reason=readable(str(error)))


class Loss(Worded):
    """Why control ended without being released."""

    PAGE_CLOSED = "page_closed", "the page was closed"
    SERVER_ENDED = "server_ended", "the page's server ended"
    NOT_CONNECTED = "not_connected", "its page was not connected for {limit_s:g} s"
    OTHER_LOGIN = "other_login", "{user} has logged in there"


class Note(Worded):
    """What happened to the control of a page, or of all."""

    LOST = "lost", "{name} has lost control: {why.words}"
    TAKEN_BY_OWN = "taken_by_own", "you have taken control on another page ({session})"
    TAKEN = "taken", "{name} has taken control: nobody answered for {wait_s:g} s"
    HANDED_OVER = "handed_over", "you have handed control over to {name}"
    RECEIVED = "received", "{name} has handed control over to you"
    KEPT = "kept", "{name} keeps control"
    FREE = "free", "control is free"
    OTHER = "other", "{name} has control now"
