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
    MALFORMED = "the message is no request"
    NO_REQUEST = "{reason}"
    MISSING = "{reason}"
    OUTSIDE = "{reason}"
    CONTRADICTS = "value_error", "{reason}"
    INVALID = "{reason}"
    TOO_MANY = "too many requests in a second"
    # login
    LOG_IN = "log in first"
    LOGGED_IN = "logged in as {name}"
    WRONG_TOKEN = "wrong token"
    WRONG_PASSWORD = "wrong name or password"
    WRONG_FROM = "{what}, from {address}"
    TOO_LONG = "password: at most {longest} characters"
    BUSY = "your password cannot be checked now: try again in some seconds"
    # control
    NOT_HOLDER = "you do not have control"
    TAKE_FIRST = "you do not have control: take it first"
    HAVE_CONTROL = "you have control already"
    TAKEN = "control taken"
    TAKEN_FROM_OWN = "control taken from {holder}, the same person"
    TAKEN_FROM_SILENT = "control taken from {holder}, silent for {limit_s:g} s"
    ASK_FIRST = "{holder} has control: ask for it"
    TIME_LEFT = "{holder} has {left_s:.0f} s left to answer"
    FREE = "control is free: take it"
    OTHER_ASKER = "{asker} asks for control already"
    ASKED = "{holder} has been asked for control"
    NOT_ASKER = "you do not ask for control"
    WITHDRAWN = "control is no longer asked for"
    NOBODY_ASKS = "nobody asks for control now"
    ANOTHER_ASKS = "{asker} asks now: look again"
    HANDED_OVER = "control handed over to {asker}"
    KEPT = "control not handed over to {asker}"
    RELEASED = "control released"
    # answers of the graph
    NO_SERVICE = "there is no {service} to ask"
    SILENT = "the {service} did not answer in time"
    ASKED_AGAIN = "no {service} answers; it is asked for up to {wait_s:g} s more"
    UNCONFIRMED = (
        "the {service} has not confirmed it; the request is repeated for up to {wait_s:g} s"
    )
    NOT_ASKED = "the {service} could not be asked: {error}"
    SERVICE = "{message}"
    # alarms
    ACKNOWLEDGED = "{count} acknowledged"
    SHELVED = "shelved"
    UNSHELVED = "back in the list"
    NOT_LISTED = "this alarm is no longer in the list"
    HIGH_PRIORITY = "an alarm of high priority cannot be shelved"
    NOT_SHELVED = "this alarm is not shelved"


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

    PAGE_CLOSED = "the page was closed"
    SERVER_ENDED = "the page's server ended"
    NOT_CONNECTED = "its page was not connected for {limit_s:g} s"
    OTHER_LOGIN = "{user} has logged in there"


class Note(Worded):
    """What happened to the control of a page, or of all."""

    LOST = "{name} has lost control: {why.words}"
    TAKEN_BY_OWN = "you have taken control on another page ({session})"
    TAKEN = "{name} has taken control: nobody answered for {wait_s:g} s"
    HANDED_OVER = "you have handed control over to {name}"
    RECEIVED = "{name} has handed control over to you"
    KEPT = "{name} keeps control"
    FREE = "control is free"
    OTHER = "{name} has control now"
