"""What the packages import is what their package.xml declares."""

import ast
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent for path in SOURCES.glob("fsw_*/package.xml") if path.parent.name != "fsw_msgs")
#: rosdep key by module, where it is not the module's name; mcap comes with mcap-ros2-support, zstandard with rosbags
KEYS = {
    "casadi": "casadi-pip",
    "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support",
    "numpy": "python3-numpy",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
    "zstandard": "python3-rosbags-pip",
}
#: other keys that rosdep knows, or packages of Jazzy, as of August 2026
KNOWN = {*KEYS.values(), "python3-hypothesis", "python3-pytest", "python3-pytest-timeout"}
KNOWN |= {"ament_cmake", "ament_index_python", "launch", "launch_ros", "launch_testing", "launch_testing_ros", "rclpy"}
KNOWN |= {"rosidl_default_generators", "rosidl_default_runtime", "rosidl_runtime_py", "ros2launch"}
KNOWN |= {f"{kind}_msgs" for kind in ("diagnostic", "rosgraph", "sensor", "std")}
KNOWN |= {f"{kind}_interfaces" for kind in ("builtin", "rcl", "rosbag2")}
#: done without where they are not installed; fsw_experiment imports fsw_recorder, which only asks it for controllers
OPTIONAL = {"lz4", "pyarrow", "rosidl_embedded", "rclpy_embedded"}
CIRCULAR = {("fsw_recorder", "fsw_experiment")}


def imported(folder):
    modules = set()
    for path in [*folder.rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules.add(node.module.partition(".")[0])
    return modules - set(sys.stdlib_module_names) - OPTIONAL


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_imports_are_declared(package):
    declared = {entry.text for entry in ElementTree.parse(package / "package.xml").getroot().iter("exec_depend")}
    folder = package / ("launch" if package.name == "fsw_bringup" else package.name)
    needed = {KEYS.get(m, m) for m in imported(folder) if m != package.name and (package.name, m) not in CIRCULAR}
    assert needed - declared == set()


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_has_what_ament_looks_for(package):
    assert (package / "resource" / package.name).is_file()
    setup = (package / "setup.cfg").read_text(encoding="utf-8")
    assert f"install_scripts=$base/lib/{package.name}" in setup
    name = ElementTree.parse(package / "package.xml").getroot().findtext("name")
    assert name == package.name


@pytest.mark.parametrize("package", [*PACKAGES, SOURCES / "fsw_msgs"], ids=lambda path: path.name)
def test_dependencies_are_known_to_rosdep_and_named_once(package):
    root = ElementTree.parse(package / "package.xml").getroot()
    entries = [(entry.tag, entry.text) for entry in root if entry.tag.endswith("depend")]
    assert len(entries) == len(set(entries))
    assert {key for _, key in entries} - KNOWN - {path.name for path in PACKAGES} - {"fsw_msgs"} == set()
