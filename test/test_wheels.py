"""The wheels in an empty environment outside the repository.

The command, and welds without ROS 2.
"""

import os
import subprocess
import tomllib
import zipfile
from pathlib import Path

import npm_packages
import pytest

import fsw
from fsw_test_support import doc_blocks

WORKSPACE = Path(__file__).resolve().parents[1]


def run(*command, cwd, **environment):
    return subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
        check=True,
    ).stdout


@pytest.mark.parametrize(
    ("project", "folder", "without"),
    [
        (".", "src", {"fsw_msgs"}),
        ("quality", "quality", set()),
        ("lab", "lab", set()),
    ],
)
def test_every_package_is_in_its_wheel(project, folder, without):
    content = tomllib.loads((WORKSPACE / project / "pyproject.toml").read_text())
    named = [
        WORKSPACE / project / path
        for path in content["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    ]
    assert all(path.is_dir() for path in named)
    manifests = list((WORKSPACE / folder).glob("*/package.xml"))
    assert {path.parent.name for path in manifests} == {path.name for path in named} | without


@pytest.mark.slow
@pytest.mark.full
def test_wheels_weld_in_an_empty_environment(tmp_path, monkeypatch):
    """Installed as the page says, then with extras, and where there is no compiler."""
    locks = (f"{name}.lock" for name in ("runtime", "gym", "signing", "pdf"))
    constraints = (str(WORKSPACE / "requirements" / lock) for lock in locks)
    monkeypatch.setenv("PIP_CONSTRAINT", " ".join(constraints))
    with doc_blocks.Page(WORKSPACE / "docs" / "how-to" / "install.md", tmp_path) as page:
        for block in page.blocks:
            assert page.run(block) == "", block
    wheels, programs, place = page.folder / "out" / "dist", page.folder / "weld" / "bin", tmp_path
    (wheel,) = wheels.glob("fsw_control*x86_64.whl")
    with zipfile.ZipFile(wheel) as content:
        files = {f"fsw_{name}/_kernel.so" for name in ("nmpc", "decentral", "plant")}
        if npm_packages.UPLOT.is_dir():  # npm and its registry were there
            files.add("fsw_hmi/page/uplot/uPlot.iife.min.js")
        assert files <= set(content.namelist())
    pip = [programs / "pip", "install", "-q", "--only-binary", ":all:", "--find-links", wheels]
    # only what is imported is compiled, then
    environment = {**os.environ, "PIP_NO_COMPILE": "1"}
    run(*pip, "fsw-lab[gym]", "fsw-quality[pdf]", cwd=place, **environment)

    def command(*words):
        return run(
            programs / "fsw", *words, cwd=place, HOME=str(place), PATH="/nowhere"
        )  # no compiler there

    assert command("--version") == f"fsw-control {fsw.__version__}\n"
    assert "IAE depth" in command("simulate", "quick", "--controller", "nmpc", "--no-figures")
    assert not list((place / ".cache").rglob("*.so"))  # the library was that of the wheel
    weld = "gymnasium.make('fsw_lab.weld_env:fsw/Weld-v0', scenario='quick')"
    env = f"import gymnasium; print({weld}.reset(seed=1)[0].shape)"
    assert run(programs / "python", "-c", env, cwd=place, HOME=str(place)) == "(7,)\n"
    (welded,) = page.folder.glob("out/*_demo/quick")
    assert {path.name for path in welded.iterdir()} == {"kpi.json", "kpi.md", "overview.png"}
    assert "copper_lid" in command("record", "--help") and "--evaluations" in command(
        "tune", "--help"
    )
