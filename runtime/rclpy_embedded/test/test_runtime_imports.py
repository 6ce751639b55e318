"""The modules of the runtime import each other without circles, counting imports inside functions and for types."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def modules(root: Path, *packages: str) -> dict[str, Path]:
    """Return the modules of packages by name."""
    found = {}
    for path in (path for package in packages for path in (root / package).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def import_graph(known: dict[str, Path]) -> dict[str, set[str]]:
    """Return which of the modules each of them imports, wherever the import stands."""
    graph: dict[str, set[str]] = {}
    for name, path in known.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        imported: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                parents = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
                source = ".".join([*parents, *([node.module] if node.module else [])])
                names = {f"{source}.{alias.name}" for alias in node.names}
                imported |= (names & known.keys()) or {source}
        graph[name] = (imported & known.keys()) - {name}
    return graph


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return one circle of the graph, an empty list if there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_there_is_no_circle() -> None:
    graph = import_graph(modules(ROOT, "rclpy", "rosidl_embedded"))
    assert len(graph) > 60
    assert "rclpy.impl.session" in graph["rclpy.context"]
    assert circle(graph) == []


def test_interfaces_do_not_know_the_client_library() -> None:
    graph = import_graph(modules(ROOT, "rclpy", "rosidl_embedded"))
    below = {name: imported for name, imported in graph.items() if name.startswith("rosidl_embedded")}
    assert not {name for imported in below.values() for name in imported if name.startswith("rclpy")}


@pytest.mark.parametrize(
    "source",
    [
        "from pkg import b",
        "import pkg.b",
        "from .b import x",
        "from . import b",
        "def f():\n    from pkg.b import x",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import pkg.b",
    ],
)
def test_every_kind_of_import_counts(source: str, tmp_path: Path) -> None:
    (tmp_path / "pkg").mkdir()
    for name, text in (("__init__", ""), ("a", source), ("b", "import pkg.a")):
        (tmp_path / "pkg" / f"{name}.py").write_text(text)
    assert set(circle(import_graph(modules(tmp_path, "pkg")))) == {"pkg.a", "pkg.b"}
