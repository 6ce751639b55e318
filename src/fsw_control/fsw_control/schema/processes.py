"""Environment for programs that are not Python: compilers, npm, system tools."""

from __future__ import annotations

import os
import sys

#: set by the ROS 2 wheels when they restart the interpreter with their libraries in
#: LD_LIBRARY_PATH
_WHEELS_READY = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
_PATH = "LD_LIBRARY_PATH"


def tool_environment() -> dict[str, str]:
    """Return this process's environment without the library path that the ROS 2 wheels added.

    A sourced ROS 2 keeps its own.
    """
    environment = dict(os.environ)
    if environment.pop(_WHEELS_READY, None) is None:
        return environment
    own = os.path.join(sys.prefix, "lib")
    kept = [
        path
        for path in environment.get(_PATH, "").split(os.pathsep)
        if path and not path.startswith(own)
    ]
    environment.pop(_PATH, None)
    return environment | ({_PATH: os.pathsep.join(kept)} if kept else {})
