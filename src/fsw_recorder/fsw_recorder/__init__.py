"""Recorder, replayer, salvage and analysis of weld bags."""

from fsw_recorder.errors import BagError

__all__ = ["BagError"]
