"""Commands of ROS 2's tools in the documentation, which its wheels lack: what they name is here.

Names and types are those of a running graph, the launch file makes its nodes from the arguments,
and literals are messages. Requirements and folders are those of this workspace.
"""

import re
import shlex
import tomllib
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest
import rclpy
import yaml
from packaging.requirements import Requirement
from rclpy.action import get_action_names_and_types
from rclpy.parameter import Parameter

from fsw_control.controller_node import ControllerNode
from fsw_control.free_domain import free_domain
from fsw_decentral import DecentralController
from fsw_nmpc import NmpcController
from fsw_plant.plant_node import PlantNode
from fsw_recorder.recorder_node import RecorderNode
from fsw_scenario.scenario_node import ScenarioNode
from fsw_scenario.weld_programme_ros import serve
from fsw_supervisor.supervisor_node import SupervisorNode
from fsw_test_support import doc_blocks
from fsw_test_support.launch_modules import LAUNCH_FILE, launching

WORKSPACE = doc_blocks.WORKSPACE
PAGES = [WORKSPACE / "README.md", *sorted((WORKSPACE / "docs").rglob("*.md"))]
#: what pages write for a part of a command that they leave out
LEFT_OUT = "…"
#: what is only named, and a package of others
NAMED = re.compile(r"ros2 (bag \w+|\w+ \w+$(?<!nodes))")
FOREIGN = {"diagnostic_aggregator"}
VERBS = {
    "action": {"send_goal"},
    "service": {"call"},
    "topic": {"hz", "pub"},
    "param": {"describe", "set"},
    "lifecycle": {"nodes", "get", "set"},
}
TRANSITIONS = {"configure", "activate", "deactivate", "cleanup", "shutdown"}
OPTIONS = {"--feedback", "--once"}
#: folders of the workspace in a command, and what only a build on ROS 2 needs
PARTS, OF_ROS = r"(src|quality|lab|scripts|requirements)(/|$)", ("ros-jazzy-", "colcon-")


def commands():
    """Page and text of each command of ros2."""
    names = {
        (page.name, part)
        for page in PAGES
        for line in doc_blocks.lines_of(page.read_text("utf-8"))
        for part in re.split(r" +(?:;|&&|#) *", line)
        if re.match(r"ros2 \w+ \S", part) and not NAMED.match(part)
    }
    return sorted(names)


def checked():
    """Blocks that say that this file checks them."""
    mark = f"checked by: {Path(__file__).relative_to(WORKSPACE)}"
    return [b for page in doc_blocks.pages() for b in doc_blocks.blocks(page) if b.mark == mark]


class Graph:
    """A node of each program, beside a weld without phases."""

    def __init__(self):
        self.nodes = {
            f"/{node.get_name()}": node
            for node in (
                ControllerNode("decentral", DecentralController, DecentralController.parameters),
                ControllerNode("nmpc", NmpcController, NmpcController.parameters),
                PlantNode(),
                SupervisorNode(),
                RecorderNode(),
                ScenarioNode(""),
            )
        }
        self.nodes["/fsw_plant"].start()
        player = self.nodes["/fsw_scenario"]
        for name in ("hold", "resume"):
            serve(player, name, lambda: None)
        self.topics, self.services = (
            {name: types for name, types in names}
            for names in (
                player.get_topic_names_and_types(),
                player.get_service_names_and_types(),
            )
        )
        self.actions = dict(get_action_names_and_types(player))

    def refusal(self, words):
        """Why a command of ``ros2``, without this word, names what is not here; None if all is."""
        kind, verb, *rest = (word for word in words if word not in OPTIONS)
        if verb not in VERBS[kind]:
            return f"no verb {verb}"
        if kind == "topic":
            return None if rest[0] in self.topics else f"no topic {rest[0]}"
        if kind in ("action", "service"):
            known = self.actions if kind == "action" else self.services
            name, type_name, *literal = rest
            if known.get(name) != [type_name]:
                return f"{name}: {known.get(name)}"
            package, module, of = type_name.split("/")
            made = getattr(import_module(f"{package}.{module}"), of)
            part = made.Goal if kind == "action" else made.Request
            try:
                part(check_fields=True, **yaml.safe_load(" ".join(literal) or "{}"))
            except AssertionError as error:
                return f"{literal}: {error}"
            return None
        if not rest:
            return None
        node = self.nodes.get(f"/{rest[0].removeprefix('/')}")
        if node is None:
            return f"no node {rest[0]}"
        if kind == "lifecycle":
            unknown = {*rest[1:]} - TRANSITIONS
            managed = f"{node.get_fully_qualified_name()}/change_state" in self.services
            return None if managed and not unknown else f"{rest}: not managed, or {unknown}"
        if not node.has_parameter(rest[1]):
            return f"no parameter {rest[1]} of {rest[0]}"
        values = [Parameter(rest[1], value=yaml.safe_load(text)) for text in rest[2:]]
        refused = [
            result.reason for result in node.set_parameters(values) if not result.successful
        ]
        return refused[0] if refused else None

    def refused_program(self, package, executable, *words):
        """Why ``ros2 run`` cannot run a program; None if it can."""
        for folder, file in re.findall(
            r"\$\(ros2 pkg prefix --share (\w+)\)/(\S+)", " ".join(words)
        ):
            if not (WORKSPACE / "src" / folder / file).is_file():
                return f"no file {file}"
        if package in FOREIGN:
            return None
        if not has_program(package, executable):
            return f"no program {executable}"
        node = self.nodes[f"/fsw_{executable}"]
        for flag, word in pairwise(words):
            name = word.partition(":=")[0]
            if flag == "-p" and not node.has_parameter(name):
                return f"no parameter {name}"
            if flag == "-r" and name != "__node" and f"/{name}" not in self.topics:
                return f"no topic {name}"
        return None


@pytest.fixture(scope="module")
def graph():
    with free_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        rclpy.init(args=["--ros-args", "-p", "autostart:=false"])
        try:
            yield Graph()
        finally:
            rclpy.try_shutdown()


@pytest.fixture
def refusal(graph, monkeypatch, tmp_path):
    """Function: why a command cannot run; None if it can."""
    launch = launching(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)

    def launched(package, file, *words):
        if (package, file) != ("fsw", LAUNCH_FILE.name):
            return f"no launch file {file}"
        arguments = dict(word.split(":=") for word in words)
        for value in arguments.values():
            if value.endswith(".yaml"):
                Path(value).touch()  # the reader's
        try:
            launch(**arguments)
        except (ValueError, RuntimeError) as error:
            return str(error)
        return None

    def refused(text):
        words = shlex.split(text.partition(LEFT_OUT)[0], comments=True)[1:]
        if words[0] == "launch":
            return launched(*words[1:])
        return graph.refused_program(*words[1:]) if words[0] == "run" else graph.refusal(words)

    return refused


@pytest.mark.slow
@pytest.mark.parametrize(("page", "text"), commands())
def test_what_a_command_names_is_there(page, text, refusal):
    assert (why := refusal(text)) is None, f"{page}: {text}: {why}"


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "ros2 launch fsw weld.launch.py no_such_argument:=true",
        "ros2 launch fsw weld.launch.py record:=perhaps",
        "ros2 launch fsw weld.launch.py scenario:=no_such_scenario",
        "ros2 launch fsw no_such.launch.py",
        "ros2 run fsw_nmpc no_such_program",
        "ros2 run fsw_nmpc nmpc --ros-args -p no_such_parameter:=1",
        "ros2 run fsw_nmpc nmpc --ros-args -r fsw/no_such_topic:=x",
        "ros2 topic hz /fsw/no_such_topic",
        "ros2 param describe /fsw_nmpc no_such_parameter",
        "ros2 param describe /fsw_no_such_node preset",
        "ros2 param set /fsw_nmpc temperature_aggressiveness -1.0",
        "ros2 service call /fsw/weld/no_such_service fsw_msgs/srv/OperatorRequest",
        "ros2 service call /fsw/weld/hold fsw_msgs/srv/SetMode",
        'ros2 service call /fsw/plant/reset fsw_msgs/srv/ResetPlant "{seed: many}"',
        'ros2 action send_goal /fsw/run_weld fsw_msgs/action/RunWeld "{no_such_field: quick}"',
        "ros2 lifecycle set /fsw_recorder no_such_transition",
        "ros2 lifecycle get /fsw_nmpc",
    ],
)
def test_a_wrong_command_would_be_found(text, refusal):
    assert refusal(text)


def has_program(package, executable):
    """Whether a package of the workspace installs a program."""
    scripts = [
        path.read_text("utf-8").partition('"console_scripts"')[2].partition("]")[0]
        for path in WORKSPACE.glob(f"*/{package}/setup.py")
    ]
    return any(f'"{executable} = ' in text for text in scripts)


def required():
    """Names of what the distributions require, with their extras."""
    for folder in ("", "quality", "lab"):
        project = tomllib.loads((WORKSPACE / folder / "pyproject.toml").read_text())["project"]
        extras = project["optional-dependencies"].values()
        for text in (
            *project["dependencies"],
            *(requirement for extra in extras for requirement in extra),
        ):
            yield Requirement(text).name


def refused_line(line):
    """Why a line of a block that does not call ``ros2`` names what is not here; None if all is."""
    program, *words = shlex.split(line.partition(" && ")[0], comments=True)
    files = [word for word in words if re.match(PARTS, word)]
    if missing := [name for name in files if not (WORKSPACE / name).exists()]:
        return f"not there: {missing}"
    if program == "pip":
        names = {re.match(r"[\w-]*", word)[0] for word in words[1:] if word not in files} - {"-r"}
        other = {name for name in names - {*required()} if not name.startswith(OF_ROS)}
        return f"not required: {other}" if other else None
    if program.startswith("install/"):
        _, package, *_, executable = program.split("/")
        return None if has_program(package, executable) else f"no program {program}"
    # test_documents.py parses those of fsw.py
    known = ("ros2", "fsw.py", "rosdep", "colcon", "python", "python3")
    return None if program in known else f"nothing checks {program}"


@pytest.mark.parametrize("block", checked(), ids=str)
def test_other_lines_of_checked_blocks(block):
    faults = {line: refused_line(line) for line in block.code.splitlines()}
    assert not any(faults.values()), faults


@pytest.mark.parametrize(
    "line",
    [
        "pip install no_such_package",
        "pip install -r requirements/no_such.lock",
        "colcon build --base-paths src/no_such_folder",
        "install/fsw/lib/fsw/no_such_program",
        "rm x",
    ],
)
def test_a_wrong_line_would_be_found(line):
    assert refused_line(line)
