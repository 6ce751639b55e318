"""What of the software decides the results of a campaign, in one line."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from platform import python_version

#: packages that compute, and of others the modules that do
_PACKAGES = ("fsw_control", "fsw_decentral", "fsw_model", "fsw_nmpc", "fsw_plant", "fsw_supervisor")
_MODULES = {
    "fsw_analysis": ("changes", "kpi", "weld_signals"),
    "fsw_scenario": (
        *("closed_loop", "controllers", "offline_supervisor", "open_loop", "scenario", "scenario_file"),
        *("timeline", "weld_programme", "weld_programme_file"),
    ),
    "fsw_campaign": ("definition", "distributions", "welds"),
}
#: files of theirs that are for the graph alone
_GRAPH = ("_ros.py", "_node.py")


def sources() -> Iterator[Path]:
    """Python and parameter files by which a weld is computed and judged, in a fixed order."""
    for package in _PACKAGES:
        files = (path for end in ("py", "yaml") for path in _folder(package).glob(f"*.{end}"))
        yield from sorted(path for path in files if not path.name.endswith(_GRAPH))
    for package, modules in _MODULES.items():
        yield from (_folder(package) / f"{module}.py" for module in modules)


def _folder(package: str) -> Path:
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).parent


def digest() -> str:
    """Digest of :func:`sources`."""
    found = hashlib.sha256()
    for path in sources():
        found.update(f"{path.parent.name}/{path.name}".encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


@lru_cache(maxsize=1)
def versions() -> str:
    """Versions of packages, and digests of the controllers' C sources and of the Python code around them."""
    from fsw_decentral.library import KERNEL as DECENTRAL
    from fsw_nmpc.library import KERNEL as NMPC

    try:
        own = version("fsw-control")
    except PackageNotFoundError:  # imported from the source tree
        own = "source"
    found = {"fsw_control": own, "code": digest(), "nmpc": NMPC.source_id(), "decentral": DECENTRAL.source_id()}
    found |= {name: version(name) for name in ("numpy", "casadi")} | {"python": python_version()}
    return ", ".join(f"{name} {value}" for name, value in found.items())
