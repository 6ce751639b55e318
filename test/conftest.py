"""The tests of whole welds are all slow.

Those of graphs that run against the clock run last, and by themselves.

Among the other tests of faults and those of the page at a weld each says so itself: most are in
lockstep.
"""

from pathlib import Path

import pytest

_HERE = Path(__file__).resolve().parent
_REAL_TIME = (
    "launch",
    "test_machine_chain.py",
    "test_machine_operator.py",
    "test_hmi_page_graph.py",
    "test_hmi_live_demo.py",
)


def pytest_collection_modifyitems(items):
    for item in items:
        if _HERE in item.path.parents:
            item.add_marker(pytest.mark.slow)
            if any(part in _REAL_TIME for part in item.path.relative_to(_HERE).parts):
                item.add_marker(pytest.mark.real_time)
