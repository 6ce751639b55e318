"""What publishers, subscriptions, clients and services share."""

from __future__ import annotations

from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.impl.dds import delete
from rclpy.impl.session import LocalNode, Session


class Endpoint:
    """One or two DDS entities under a name, until they are destroyed.

    Parameters
    ----------
    name : str
        Full name of the topic or service.
    reader, writer : Entity, optional
        DDS entities, announced as the node's.
    """

    #: What wakes the executor.
    condition: Any = None
    event_handlers: list[Any] | tuple[()] = ()

    def __init__(
        self, session: Session, local_node: LocalNode, name: str, *, reader: Any = None, writer: Any = None
    ) -> None:
        self._session = session
        self._local_node = local_node
        self._name = name
        self._reader = reader
        self._writer = writer
        session.add_endpoints(local_node, reader=reader, writer=writer)

    @property
    def handle(self) -> Any:
        """The DDS reader, that of a publisher the writer.

        Raises
        ------
        InvalidHandle
            After destruction.
        """
        entity = self._writer if self._reader is None else self._reader
        if entity is None:
            raise InvalidHandle("Cannot use Destroyable because destruction was requested")
        return entity

    def _full_name(self) -> str:
        assert self.handle
        return self._name

    def destroy(self) -> None:
        """Remove it from the graph; better call the node's method."""
        reader, writer = self._reader, self._writer
        if reader is not None or writer is not None:
            self._reader = self._writer = None
            for handler in self.event_handlers:
                handler.destroy()
            delete(self.condition)
            self._session.remove_endpoints(self._local_node, reader=reader, writer=writer)
