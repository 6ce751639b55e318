"""The packages of the workspace.

What they import is what their package.xml says, and every arrow points down.
"""

import ast
import re
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest
import yaml

import fsw
from fsw_control import weld
from fsw_control.parameters import defaults
from fsw_control.sensors import SENSORS
from fsw_model import STEP_S, ProcessModel, nominal
from fsw_plant.parameters import PlantParameters

WORKSPACE = Path(__file__).resolve().parents[1]
SOURCES = WORKSPACE / "src"
PACKAGES = sorted(
    path.parent
    for folder in ("src", "quality", "lab")
    for path in (WORKSPACE / folder).glob("fsw*/package.xml")
    if path.parent.name != "fsw_msgs"
)
#: which packages of this project each may import, all of them above it in this list
MAY_IMPORT = {
    "fsw_msgs": set(),
    "fsw_control": {"fsw_msgs"},
    "fsw_model": {"fsw_control"},
    "fsw_nmpc": {"fsw_model", "fsw_control"},
    "fsw_decentral": {"fsw_control"},
    "fsw_plant": {"fsw_model", "fsw_control", "fsw_msgs"},
    "fsw_machine": {"fsw_model", "fsw_control", "fsw_msgs"},
    "fsw_supervisor": {"fsw_control", "fsw_model", "fsw_msgs"},
    "fsw_recorder": {"fsw_control"},
    "fsw_analysis": {"fsw_recorder", "fsw_control", "fsw_model"},
    "fsw_hmi": {
        "fsw_control",
        "fsw_model",
        "fsw_analysis",
        "fsw_recorder",
        "fsw_msgs",
    },
    "fsw_scenario": {
        "fsw_model",
        "fsw_control",
        "fsw_nmpc",
        "fsw_decentral",
        "fsw_plant",
        "fsw_supervisor",
        "fsw_recorder",
        "fsw_analysis",
        "fsw_msgs",
    },
    "fsw": {
        "fsw_model",
        "fsw_control",
        "fsw_nmpc",
        "fsw_decentral",
        "fsw_plant",
        "fsw_supervisor",
        "fsw_recorder",
        "fsw_analysis",
        "fsw_scenario",
        "fsw_msgs",
        "fsw_hmi",  # of fsw_hmi: its named users
    },
    "fsw_quality": {
        "fsw_analysis",
        "fsw_control",
        "fsw_hmi",
        "fsw_model",
        "fsw_recorder",
        "fsw_scenario",
        "fsw_msgs",
        "fsw",
    },
    "fsw_identification": {"fsw_analysis", "fsw_control", "fsw_model"},
    "fsw_heat": {"fsw_control", "fsw_plant", "fsw_analysis"},
    "fsw_tuning": {
        "fsw_model",
        "fsw_control",
        "fsw_decentral",
        "fsw_plant",
        "fsw_analysis",
        "fsw_scenario",
        "fsw_identification",
    },
    "fsw_export": {
        "fsw_model",
        "fsw_control",
        "fsw_nmpc",
        "fsw_decentral",
        "fsw_plant",
        "fsw_analysis",
        "fsw_scenario",
    },
    "fsw_campaign": {
        "fsw_control",
        "fsw_plant",
        "fsw_recorder",
        "fsw_analysis",
        "fsw_scenario",
    },
    "fsw_lab": {
        "fsw_model",
        "fsw_control",
        "fsw_nmpc",
        "fsw_decentral",
        "fsw_plant",
        "fsw_recorder",
        "fsw_analysis",
        "fsw_scenario",
        "fsw_msgs",
        "fsw",
        "fsw_identification",
        "fsw_heat",
        "fsw_tuning",
        "fsw_export",
        "fsw_campaign",
    },
}
#: rosdep key by module, where it is not the module's name; mcap requires lz4 and zstandard
KEYS = {
    "casadi": "casadi-pip",
    "cffi": "python3-cffi",
    "cryptography": "python3-cryptography",
    "jinja2": "python3-jinja2",
    "lz4": "mcap-ros2-support",
    "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support",
    "mcap_ros2": "mcap-ros2-support",
    "hypothesis": "python3-hypothesis",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
    "zstandard": "mcap-ros2-support",
}
#: other keys that rosdep knows, or packages of Jazzy, as of August 2026
KNOWN = {
    *KEYS.values(),
    "python3-pytest-timeout",
    "ament_cmake",
    "ament_index_python",
    "ros2launch",
}
KNOWN |= {"launch", "launch_ros", "launch_testing", "launch_testing_ros", "rclpy"}
KNOWN |= {"rosidl_default_generators", "rosidl_default_runtime", "rosidl_runtime_py"}
KNOWN |= {
    f"{kind}_msgs"
    for kind in (
        "action",
        "diagnostic",
        "geometry",
        "nav",
        "rosgraph",
        "sensor",
        "std",
        "visualization",
    )
}
KNOWN |= {"std_srvs", "action_msgs", "lifecycle_msgs"}
KNOWN |= {f"{kind}_interfaces" for kind in ("builtin", "example", "rcl", "rosbag2")}
_TAGS = ("exec_depend", "depend")
#: what the tests of this repository share; and extras that only
#: one command needs, of which rosdep has not all; pydantic comes by pip, as Ubuntu has version 1
OPTIONAL = {
    "pydantic",
    "pydantic_core",
    "fsw_test_support",
    "dask",
    "distributed",
    "markdown_it",
    "pyarrow",
    "fmpy",
    "asyncua",
    "argon2",
    "starlette",
    "uvicorn",
    "websockets",
    "skfem",
    "meshio",
    "threadpoolctl",
    "fpdf",
    "securesystemslib",
    "pandas",
    "xarray",
    "control",
    "do_mpc",
    "gymnasium",
    "shtab",
}


def modules(folder: Path) -> Iterator[tuple[str, str, bool]]:
    """File, imported module and whether it is imported when the file is, for every import, also inside functions."""
    for path in folder.rglob("*.py"):
        name = ".".join(path.relative_to(folder.parent).with_suffix("").parts).removesuffix(
            ".__init__"
        )
        for module, at_import in imports(path.read_text(encoding="utf-8")):
            yield name, module, at_import


@cache
def imports(source: str) -> tuple[tuple[str, bool], ...]:
    """Imported modules of a source text, and whether each is imported when the file is, or for its types only."""
    tree, listed = ast.parse(source), []
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
    }
    for node in ast.walk(tree):
        at_import = id(node) not in inside
        if isinstance(node, ast.Import):
            listed += [(alias.name, at_import) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            listed += [(f"{node.module}.{alias.name}", at_import) for alias in node.names]
    return tuple(listed)


def imported(folder: Path) -> set[str]:
    """Top-level packages that the files of a folder import, but for the standard library and their own."""
    packages = {module.partition(".")[0] for _, module, _ in modules(folder)}
    local = {path.stem for path in folder.rglob("*.py")}
    return packages - set(sys.stdlib_module_names) - OPTIONAL - (local - {"rclpy"})


def uses(package: Path) -> set[str]:
    """What a package imports, its launch files included."""
    return (imported(package / package.name) | imported(package / "launch")) - {package.name}


def declared(package: Path, *tags: str) -> set[str]:
    root = ElementTree.parse(package / "package.xml").getroot()
    return {entry.text or "" for entry in root if entry.tag in tags}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_xml_says_what_is_imported(package: Path) -> None:
    needed = {KEYS.get(module, module) for module in uses(package)}
    declared_names = declared(package, *_TAGS)
    started = {
        "fsw": {"fsw_decentral", "fsw_machine", "fsw_nmpc", "fsw_supervisor", "ros2launch"},
        "fsw_control": {row.message_type.partition("/")[0] for row in SENSORS.values()},
        "fsw_scenario": {"fsw_nmpc", "fsw_decentral", "fsw_supervisor", "fsw_hmi", "fsw_recorder"},
    }
    assert needed - declared_names == set()
    assert declared_names - needed - started.get(package.name, set()) == set()


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_xml_says_what_the_tests_import(package: Path) -> None:
    used = imported(package / "test")
    tools = {"python3-pytest-timeout"}  # imported by nobody; pyproject.toml sets the time
    if package.name == "fsw":
        used |= imported(SOURCES.parent / "test" / "launch")
        tools |= {"launch_testing_ros"}  # of `launch_test` for nodes
    used -= {package.name, *(path.stem for path in package.glob("*.py"))}
    needed = {KEYS.get(module, module) for module in used} | tools
    assert needed - declared(package, *_TAGS, "test_depend") == set()
    assert declared(package, "test_depend") - needed == set()


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_xml_says_what_setup_imports(package: Path) -> None:
    source = (package / "setup.py").read_text(encoding="utf-8")
    used = {module.partition(".")[0] for module, _ in imports(source)} - set(
        sys.stdlib_module_names
    )
    used -= {"setuptools", *(path.stem for path in package.glob("*.py"))}
    assert used == declared(package, "depend", "build_depend")


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_arrows_point_down(package: Path) -> None:
    used = {module for module in uses(package) if module.startswith("fsw")}
    assert used - MAY_IMPORT[package.name] == set()
    order = list(MAY_IMPORT)
    assert used <= set(order[: order.index(package.name)])


def test_the_table_for_contributors_lists_the_packages_in_this_order() -> None:
    table = (SOURCES.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(?:src|quality|lab)/(fsw\w*)` \|", table, re.MULTILINE)
    assert set(listed) == set(MAY_IMPORT) == {"fsw_msgs", *(path.name for path in PACKAGES)}
    for number, name in enumerate(listed):
        assert MAY_IMPORT[name] <= set(listed[:number]), name


def circle(edges: Mapping[str, set[str]]) -> list[str]:
    """Names that lead back to the first of them along the edges; empty where nothing does."""
    clear: set[str] = set()

    def visit(name: str, path: list[str]) -> list[str]:
        if name in path:
            return [*path[path.index(name) :], name]
        if name in clear:
            return []
        for other in sorted(edges.get(name, ())):
            if closed := visit(other, [*path, name]):
                return closed
        clear.add(name)
        return []

    return next((closed for name in sorted(edges) if (closed := visit(name, []))), [])


def module_edges(folder: Path, only_at_import: bool) -> dict[str, set[str]]:
    """For each module of a folder, which others of it are imported there."""
    names = {
        ".".join(path.relative_to(folder.parent).with_suffix("").parts).removesuffix(".__init__")
        for path in folder.rglob("*.py")
    }
    edges: dict[str, set[str]] = {name: set() for name in names}
    for source, module, at_import in modules(folder):
        target = module if module in names else module.rpartition(".")[0]
        if target in names and target != source and (at_import or not only_at_import):
            edges[source].add(target)
    return edges


def folder_edges(folder: Path) -> dict[str, set[str]]:
    """For each folder in a package, which others of it are imported there, also inside functions."""
    packages = {
        ".".join(path.parent.relative_to(folder.parent).parts) for path in folder.rglob("*.py")
    }
    edges: dict[str, set[str]] = {}
    for source, targets in module_edges(folder, only_at_import=False).items():
        own, *others = (
            name if name in packages else name.rpartition(".")[0] for name in (source, *targets)
        )
        edges.setdefault(own, set()).update(set(others) - {own})
    return edges


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_no_circle_between_modules(package: Path) -> None:
    assert circle(module_edges(package / package.name, only_at_import=True)) == []


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_no_circle_between_a_package_and_its_sub_packages(package: Path) -> None:
    """Not even one that an import inside a function hides."""
    assert circle(folder_edges(package / package.name)) == []


def test_a_circle_of_sub_packages_would_be_found(tmp_path: Path) -> None:
    outer, cli = tmp_path / "outer", tmp_path / "outer" / "cli"
    cli.mkdir(parents=True)
    for path in (outer / "__init__.py", cli / "__init__.py"):
        path.touch()
    (outer / "tune.py").write_text("from outer.cli.errors import CommandError\n")
    (cli / "errors.py").touch()
    (cli / "main.py").write_text("def main():\n    from outer.tune import tune\n")
    assert circle(module_edges(outer, only_at_import=False)) == []
    assert circle(folder_edges(outer)) == ["outer", "outer.cli", "outer"]
    (cli / "main.py").write_text("")
    assert circle(folder_edges(outer)) == []


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_has_what_ament_and_colcon_look_for(package: Path) -> None:
    """Without the extra ``test``, ``colcon test`` runs no test at all and says OK."""
    assert (package / "resource" / package.name).is_file()
    assert f"Changelog for package {package.name}\n" in (package / "CHANGELOG.rst").read_text(
        encoding="utf-8"
    )
    assert (package / "README.md").is_file()
    assert 'extras_require={"test": ["pytest"]}' in (package / "setup.py").read_text(
        encoding="utf-8"
    )
    assert f"install_scripts=$base/lib/{package.name}" in (package / "setup.cfg").read_text(
        encoding="utf-8"
    )
    assert ElementTree.parse(package / "package.xml").getroot().findtext("name") == package.name


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_nodes_start_quietly_and_their_entry_points_exist(package: Path) -> None:
    """A node's entry point imports nothing before a Ctrl-C is taken care of (``fsw_control.schema.entry``)."""
    setup = (package / "setup.py").read_text(encoding="utf-8").replace("{PACKAGE}", package.name)
    scripts = re.search(r'"console_scripts": \[.*?\]', setup, re.DOTALL)
    scripts_found = re.findall(r'"[a-z_]+ = ([\w.]+):([\w.]+)"', scripts[0] if scripts else "")
    for module, path in scripts_found:
        if module == "fsw_control.schema.entry":
            file, function = path.rpartition(".")[::2]
            module, path = file, function
        else:
            assert module == "fsw.__main__", f"{module}:{path} is no node's"
        name = module.replace(".", "/")
        candidates = [package / f"{name}.py", package / name / "__init__.py"]
        [source] = [candidate for candidate in candidates if candidate.is_file()]
        assert re.search(rf"\b{path}\b", source.read_text(encoding="utf-8"))


@pytest.mark.parametrize("package", [*PACKAGES, SOURCES / "fsw_msgs"], ids=lambda path: path.name)
def test_package_xml_agrees_with_pyproject(package: Path) -> None:
    project = tomllib.loads((SOURCES.parent / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]
    root = ElementTree.parse(package / "package.xml").getroot()
    for tag in ("maintainer", "author"):
        assert [{"name": element.text} for element in root.findall(tag)] == project[f"{tag}s"]
    assert root.findtext("license") == project["license"]
    assert root.findtext("url") == project.get("urls", {}).get("Homepage")


def test_the_version_is_the_same_everywhere() -> None:
    versions = {
        "CITATION.cff": yaml.safe_load((SOURCES.parent / "CITATION.cff").read_text("utf-8"))[
            "version"
        ]
    }
    for package in [*PACKAGES, SOURCES / "fsw_msgs"]:
        versions[str(package)] = ElementTree.parse(package / "package.xml").findtext("version")
    for path in (package / "setup.py" for package in PACKAGES):
        versions[str(path)] = re.search(r'version="(.*)"', path.read_text("utf-8"))[1]
    changes = (SOURCES.parent / "CHANGELOG.md").read_text(encoding="utf-8")
    versions["CHANGELOG.md"] = re.search(r"^## \[(.*)\]", changes, re.MULTILINE)[1]
    assert len(versions) >= 2 * len(PACKAGES)
    assert {
        name: version for name, version in versions.items() if version != fsw.__version__
    } == {}


@pytest.mark.parametrize("package", [*PACKAGES, SOURCES / "fsw_msgs"], ids=lambda path: path.name)
def test_dependencies_are_known_to_rosdep_and_named_once(package: Path) -> None:
    root = ElementTree.parse(package / "package.xml").getroot()
    entries = [(entry.tag, entry.text) for entry in root if entry.tag.endswith("depend")]
    assert len(entries) == len(set(entries))
    assert {key for _, key in entries} - KNOWN - {path.name for path in PACKAGES} - {
        "fsw_msgs"
    } == set()


def test_numbers_of_the_weld_are_those_of_the_model_and_of_the_plant() -> None:
    """``fsw_control`` must not import the model, and a rate is not a step.

    The same facts in other words.
    """
    model, plant = nominal(), defaults(PlantParameters)
    assert weld.TICK_S == STEP_S
    assert (model.operating_depth_mm, model.operating_temperature_c) == (
        weld.DEPTH_MM,
        weld.TEMPERATURE_C,
    )
    assert model.operating_force_kn == weld.FORCE_KN
    assert pytest.approx(ProcessModel(model).equilibrium().speed_rpm, abs=5e-4) == weld.SPEED_RPM
    assert weld.FORCE_MIN_KN < weld.FORCE_KN < weld.FORCE_MAX_KN
    assert weld.SPEED_MIN_RPM < weld.SPEED_RPM < weld.SPEED_MAX_RPM
    assert plant["limits.force_rate_kn_per_s"] * weld.TICK_S == pytest.approx(weld.FORCE_STEP_KN)
    assert plant["limits.speed_rate_rpm_per_s"] * weld.TICK_S == pytest.approx(weld.SPEED_STEP_RPM)
