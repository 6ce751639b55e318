"""Keeps freed memory in the process once large messages come.

By default glibc gives a freed block of this size back to the system, and each page of the next one has to be mapped and
cleared again. For messages of 1 MB that is more work than everything else together.
"""

import ctypes
import os

#: From this size on (bytes) glibc maps a block of its own.
LARGE = 128 * 1024
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_KEPT = 64 * 1024 * 1024
_is_kept = False


def keep_freed_memory() -> None:
    """Have glibc keep up to 64 MB, unless MALLOC_* variables are set in the environment."""
    global _is_kept
    if not _is_kept:
        _is_kept = True
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None and not any(name.startswith("MALLOC_") for name in os.environ):
            # glibc allows no threshold above 32 MB for blocks of their own.
            mallopt(_M_MMAP_THRESHOLD, _KEPT // 2)
            mallopt(_M_TRIM_THRESHOLD, _KEPT)
