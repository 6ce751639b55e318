"""The command line of a node: parameters that it does not have, and its help."""

import os
import re
from typing import Annotated, Literal

import pytest

from fsw_control.node_arguments import NodeArguments, asks_for_help
from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import InputError, Model
from fsw_control.schema.ranges import Range


class Loop(Model):
    """A group."""

    gain: float = 1.0
    """How strong."""


class Example(NodeParameters):
    """Parameters of a node."""

    deadline: Annotated[float, Range(0.001, 1.0, "s")] = 0.03
    """Wait so long."""
    loop: Loop = Loop()
    kind: Annotated[Literal["a", "b"], AT_START] = "a"
    """Which."""


ARGUMENTS = NodeArguments("fsw_one", "One of the nodes.", Example, "[FILE]")


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["-p", "deadline:=1.0", "--param", "fsw_one:loop.gain:=2.0", "-p", "use_sim_time:=true"],
        ["-p", "fsw_other:nmae:=1", "-p", "qos_overrides./fsw/depth.subscription.depth:=3"],
        ["-r", "nmae:=name", "--log-level", "nmae:=info"],
        ["-p", "deadline:=1.0", "--", "-p", "nmae:=1"],
        ["--params-file", "/nowhere/at/all.yaml"],
    ],
)
def test_what_is_taken(words):
    ARGUMENTS.check(["program", "--ros-args", *words])


@pytest.mark.parametrize(
    "words",
    [
        ["-p", "dedaline:=1"],
        ["--param", "/fsw_one:dedaline:=1"],
        ["-p", "/**:dedaline:=1"],
        ["-r", "__node:=renamed", "-p", "renamed:dedaline:=1"],
    ],
)
def test_wrong_names_are_refused(words):
    with pytest.raises(InputError, match=r"parameters dedaline; .* deadline"):
        ARGUMENTS.check(["program", "--ros-args", *words])


@pytest.mark.parametrize(
    ("content", "wrong"),
    [
        ("/**/fsw_one: {ros__parameters: {loop: {gian: 1.0}}}", r"parameters loop\.gian"),
        ("hall: {fsw_one: {ros__parameters: {dedaline: 1.0, kind: a}}}", "parameters dedaline"),
        ("fsw_other: {ros__parameters: {dedaline: 1.0}}", ""),
        ("/**: {ros__parameters: {dedaline: 1.0}}", ""),
        ("fsw_one: {ros__parameters: {loop: {gain: 1.0}, deadline: 1e-1}}", ""),
        ("[no, parameter, file", "valid YAML"),
        ("a: &a [*a]", "alias .a "),
    ],
)
def test_files(tmp_path, content, wrong):
    path = tmp_path / "parameters.yaml"
    path.write_text(content)
    words = ["program", "--ros-args", "--params-file", str(path)]
    if not wrong:
        ARGUMENTS.check(words)
        return
    with pytest.raises(InputError, match=wrong):
        ARGUMENTS.check(words)


@pytest.mark.timeout(30)
def test_a_pipe_of_parameters_is_refused_before_ros_would_wait_for_it(tmp_path):
    pipe = tmp_path / "parameters.yaml"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match=r"parameters\.yaml: not a regular"):
        ARGUMENTS.check(["program", "--ros-args", "--params-file", str(pipe)])


def test_help():
    assert asks_for_help(["program", "--help"]) and asks_for_help(
        ["program", "file", "-h", "--ros-args"]
    )
    assert not asks_for_help(["--help"]) and not asks_for_help(["program", "--ros-args", "--help"])
    text = ARGUMENTS.help("run_one.py")
    assert text.startswith("usage: run_one.py [FILE] ")
    deadline, kind = (
        re.search(rf"^ +{name}  \((.*)\)$", text, re.M)[1] for name in ("deadline", "kind")
    )
    assert deadline.split("; ") == ["double", "default 0.03 s", "0.001 to 1 s"]
    assert kind.split("; ")[:3] == ["string", "default a", "one of a, b"]
