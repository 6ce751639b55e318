"""The graph queries of a node."""

from collections.abc import Callable

from rclpy.context import Context
from rclpy.impl.dds import profile_from_dds
from rclpy.impl.graph import (
    Graph,
    NamesAndTypes,
    names_and_types,
    ros_service,
    ros_topic,
    ros_type,
    user_data_field,
)
from rclpy.names import expand_topic_name, validate_full_topic_name
from rclpy.topic_endpoint_info import TopicEndpointInfo, TopicEndpointTypeEnum
from rclpy.type_hash import TypeHash
from rclpy.utilities import wait_until


class NodeGraph:
    """Graph queries. Names may be relative or private; they are not remapped."""

    _context: Context
    get_name: Callable[[], str]
    get_namespace: Callable[[], str]
    resolve_topic_name: Callable[[str], str]

    @property
    def __graph(self) -> Graph:
        return self._context.session.graph

    def __full_name(self, name: str, *, is_service: bool = False) -> str:
        full = expand_topic_name(name, self.get_name(), self.get_namespace())
        validate_full_topic_name(full, is_service=is_service)
        return full

    def __topics_of(self, name: str, namespace: str, no_demangle: bool, *, writers: bool) -> NamesAndTypes:
        endpoints = self.__graph.endpoints_by_node(name, namespace, writers=writers)
        return names_and_types(endpoints, None if no_demangle else ros_topic)

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """Return topics and types of a node's publishers; NodeNameNonExistentError if there is no such node."""
        return self.__topics_of(node_name, node_namespace, no_demangle, writers=True)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """Return topics and types of a node's subscriptions; NodeNameNonExistentError if there is no such node."""
        return self.__topics_of(node_name, node_namespace, no_demangle, writers=False)

    def __services_of(self, name: str, namespace: str, received: str) -> NamesAndTypes:
        endpoints = self.__graph.endpoints_by_node(name, namespace, writers=False)
        return names_and_types([e for e in endpoints if e.topic_name.startswith(received)], ros_service)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return services and types of a node's servers; NodeNameNonExistentError if there is no such node."""
        return self.__services_of(node_name, node_namespace, "rq/")

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return services and types of a node's clients; NodeNameNonExistentError if there is no such node."""
        return self.__services_of(node_name, node_namespace, "rr/")

    def __all_names_and_types(self, demangle: Callable[[str], str | None] | None) -> NamesAndTypes:
        endpoints = self.__graph.endpoints(writers=True) + self.__graph.endpoints(writers=False)
        return names_and_types(endpoints, demangle)

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        return self.__all_names_and_types(None if no_demangle else ros_topic)

    def get_service_names_and_types(self) -> NamesAndTypes:
        return self.__all_names_and_types(ros_service)

    def get_node_names(self) -> list[str]:
        return [node.node_name for _, node in self.__graph.nodes()]

    def get_fully_qualified_node_names(self) -> list[str]:
        return [f"{node.node_namespace.rstrip('/')}/{node.node_name}" for _, node in self.__graph.nodes()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(node.node_name, node.node_namespace) for _, node in self.__graph.nodes()]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        return [(node.node_name, node.node_namespace, enclave) for enclave, node in self.__graph.nodes()]

    def count_publishers(self, topic_name: str) -> int:
        return len(self.__graph.endpoints_of("rt" + self.__full_name(topic_name), writers=True))

    def count_subscribers(self, topic_name: str) -> int:
        return len(self.__graph.endpoints_of("rt" + self.__full_name(topic_name), writers=False))

    def count_clients(self, service_name: str) -> int:
        name = self.__full_name(service_name, is_service=True)
        return len(self.__graph.endpoints_of(f"rr{name}Reply", writers=False))

    def count_services(self, service_name: str) -> int:
        name = self.__full_name(service_name, is_service=True)
        return len(self.__graph.endpoints_of(f"rq{name}Request", writers=False))

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return node, type, GID and QoS of each publisher of a topic; with `no_mangle`, of a DDS topic."""
        return self.__infos(topic_name, no_mangle, writers=True)

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return node, type, GID and QoS of each subscription of a topic; with `no_mangle`, of a DDS topic."""
        return self.__infos(topic_name, no_mangle, writers=False)

    def __infos(self, topic_name: str, no_mangle: bool, *, writers: bool) -> list[TopicEndpointInfo]:
        dds_topic = topic_name if no_mangle else "rt" + self.resolve_topic_name(self.__full_name(topic_name))
        kind = TopicEndpointTypeEnum.PUBLISHER if writers else TopicEndpointTypeEnum.SUBSCRIPTION
        return [
            TopicEndpointInfo(
                node_name=node.node_name if node else "_NODE_NAME_UNKNOWN_",
                node_namespace=node.node_namespace if node else "_NODE_NAMESPACE_UNKNOWN_",
                topic_type=endpoint.type_name if no_mangle else ros_type(endpoint.type_name),
                topic_type_hash=TypeHash.from_string(user_data_field(endpoint.qos, "typehash")),
                endpoint_type=kind,
                endpoint_gid=list(endpoint.key.bytes),
                qos_profile=profile_from_dds(endpoint.qos),
            )
            for endpoint in self.__graph.endpoints_of(dds_topic, writers=writers)
            for node in [self.__graph.node_of(endpoint)]
        ]

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait up to `timeout` seconds for a node; return whether it is there."""
        name = "/" + fully_qualified_node_name.lstrip("/")
        return wait_until(lambda: name in self.get_fully_qualified_node_names(), timeout)
