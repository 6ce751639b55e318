"""The software that decides the results of a campaign, in one line."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from platform import python_version

from fsw_recorder.recording import code_sha256

#: packages that compute and judge a weld
PACKAGES = (
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


@cache
def versions() -> str:
    """Versions of packages, and a digest of the code that computes and judges a weld."""
    try:
        own = version("fsw-control")
    except PackageNotFoundError:  # imported from the source tree
        own = "source"
    code = hashlib.sha256("".join(map(code_sha256, PACKAGES)).encode()).hexdigest()[:16]
    parts = {"fsw_control": own, "code": code}
    parts |= {name: version(name) for name in ("numpy", "casadi")} | {"python": python_version()}
    return ", ".join(f"{name} {value}" for name, value in parts.items())
