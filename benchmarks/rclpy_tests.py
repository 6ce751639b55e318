"""rclpy's own tests, unmodified, on rclpy_embedded: how many pass, by file.

    git clone -b jazzy https://github.com/ros2/rclpy
    git clone -b jazzy https://github.com/ros2/rcl_interfaces
    python3 benchmarks/rclpy_tests.py rclpy/rclpy/test --fixtures rcl_interfaces/test_msgs/src

With ``--genuine``, in a shell where ROS 2 is sourced, its own rclpy is tested.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(dev=True)

from report import Figures, parser, save
from sides import WORKSPACE

from fsw_control.free_domain import free_domain

_TIMEOUT_S, _FILE_TIMEOUT_S = 60, 600


def outcomes(report: Path) -> dict[str, str]:
    """What became of each test of a file: passed, failed or skipped."""
    found: dict[str, str] = {}
    if not report.exists():
        return found
    for case in ElementTree.parse(report).getroot().iter("testcase"):
        kinds = {child.tag for child in case}
        failed = kinds & {"failure", "error"}
        name = f"{case.get('classname', '').rpartition('.')[2]}.{case.get('name', '')}"
        found[name] = "failed" if failed else "skipped" if "skipped" in kinds else "passed"
    return found


def run_file(file: Path, python: str, environ: dict[str, str]) -> dict[str, str]:
    """Run the tests of one file; a file that cannot be read or breaks off counts as one failure."""
    report = file.with_suffix(".xml")
    options = ["-q", "-p", "no:cacheprovider", "-c", os.devnull, f"--timeout={_TIMEOUT_S}", f"--junit-xml={report}"]
    command = [python, "-m", "pytest", *options, f"--rootdir={file.parent.parent}", str(file)]
    try:
        done = subprocess.run(
            command, cwd=file.parent.parent, env=environ, timeout=_FILE_TIMEOUT_S, capture_output=True, text=True
        )
        code, text = done.returncode, done.stdout
    except subprocess.TimeoutExpired as error:
        code, text = -1, str(error)
    file.with_suffix(".log").write_text(text, encoding="utf-8")
    found = outcomes(report)
    if "failed" not in found.values() and (code != 0 or not found):
        found["(the file breaks off)"] = "failed"
    return found


def main() -> int:
    """Run the tests, print the table and write the figures."""
    arguments = parser(__doc__, "one file, test_qos.py")
    arguments.add_argument("tests", type=Path, metavar="FOLDER", help="rclpy/rclpy/test of rclpy's repository")
    arguments.add_argument("--fixtures", type=Path, metavar="FOLDER", help="holds the Python package test_msgs")
    arguments.add_argument("--genuine", action="store_true", help="test the rclpy of the ROS 2 that is sourced")
    arguments.add_argument("--keep", type=Path, metavar="FOLDER", help="keep pytest's output of each file here")
    parsed = arguments.parse_args()
    paths = [str(parsed.fixtures.resolve())] if parsed.fixtures else []
    environ = dict(os.environ)
    if not parsed.genuine:
        paths.append(str(WORKSPACE / "runtime" / "rclpy_embedded"))
    elif "PYTHONPATH" in environ:
        paths.insert(0, environ["PYTHONPATH"])
    environ["PYTHONPATH"] = os.pathsep.join(paths)
    figures: Figures = {}
    total, passed = 0, 0
    with tempfile.TemporaryDirectory() as folder, free_domain() as domain:
        environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "0")  # genuine rclpy's default; the tests assign wrong types
        environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": folder}
        # away from the sources, whose folder rclpy beside the tests would be imported
        copy = shutil.copytree(parsed.tests, Path(folder) / "test")
        (copy / "__init__.py").write_text("", encoding="utf-8")  # it finds DLLs of rclpy's build
        for file in sorted(copy.glob("test_qos.py" if parsed.quick else "test_*.py")):
            found = run_file(file, sys.executable, environ)
            wrong = [name for name, what in found.items() if what == "failed"]
            good = sum(what == "passed" for what in found.values())
            total, passed = total + good + len(wrong), passed + good
            figures[file.stem] = {"passed": good, "failed": wrong}
            print(f"{file.stem:<40}{good:>5} of {good + len(wrong):>4}  {', '.join(wrong)}", flush=True)
            if parsed.keep:
                parsed.keep.mkdir(parents=True, exist_ok=True)
                shutil.copy(file.with_suffix(".log"), parsed.keep)
    print(f"{'all':<40}{passed:>5} of {total:>4}")
    save({"passed": passed, "total": total, "files": figures}, parsed.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
