"""A progress bar on a terminal, a few lines elsewhere."""

from __future__ import annotations

import sys
import time

_WIDTH = 40
#: Elsewhere than on a terminal a line is written at most this often.
_QUIET_S = 3.0


class ProgressBar:
    """Shows the share done of one piece of work, on stderr; may be used as a context.

    Parameters
    ----------
    title : str
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._began = self._written_s = time.monotonic()
        self._shown = -1
        self._terminal = sys.stderr.isatty()

    def __call__(self, share: float) -> None:
        """Show the share done, 0 to 1."""
        percent = int(100 * min(max(share, 0.0), 1.0))
        now_s = time.monotonic()
        if percent <= self._shown or (not self._terminal and now_s < self._written_s + _QUIET_S):
            return
        self._shown, self._written_s = percent, now_s
        filled = _WIDTH * percent // 100
        bar = f"{self._title} [{'#' * filled}{'.' * (_WIDTH - filled)}] {percent:3d} %  {now_s - self._began:5.1f} s"
        print(f"\r{bar}" if self._terminal else bar, end="" if self._terminal else "\n", file=sys.stderr, flush=True)

    def done(self) -> None:
        """Show that all is done and end the line."""
        self(1.0)
        self._end_line()

    def _end_line(self) -> None:
        if self._terminal:
            print(file=sys.stderr)

    def __enter__(self) -> ProgressBar:
        self(0.0)
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.done()
        else:
            self._end_line()
