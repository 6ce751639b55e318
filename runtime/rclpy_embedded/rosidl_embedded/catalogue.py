"""Definitions of interfaces by name. The files are those that `search.definitions` finds.

What a service or an action is made of is written in the language of message definitions, too: the parts that its file
holds, and those that rosidl adds to each.
"""

import re
from functools import cache
from pathlib import Path

from . import definition as d
from .parser import PARTS, parse_structure, split_parts
from .search import INTERFACE_PATH, KINDS, definitions

_SERVICE_PART = r"_(Request|Response|Event)"
_ACTION_SERVICE = r"_(SendGoal|GetResult)"
#: What the name of a service, and that of an action, is followed by in the names of its parts.
_ENDINGS = {
    "msg": re.compile("(?!)"),
    "srv": re.compile(rf"{_SERVICE_PART}$"),
    "action": re.compile(rf"(_(Goal|Result|Feedback|FeedbackMessage)|{_ACTION_SERVICE}({_SERVICE_PART})?)$"),
}
_SERVICE = re.compile(rf"[^/]+/(srv/(?!.*{_SERVICE_PART}$)|action/.*{_ACTION_SERVICE}$)")

#: Texts of what every service has, by the end of its name, beside request and response.
_ADDED_TO_SERVICE = {
    "": "{name}_Request request_message\n{name}_Response response_message\n{name}_Event event_message\n",
    # As service introspection publishes it; part of the service's type hash.
    "_Event": "service_msgs/ServiceEventInfo info\n{name}_Request[<=1] request\n{name}_Response[<=1] response\n",
}
#: The same for an action, beside goal, result and feedback; its services get what every service has.
_ADDED_TO_ACTION = {
    "": "{name}_Goal goal\n{name}_Result result\n{name}_Feedback feedback\n{name}_SendGoal send_goal_service\n"
    "{name}_GetResult get_result_service\n{name}_FeedbackMessage feedback_message\n",
    "_SendGoal_Request": "unique_identifier_msgs/UUID goal_id\n{name}_Goal goal\n",
    "_SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp\n",
    "_GetResult_Request": "unique_identifier_msgs/UUID goal_id\n",
    "_GetResult_Response": "int8 status\n{name}_Result result\n",
    "_FeedbackMessage": "unique_identifier_msgs/UUID goal_id\n{name}_Feedback feedback\n",
}


@cache
def structure(type_name: str) -> d.Structure:
    """Return the definition of a message, of a service or an action made of messages, or of a part of these.

    Raises d.UnknownInterfaceError if there is none and d.InvalidInterfaceError if it is wrong.
    """
    path, texts = interface(_whole(type_name))
    return parse_structure(texts[type_name], type_name, path)


@cache
def interface(type_name: str) -> tuple[str, dict[str, str]]:
    """Return the file of a message, a service or an action, and the texts of this and of its parts by name."""
    kind, path = split_name(type_name)[1], _find(type_name)
    text = _read(path)
    if kind == "msg":
        return path, {type_name: text}
    found = split_parts(text, type_name, path, PARTS[kind])
    added = [(type_name, _ADDED_TO_SERVICE)]
    if kind == "action":
        services = f"{type_name}_SendGoal", f"{type_name}_GetResult"
        added = [(type_name, _ADDED_TO_ACTION), *((service, _ADDED_TO_SERVICE) for service in services)]
    for name, texts in added:
        found |= {name + end: text.format(name=name) for end, text in texts.items()}
    return path, found


def _whole(type_name: str) -> str:
    """Name of the message, service or action that something is part of."""
    return _ENDINGS[split_name(type_name)[1]].sub("", type_name)


def attributes(type_name: str) -> dict[str, str]:
    """Return the classes that the class of a service or an action has as attributes, as names of interfaces."""
    parts = (*PARTS["srv"], "Event") if role(type_name) == "service" else PARTS["action"]
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


def source(type_name: str) -> tuple[str, str]:
    """Return kind (``msg``, ``srv``, ``action``) and text of an interface; parts are ``implicit``, without text."""
    if _whole(type_name) != type_name:
        return "implicit", ""
    return split_name(type_name)[1], _read(_find(type_name))


def message_text(type_name: str) -> str:
    """Text of a message, as in its file, or that of a part of a service or an action as if it were one."""
    package, kind, _ = split_name(type_name)
    text = interface(_whole(type_name))[1][type_name]
    return text if kind == "msg" else text.lstrip("\n").replace(f"{package}/{kind}/", f"{package}/")


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
    return "action" if "/action/" in type_name and not _ENDINGS["action"].search(type_name) else "message"


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
