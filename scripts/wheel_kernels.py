"""Build hook of the wheel.

Gets uPlot for the page, compiles the kernels, and says for which machine they are.

``FSW_WHEEL_PLATFORM``, e.g. ``manylinux_2_17_aarch64``, names another machine: then the ziglang
wheel compiles. Where no C compiler is found, the wheel is made without libraries; they are
compiled at the first start, into the user's cache.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLATFORM = "FSW_WHEEL_PLATFORM"
PACKAGES = ("fsw_nmpc", "fsw_decentral", "fsw_plant")


def zig_target(platform: str) -> str:
    """Target of zig for a platform tag, e.g. ``x86_64-linux-gnu.2.17``."""
    match = re.fullmatch(r"manylinux_(\d+)_(\d+)_(x86_64|aarch64)", platform)
    if match is None:
        sys.exit(
            f"{PLATFORM}={platform}: give a tag such as manylinux_2_17_x86_64 or "
            "manylinux_2_17_aarch64"
        )
    return f"{match[3]}-linux-gnu.{match[1]}.{match[2]}"


class CustomBuildHook(BuildHookInterface[Any]):
    """Called by hatchling before and after it makes a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the libraries and add them to the wheel."""
        if version == "editable":
            return
        sources = Path(self.root) / "src"
        subprocess.run([sys.executable, sources / "fsw_hmi" / "npm_packages.py"])
        sys.path.insert(0, str(sources / "fsw_control"))
        from fsw_control.c_library import CLibrary, compiler

        platform = os.environ.get(PLATFORM)
        zig = [sys.executable, "-m", "ziglang", "cc"]
        command = [*zig, "-target", zig_target(platform)] if platform else compiler()
        if command is None:
            self.app.display_warning(
                "no C compiler: the controllers will be compiled at their first start"
            )
            return
        self._folder = tempfile.mkdtemp()
        for package in PACKAGES:
            library = Path(self._folder, f"{package}.so")
            CLibrary(package, sources / package / package / "kernel").build(library, command)
            build_data["force_include"][str(library)] = f"{package}/_kernel.so"
        tag = platform or re.sub(r"\W", "_", sysconfig.get_platform())
        build_data["pure_python"], build_data["tag"] = False, f"py3-none-{tag}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was compiled."""
        shutil.rmtree(getattr(self, "_folder", ""), ignore_errors=True)
