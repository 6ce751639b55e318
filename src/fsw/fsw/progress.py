"""A progress bar on a terminal, a few lines elsewhere."""

from __future__ import annotations

import sys
import time

_WIDTH = 40
#: Elsewhere than on a terminal a line is written at most this often.
_QUIET_S = 3.0
#: On a terminal a rate is written at most this often.
_NOTE_S = 0.2


class ProgressBar:
    """Shows the share done of one piece of work, on stderr; may be used as a context.

    Parameters
    ----------
    title : str
    total : int
        Pieces of work, where they are counted: then their rate and the remaining time are shown, too.
    unit : str
        What the pieces are.
    """

    def __init__(self, title: str, total: int = 0, unit: str = "") -> None:
        self._title = title
        self._total, self._unit, self._note = total, unit, ""
        self._began = self._written_s = time.monotonic()
        self._shown = -1
        self._terminal = sys.stderr.isatty()

    def __call__(self, share: float) -> None:
        """Show the share done, 0 to 1."""
        percent = int(100 * min(max(share, 0.0), 1.0))
        now_s = time.monotonic()
        soon_s = _QUIET_S if not self._terminal else _NOTE_S if self._note else 0.0
        if (percent <= self._shown and not self._note) or now_s < self._written_s + soon_s:
            return
        self._shown, self._written_s = percent, now_s
        filled = _WIDTH * percent // 100
        drawn = f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {percent:3d} %"
        bar = f"{self._title} {drawn}  {now_s - self._began:5.1f} s{self._note}"
        print(f"\r{bar}" if self._terminal else bar, end="" if self._terminal else "\n", file=sys.stderr, flush=True)

    def count(self, done: int) -> None:
        """Show the number of pieces done, their rate and the remaining time."""
        rate = done / max(time.monotonic() - self._began, 1e-9)
        left_s = round((self._total - done) / max(rate, 1e-9))
        left = f"{left_s // 3600:d}:{left_s // 60 % 60:02d}:{left_s % 60:02d}"
        self._note = f", {rate:.3g} {self._unit}/s, {left} left   "
        self(done / self._total)

    def done(self) -> None:
        """Show that all is done and end the line."""
        if self._total:  # the end is shown however soon it comes
            self._written_s, self._note = 0.0, ""
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
