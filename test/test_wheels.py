"""The wheels in an empty environment outside the repository: the command, and welds without ROS 2."""

import os
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import npm_packages
import pytest

import fsw

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
def test_wheels_weld_in_an_empty_environment(tmp_path):
    wheels, home, place = (tmp_path / name for name in ("wheels", "env", "place"))
    place.mkdir()
    script = WORKSPACE / "scripts" / "build_wheels.py"
    run(sys.executable, script, "--host", "--out", wheels, cwd=place, **os.environ)
    (wheel,) = wheels.glob("fsw_control*.whl")
    with zipfile.ZipFile(wheel) as content:
        files = {f"fsw_{name}/_kernel.so" for name in ("nmpc", "decentral", "plant")}
        if npm_packages.UPLOT.is_dir():  # npm and its registry were there
            files.add("fsw_hmi/page/uplot/uPlot.iife.min.js")
        assert files <= set(content.namelist())
    venv.EnvBuilder(with_pip=True).create(home)
    pip = [home / "bin" / "pip", "install", "-q", "--only-binary", ":all:", "--find-links", wheels]
    locks = [
        word
        for name in ("runtime", "gym", "signing", "pdf")
        for word in ("-c", WORKSPACE / "requirements" / f"{name}.lock")
    ]
    # only what is imported is compiled, then
    environment = {**os.environ, "PIP_NO_COMPILE": "1"}
    run(*pip, *locks, "fsw-lab[gym]", "fsw-quality[pdf]", cwd=place, **environment)

    def command(*words):
        return run(
            home / "bin" / "fsw", *words, cwd=place, HOME=str(place), PATH="/nowhere"
        )  # no compiler there

    assert command("--version") == f"fsw-control {fsw.__version__}\n"
    assert "IAE depth" in command("simulate", "quick", "--controller", "nmpc", "--no-figures")
    assert not list((place / ".cache").rglob("*.so"))  # the library was that of the wheel
    weld = "gymnasium.make('fsw_lab.weld_env:fsw/Weld-v0', scenario='quick')"
    env = f"import gymnasium; print({weld}.reset(seed=1)[0].shape)"
    assert run(home / "bin" / "python", "-c", env, cwd=place, HOME=str(place)) == "(7,)\n"
    command("demo", "--scenario", "quick", "--controller", "decentral", "--out", "welded")
    written = {path.name for path in (place / "welded" / "quick").iterdir()}
    assert written == {"kpi.json", "kpi.md", "overview.png"}
    assert "copper_lid" in command("record", "--help") and "--evaluations" in command(
        "tune", "--help"
    )
