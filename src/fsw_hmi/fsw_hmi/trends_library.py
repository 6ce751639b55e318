"""uPlot, which draws the trends: installed by npm in the background of the page's first start."""

from __future__ import annotations

import asyncio
import hashlib
import sys
import threading
from pathlib import Path

from fsw_control.schema.files import user_cache
from fsw_hmi import npm

#: files that a page requests
FILES = ("uPlot.iife.min.js", "uPlot.min.css")
_LOOK_S = 0.05


def folder() -> Path:
    """Folder of the installation for this user and version of the lock."""
    lock = (npm.OWN / "package-lock.json").read_bytes()
    return user_cache("fsw_hmi") / hashlib.sha256(lock).hexdigest()[:12]


def install() -> Path:
    """Install it if necessary; returns the folder of ``FILES``. Raises NpmError on failure."""
    return npm.install(folder(), ["--omit=dev"]) / "uplot" / "dist"


class Uplot:
    """Files of uPlot once installed; without them the page lacks only its trends."""

    def __init__(self) -> None:
        self._files: dict[str, bytes] = {}
        self._thread = threading.Thread(target=self._read, name="uplot", daemon=True)
        self._thread.start()

    async def file(self, name: str) -> bytes | None:
        """A file; waits for the installation. None if it does not exist."""
        while self._thread.is_alive():
            await asyncio.sleep(_LOOK_S)
        return self._files.get(name)

    def _read(self) -> None:
        try:
            dist = install()
            self._files = {name: (dist / name).read_bytes() for name in FILES}
        except (npm.NpmError, OSError) as error:
            print(
                f"the page has no trends: {error}; then start it again, to install uPlot",
                file=sys.stderr,
            )
