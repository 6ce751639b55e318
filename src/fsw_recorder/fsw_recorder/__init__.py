"""Records, plays back, reads and recovers bags."""

from fsw_recorder.errors import BagError

__all__ = ["BagError"]
