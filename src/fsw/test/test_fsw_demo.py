"""The demonstration where no ROS 2 can be installed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fsw import demo


@pytest.fixture(autouse=True)
def without_middleware(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "middleware_is_here", lambda: False)


@pytest.mark.slow
def test_without_middleware_the_weld_runs_in_one_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--scenario", "quick", "--controller", "decentral", "--out", str(tmp_path / "out")]
    assert demo.main(words) == 0
    printed = capsys.readouterr()
    assert "ROS 2" in printed.err and "without bags" in printed.err and "IAE depth" in printed.out
    assert (
        len(json.loads((tmp_path / "out" / "quick" / "kpi.json").read_text(encoding="utf-8"))) == 1
    )
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.parametrize("option", ["--live", "--realtime"])
def test_page_and_wall_clock_need_the_middleware(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert demo.main([option, "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert f"{option} needs ROS 2" in error and "docs/how-to/install.md" in error
    assert not (tmp_path / "out").exists()
