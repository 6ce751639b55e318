"""Three distributions, one direction.

The core knows nothing of quality and lab, which register what they add.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fsw_control.schema.extensions import extensions, loaded

WORKSPACE = Path(__file__).resolve().parents[1]
#: what each distribution may use, from its folder
ABOVE = {"src": (), "quality": ("src",), "lab": ("src", "quality")}
PROJECTS = {
    "src": WORKSPACE / "pyproject.toml",
    "quality": WORKSPACE / "quality" / "pyproject.toml",
    "lab": WORKSPACE / "lab" / "pyproject.toml",
}
GROUPS = (
    "fsw.commands",
    "fsw.nodes",
    "fsw.controllers",
    "fsw.processes",
    "fsw.pages",
    "fsw.record_hooks",
    "fsw.schemas",
    "fsw.api",
)


def packages(folder: str) -> set[str]:
    studies = {path.parent.name for path in (WORKSPACE / folder / "studies").glob("*/__init__.py")}
    return {path.parent.name for path in (WORKSPACE / folder).glob("*/package.xml")} | studies


FOREIGN = {
    folder: set().union(
        *(packages(other) for other in ABOVE if other != folder and other not in above)
    )
    for folder, above in ABOVE.items()
}


def named(source: str) -> Iterator[str]:
    """Top-level packages that a module imports anywhere, or names in a string such as ``fsw_hmi.main``."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]
        elif name := re.fullmatch(r"(fsw_\w+)([.:][\w.:]+)?", str(getattr(node, "value", ""))):
            yield name[1]


def sources(folder: str) -> list[Path]:
    files = (WORKSPACE / folder).rglob("*.py")
    return [
        path for path in sorted(files) if "test" not in path.relative_to(WORKSPACE / folder).parts
    ]


@pytest.mark.parametrize("folder", ABOVE)
def test_a_distribution_names_only_those_above_it(folder: str) -> None:
    files = sources(folder)
    assert len(files) > 20
    imported = {
        path.relative_to(WORKSPACE): FOREIGN[folder] & {*named(path.read_text("utf-8"))}
        for path in files
    }
    assert {path: names for path, names in imported.items() if names} == {}


@pytest.mark.parametrize(
    "text",
    [
        "import fsw_lab.tasks",
        "from fsw_quality import record",
        "def f():\n    from fsw_quality.record import make",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import fsw_heat",
        "import_module('fsw_lab.tasks')",
        "NODE = 'fsw_quality.monitor_node:main'",
        "PACKAGE = 'fsw_quality'",
    ],
)
def test_no_way_to_name_another_one_escapes(text: str) -> None:
    assert FOREIGN["src"] & {*named(text)}


def registered(folder: str) -> dict[str, dict[str, str]]:
    points: dict[str, Any] = tomllib.loads(PROJECTS[folder].read_text("utf-8"))["project"][
        "entry-points"
    ]
    return points


def of_setup(folder: str) -> dict[str, dict[str, str]]:
    """Entry points of our groups by the packages' setup.py, each of which registers what it has itself."""
    groups: dict[str, dict[str, str]] = {}
    for file in (WORKSPACE / folder).glob("*/setup.py"):
        calls = [
            node
            for node in ast.walk(ast.parse(file.read_text("utf-8")))
            if isinstance(node, ast.Call)
        ]
        [call] = [node for node in calls if getattr(node.func, "id", "") == "setup"]
        points = next(
            (ast.literal_eval(word.value) for word in call.keywords if word.arg == "entry_points"),
            {},
        )
        for group in points.keys() - {"console_scripts"}:
            for name, value in (map(str.strip, point.split("=")) for point in points[group]):
                assert re.split("[.:]", value)[0] == file.parent.name
                assert groups.setdefault(group, {}).setdefault(name, value) == value
    return groups


@pytest.mark.parametrize("folder", PROJECTS)
def test_pyproject_and_setup_register_the_same(folder: str) -> None:
    assert of_setup(folder) == registered(folder)


@pytest.mark.parametrize("group", GROUPS)
def test_all_that_is_registered_is_seen_here_and_can_be_loaded(group: str) -> None:
    expected = {
        name: value
        for folder in PROJECTS
        for name, value in registered(folder).get(group, {}).items()
    }
    assert (
        expected
        and expected.items()
        <= {name: point.value for name, point in extensions(group).items()}.items()
    )
    assert all(loaded(group, name) is not None for name in expected)


def test_no_group_is_unknown() -> None:
    assert {group for folder in PROJECTS for group in registered(folder)} == set(GROUPS)


def test_each_registered_node_has_its_script() -> None:
    """All are links to the script that runs the node that it is called by."""
    scripts = {path.stem: path for path in WORKSPACE.glob("scripts/run_*.py")}
    assert scripts.pop("run_machine_server").is_file()
    assert {*scripts} == {f"run_{name}" for name in extensions("fsw.nodes")}
    assert {path.readlink().name for path in scripts.values()} == {"_run.py"}


def extras() -> dict[tuple[str, str], str]:
    """Distribution and name of each extra that the sources ask for, and where."""
    calls = [
        (path, node)
        for folder in ABOVE
        for path in sources(folder)
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Extra"
    ]
    return {
        tuple(ast.literal_eval(word) for word in node.args[:2]): str(path) for path, node in calls
    }


def test_each_extra_is_declared_by_its_distribution_and_has_a_lock_for_clones() -> None:
    projects = [tomllib.loads(file.read_text("utf-8"))["project"] for file in PROJECTS.values()]
    declared = {
        (project["name"], extra)
        for project in projects
        for extra in project["optional-dependencies"]
    }
    for project in projects:
        *extras_of_it, last = project["optional-dependencies"]
        everything = project["optional-dependencies"][last]
        assert last == "all" and everything == [f"{project['name']}[{','.join(extras_of_it)}]"]
    known = extras()
    assert len(known) >= 8
    assert known.keys() - declared == set()
    assert [
        name for _, name in known if not (WORKSPACE / "requirements" / f"{name}.lock").is_file()
    ] == []
