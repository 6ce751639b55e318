"""Names of diagnostics: all nodes of a domain share ``/diagnostics``, so they carry the weld's namespace."""

from __future__ import annotations

#: what diagnostics of this software call the hardware, behind the namespace
HARDWARE = "fsw"


def qualified(namespace: str, name: str) -> str:
    """A name behind its namespace, as diagnostic_aggregator knows it: without the first slash."""
    return f"{namespace}/{name}".strip("/")


def local_name(name: str, hardware_id: str, namespace: str) -> str | None:
    """Name of a status (``NODE: PART``) as a node in ``namespace`` shows it, None if it concerns another weld.

    Of this software's nodes only those in the same namespace do. Of other nodes all do, as a joint
    sensor's, except those that name another namespace than a weld's own by a leading slash.
    """
    node, colon, part = name.partition(": ")
    home, _, short = node.removeprefix("/").rpartition("/")
    if home == namespace.strip("/"):
        return short + colon + part
    ours = hardware_id.rpartition("/")[2] == HARDWARE
    elsewhere = namespace.strip("/") and home and node.startswith("/")
    return None if ours or elsewhere else name
