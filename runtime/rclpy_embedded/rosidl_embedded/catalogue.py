"""Definitions of interfaces by name. The files are those that `search.definitions` finds."""

import re
from functools import cache
from pathlib import Path

from . import definition as d
from .parser import parse_action, parse_service, parse_structure
from .search import INTERFACE_PATH, KINDS, definitions

_SERVICE_PART = r"_(Request|Response|Event)"
_ACTION_SERVICE = r"_(SendGoal|GetResult)"
#: What the name of a service, and that of an action, is followed by in the names of its parts.
_PARTS = {
    "srv": re.compile(rf"{_SERVICE_PART}$"),
    "action": re.compile(rf"(_(Goal|Result|Feedback|FeedbackMessage)|{_ACTION_SERVICE}({_SERVICE_PART})?)$"),
}
_SERVICE = re.compile(rf"[^/]+/(srv/(?!.*{_SERVICE_PART}$)|action/.*{_ACTION_SERVICE}$)")


@cache
def structure(type_name: str) -> d.Structure:
    """Return the definition of a message, of a service or an action made of messages, or of a part of these.

    Raises d.UnknownInterfaceError if there is none and d.InvalidInterfaceError if it is wrong.
    """
    kind = split_name(type_name)[1]
    return interface(_PARTS[kind].sub("", type_name) if kind in _PARTS else type_name)[type_name]


def interface(type_name: str) -> dict[str, d.Structure]:
    """Return all that a definition defines, by name: a message, or a service or an action and its parts."""
    kind = split_name(type_name)[1]
    if kind == "msg":
        path = _find(type_name)
        return {type_name: parse_structure(_read(path), type_name, path)}
    return (_service if kind == "srv" else _action)(type_name)


def attributes(type_name: str) -> dict[str, str]:
    """Return the classes that the class of a service or an action has as attributes, as names of interfaces."""
    parts = ("Request", "Response", "Event") if role(type_name) == "service" else ("Goal", "Result", "Feedback")
    return {part: f"{type_name}_{part}" for part in parts}


def implementation(type_name: str) -> dict[str, str]:
    """Return what the attribute ``Impl`` of an action's class has as attributes, as names of interfaces."""
    return {
        "SendGoalService": f"{type_name}_SendGoal",
        "GetResultService": f"{type_name}_GetResult",
        "CancelGoalService": "action_msgs/srv/CancelGoal",
        "FeedbackMessage": f"{type_name}_FeedbackMessage",
        "GoalStatusMessage": "action_msgs/msg/GoalStatusArray",
    }


def _made_of(type_name: str, **parts: str) -> d.Structure:
    """Structure of fields that are structures themselves."""
    return d.Structure(type_name, tuple(d.Member(name, d.namespaced(part)) for name, part in parts.items()))


def _with_event(type_name: str, request: d.Structure, response: d.Structure) -> dict[str, d.Structure]:
    """A service by the names of its parts."""
    # As service introspection publishes it; part of the service's type hash.
    event = d.Structure(
        f"{type_name}_Event",
        (
            d.Member("info", d.namespaced("service_msgs/msg/ServiceEventInfo")),
            d.Member("request", d.BoundedSequence(d.namespaced(request.type_name), 1)),
            d.Member("response", d.BoundedSequence(d.namespaced(response.type_name), 1)),
        ),
    )
    parts = {"request_message": request, "response_message": response, "event_message": event}
    whole = _made_of(type_name, **{name: part.type_name for name, part in parts.items()})
    return {found.type_name: found for found in (whole, *parts.values())}


@cache
def _service(type_name: str) -> dict[str, d.Structure]:
    path = _find(type_name)
    return _with_event(type_name, *parse_service(_read(path), type_name, path))


@cache
def _action(type_name: str) -> dict[str, d.Structure]:
    """An action by the names of its parts, as rosidl_parser makes them."""
    path = _find(type_name)
    goal, result, feedback = parse_action(_read(path), type_name, path)
    uuid, time = "unique_identifier_msgs/msg/UUID", d.Member("stamp", d.namespaced("builtin_interfaces/msg/Time"))
    send, get = f"{type_name}_SendGoal", f"{type_name}_GetResult"
    accepted, status = d.Member("accepted", d.BasicType("boolean")), d.Member("status", d.BasicType("int8"))
    found = {part.type_name: part for part in (goal, result, feedback)}
    found |= _with_event(
        send,
        _made_of(f"{send}_Request", goal_id=uuid, goal=goal.type_name),
        d.Structure(f"{send}_Response", (accepted, time)),
    )
    found |= _with_event(
        get,
        _made_of(f"{get}_Request", goal_id=uuid),
        d.Structure(f"{get}_Response", (status, d.Member("result", d.namespaced(result.type_name)))),
    )
    message = _made_of(f"{type_name}_FeedbackMessage", goal_id=uuid, feedback=feedback.type_name)
    whole = _made_of(
        type_name,
        goal=goal.type_name,
        result=result.type_name,
        feedback=feedback.type_name,
        send_goal_service=send,
        get_result_service=get,
        feedback_message=message.type_name,
    )
    return found | {part.type_name: part for part in (message, whole)}


def source(type_name: str) -> tuple[str, str]:
    """Return kind (``msg``, ``srv``, ``action``) and text of an interface; parts are ``implicit``, without text."""
    kind = split_name(type_name)[1]
    if kind in _PARTS and _PARTS[kind].search(type_name):
        return "implicit", ""
    return kind, _read(_find(type_name))


def split_name(type_name: str) -> tuple[str, str, str]:
    """Split ``pkg/msg/Name``; ``pkg/Name`` counts as a message. UnknownInterfaceError if it is no such name."""
    parts = type_name.split("/")
    if len(parts) == 2:
        parts.insert(1, "msg")
    if len(parts) != 3 or parts[1] not in KINDS or not all(part.isidentifier() for part in parts):
        raise d.UnknownInterfaceError(f"{type_name!r} is not the name of an interface such as 'std_msgs/msg/String'")
    return parts[0], parts[1], parts[2]


def role(type_name: str) -> str:
    """Return what a name stands for: "service", "action" (each as a whole) or "message" (also a part of these)."""
    if _SERVICE.match(type_name):
        return "service"
    return "action" if "/action/" in type_name and not _PARTS["action"].search(type_name) else "message"


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise d.InvalidInterfaceError(f"{path} cannot be read: {error}") from error


def _find(type_name: str) -> str:
    package, kind, name = split_name(type_name)
    try:
        return definitions(package, kind)[name]
    except KeyError:
        raise d.UnknownInterfaceError(
            f"no definition of '{package}/{kind}/{name}': it is neither a common Jazzy interface nor in a folder of"
            f" {INTERFACE_PATH} or sys.path"
        ) from None
