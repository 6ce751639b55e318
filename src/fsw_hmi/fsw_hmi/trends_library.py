"""uPlot, which draws the trends: installed by npm at the page's first start, beside everything else that it does."""

from __future__ import annotations

import asyncio
import hashlib
import sys
import threading
from pathlib import Path

from fsw_control.schema.files import user_cache
from fsw_hmi import npm

#: what a page asks for
FILES = ("uPlot.iife.min.js", "uPlot.min.css")
_LOOK_S = 0.05


def folder() -> Path:
    """Where it is installed for this user; a folder for each version of the lock."""
    lock = (npm.OWN / "package-lock.json").read_bytes()
    return user_cache("fsw_hmi") / hashlib.sha256(lock).hexdigest()[:12]


def install() -> Path:
    """Install it, unless that is done; returns the folder of ``FILES``. Raises NpmError when that is not possible."""
    return npm.install(folder(), ["--omit=dev"]) / "uplot" / "dist"


class Uplot:
    """The files of uPlot, as soon as they are there. Without them the page has no trends, but all else."""

    def __init__(self) -> None:
        self._files: dict[str, bytes] = {}
        self._thread = threading.Thread(target=self._read, name="uplot", daemon=True)
        self._thread.start()

    async def file(self, name: str) -> bytes | None:
        """A file; waits while it is being installed. None where there is none."""
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
