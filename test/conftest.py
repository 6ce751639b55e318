"""The tests of whole welds are all slow; those of graphs that run against the clock run last, and by themselves."""

from pathlib import Path

import pytest

_HERE = Path(__file__).resolve().parent
_REAL_TIME = ("faults", "launch", "machine", "test_hmi_page_graph.py", "test_hmi_live_demo.py", "test_hmi_weld.py")


def pytest_collection_modifyitems(items):
    for item in items:
        if _HERE in item.path.parents:
            item.add_marker(pytest.mark.slow)
            if any(part in _REAL_TIME for part in item.path.relative_to(_HERE).parts):
                item.add_marker(pytest.mark.real_time)
