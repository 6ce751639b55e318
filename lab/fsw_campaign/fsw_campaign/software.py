"""The software that decides the results of a campaign, in one line."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version

#: packages that compute and judge a weld
_PACKAGES = (
    "fsw_schema",
    "fsw_model",
    "fsw_control",
    "fsw_nmpc",
    "fsw_decentral",
    "fsw_plant",
    "fsw_supervisor",
    "fsw_analysis",
    "fsw_scenario",
    "fsw_campaign",
    "fsw_recorder",  # the last has the signatures
)
#: endings of files that only the graph uses
_GRAPH = ("_ros.py", "_node.py")


def sources() -> Iterator[Path]:
    """Python and parameter files of the packages that compute and evaluate a weld, in a fixed order."""
    for package in _PACKAGES:
        for path in sorted(Path(str(resources.files(package))).rglob("*")):
            if path.suffix in (".py", ".yaml") and not path.name.endswith(_GRAPH):
                yield path


def digest() -> str:
    """Digest of :func:`sources`."""
    found = hashlib.sha256()
    for path in sources():
        found.update(f"{path.parent.name}/{path.name}".encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


@cache
def versions() -> str:
    """Versions of packages, and digests of the C sources and of the Python code around them."""
    from fsw_decentral.library import KERNEL as DECENTRAL
    from fsw_nmpc.library import KERNEL as NMPC
    from fsw_plant.library import KERNEL as PLANT

    try:
        own = version("fsw-control")
    except PackageNotFoundError:  # imported from the source tree
        own = "source"
    found = {
        "fsw_control": own,
        "code": digest(),
        "nmpc": NMPC.source_id(),
        "decentral": DECENTRAL.source_id(),
        "plant": PLANT.source_id(),
    }
    found |= {name: version(name) for name in ("numpy", "casadi")} | {"python": python_version()}
    return ", ".join(f"{name} {value}" for name, value in found.items())
