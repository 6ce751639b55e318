"""Malformed data from the network: counted, and logged once per place."""

import threading
from collections import Counter

from rclpy.logging import get_logger

counts: Counter[str] = Counter()
_lock = threading.Lock()


def count(place: str, text: str) -> None:
    """Count a fault at a place (a topic or service) and log the first one there."""
    with _lock:
        counts[place] += 1
        first = counts[place] == 1
    if first:
        get_logger("rclpy_embedded").warning(f"dropped {text} (further ones on '{place}' are counted only)")
