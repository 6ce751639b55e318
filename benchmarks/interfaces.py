"""Definitions and CDR of messages: rosidl_embedded next to rosbags, in CPU time, the least of several runs.

usage: interfaces.py [--quick] [--json FILE]
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(dev=True)

from report import Figures, parser, save, show
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rosidl_embedded.catalogue import message_text
from rosidl_embedded.parser import parse_structure
from rosidl_embedded.typesupport import get_message, type_support

IMPORT = "import time; t = time.process_time(); import {}; print(time.process_time() - t)"


def least_us(function: Callable[[], Any], runs: int) -> float:
    """Least CPU time of a call, in microseconds; each run takes some ten milliseconds."""
    start = time.process_time_ns()
    function()
    count = max(1, 20_000_000 // (time.process_time_ns() - start + 1000))
    found = []
    for _ in range(runs):
        start = time.process_time_ns()
        for _ in range(count):
            function()
        found.append((time.process_time_ns() - start) / count / 1e3)
    return min(found)


def samples() -> dict[str, Any]:
    """Return messages by what is said of them in the table."""
    value = get_message("diagnostic_msgs/KeyValue")(key="depth", value="0.2")
    status = get_message("diagnostic_msgs/DiagnosticStatus")(name="plant", values=[value] * 5)
    return {
        "String, 60 characters": get_message("std_msgs/String")(data="x" * 60),
        "PoseStamped": get_message("geometry_msgs/PoseStamped")(),
        "JointState of 3 joints": get_message("sensor_msgs/JointState")(name=["a", "b", "c"], position=[1.0, 2.0, 3.0]),
        "DiagnosticArray of 25 values": get_message("diagnostic_msgs/DiagnosticArray")(status=[status] * 5),
        "Image, 1 MB": get_message("sensor_msgs/Image")(data=bytes(1_000_000)),
    }


def coding(what: str, message: Any, store: Any, runs: int) -> Figures:
    """Figures of a message, written and read."""
    support = type_support(type(message))
    name, data = support.type_name, support.serialize(message)
    read = store.deserialize_cdr(data, name)
    return {
        f"{what}: write, own [us]": least_us(lambda: support.serialize(message), runs),
        f"{what}: write, rosbags [us]": least_us(lambda: store.serialize_cdr(read, name), runs),
        f"{what}: read, own [us]": least_us(lambda: support.deserialize(data), runs),
        f"{what}: read, rosbags [us]": least_us(lambda: store.deserialize_cdr(data, name), runs),
    }


def main() -> int:
    """Measure, print the table and write the figures."""
    parsed = parser(__doc__, "fewer runs").parse_args()
    runs = 3 if parsed.quick else 15
    figures: Figures = {}
    for module in ("rosidl_embedded.typesupport", "rosbags.typesys"):
        seconds = [float(subprocess.check_output([sys.executable, "-c", IMPORT.format(module)])) for _ in range(runs)]
        figures[f"import {module} [ms]"] = min(seconds) * 1e3
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    texts = {name: message_text(name) for name in jazzy.fielddefs}
    own = least_us(lambda: [parse_structure(text, name, "") for name, text in texts.items()], runs)
    other = least_us(lambda: [get_types_from_msg(text, name) for name, text in texts.items()], runs)
    figures |= {f"{len(texts)} definitions, own [ms]": own / 1e3, "the same, rosbags [ms]": other / 1e3}
    for what, message in samples().items():
        figures |= coding(what, message, jazzy, runs)
    show(figures)
    save(figures, parsed.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
