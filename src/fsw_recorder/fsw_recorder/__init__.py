"""Recording, playback, reading and recovery of bags."""

from fsw_recorder.errors import BagError

__all__ = ["BagError"]
