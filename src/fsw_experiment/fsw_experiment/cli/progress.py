"""A progress bar on a terminal, a few lines elsewhere."""

from __future__ import annotations

import sys
import time

_WIDTH = 40


class ProgressBar:
    """Shows the share done of one piece of work.

    Parameters
    ----------
    title : str
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._began = time.monotonic()
        self._shown = -1
        self._terminal = sys.stderr.isatty()

    def __call__(self, share: float) -> None:
        """Show the share done, 0 to 1."""
        percent = int(100 * min(max(share, 0.0), 1.0))
        if percent <= self._shown or (not self._terminal and percent < min(self._shown + 25, 100)):
            return
        self._shown = percent
        elapsed = time.monotonic() - self._began
        filled = _WIDTH * percent // 100
        bar = f"{self._title} [{'#' * filled}{'.' * (_WIDTH - filled)}] {percent:3d} %  {elapsed:5.1f} s"
        print(f"\r{bar}" if self._terminal else bar, end="" if self._terminal else "\n", file=sys.stderr, flush=True)

    def done(self) -> None:
        """End the line."""
        self(1.0)
        if self._terminal:
            print(file=sys.stderr)
