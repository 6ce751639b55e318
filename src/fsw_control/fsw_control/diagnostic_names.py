"""Names in ``/diagnostics``, shared by all nodes of a domain: they carry the weld's namespace."""

from __future__ import annotations

#: hardware name of this software's diagnostics, behind the namespace
HARDWARE = "fsw"


def qualified(namespace: str, name: str) -> str:
    """Prefix a name with its namespace as diagnostic_aggregator does: without leading slash."""
    return f"{namespace}/{name}".strip("/")


def local_name(name: str, hardware_id: str, namespace: str) -> str | None:
    """Name of a status (``NODE: PART``) for a node in ``namespace``; None if it is another weld's.

    A status of this software belongs to the weld of its namespace. Other nodes, such as a joint
    sensor's, belong to every weld, unless a leading slash names another namespace.
    """
    node, colon, part = name.partition(": ")
    home, _, short = node.removeprefix("/").rpartition("/")
    if home == namespace.strip("/"):
        return short + colon + part
    ours = hardware_id.rpartition("/")[2] == HARDWARE
    elsewhere = namespace.strip("/") and home and node.startswith("/")
    return None if ours or elsewhere else name
