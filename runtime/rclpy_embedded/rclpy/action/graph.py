"""Which actions there are."""

from typing import Any

from rclpy.impl.graph import NamesAndTypes

# Every action has this topic, of this type.
_TOPIC, _TYPE = "/_action/feedback", "_FeedbackMessage"


def _actions(topics: NamesAndTypes) -> NamesAndTypes:
    return [
        (name.removesuffix(_TOPIC), [type_name.removesuffix(_TYPE) for type_name in types])
        for name, types in topics
        if name.endswith(_TOPIC)
    ]


def get_action_client_names_and_types_by_node(
    node: Any, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """Return actions and types of a node's action clients; NodeNameNonExistentError if there is no such node."""
    return _actions(node.get_subscriber_names_and_types_by_node(remote_node_name, remote_node_namespace))


def get_action_server_names_and_types_by_node(
    node: Any, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """Return actions and types of a node's action servers; NodeNameNonExistentError if there is no such node."""
    return _actions(node.get_publisher_names_and_types_by_node(remote_node_name, remote_node_namespace))


def get_action_names_and_types(node: Any) -> NamesAndTypes:
    return _actions(node.get_topic_names_and_types())
