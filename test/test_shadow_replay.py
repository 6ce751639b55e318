"""A recorded weld is shown to a controller that runs in shadow, as ``fsw.py bag shadow`` does it: real processes."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fsw.main import main
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter

WELD = Path(__file__).parent / "golden" / "reference_tracking_decentral"
SPACE = "/hall/cell1"
SECONDS = 15
#: at five times the weld's speed a stalled machine may keep samples from the controller, which then holds the last
TOLERANCE = {"force": 0.1, "speed": 3.0}


def in_namespace(source: Path, target: Path) -> Path:
    """A copy of a bag as if the weld had run in a namespace."""

    def renamed(name: str) -> str:
        return SPACE + name if name.startswith("/fsw/") else name

    with BagReader(source) as reader, BagWriter(target) as writer:
        for topic in reader.topics().values():
            writer.add_topic(replace(topic, name=renamed(topic.name)))
        for one in reader.attachments():
            name = one.name.replace("parameters/", f"parameters/{SPACE.strip('/').replace('/', '.')}.")
            writer.attach(name, one.media_type, one.data.replace(b"/fsw_", f"{SPACE}/fsw_".encode()))
        for record in reader.records():
            writer.write(renamed(record.topic), record.data, record.log_time_ns, record.publish_time_ns)
    return target


def shadow(folder: Path, *arguments: str, weld: Path = WELD) -> dict[str, Any]:
    report = folder / "report.json"
    common = ["--controller", "decentral", "--rate", "5", "--duration", str(SECONDS), "--json", str(report)]
    assert main(["bag", "shadow", str(weld), *common, "--out", str(folder / "shadow"), *arguments]) == 0
    return json.loads(report.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


@pytest.mark.parametrize("namespaced", [False, True])
def test_recorded_controller_proposes_again_what_it_proposed(tmp_path: Path, namespaced: bool) -> None:
    weld = in_namespace(WELD, tmp_path / WELD.name) if namespaced else WELD
    report = shadow(tmp_path, weld=weld)
    assert report["ticks"] == 10 * SECONDS and report["unanswered"] <= 5 and report["unhealthy"] == 0
    own = {one["against"]: one for one in report["comparisons"]}["its own recorded proposals"]
    for variable, tolerance in TOLERANCE.items():
        assert own[variable]["largest"] <= (0.0 if not report["missed"] else tolerance), own
    with BagReader(tmp_path / "shadow" / "bag") as reader:
        info = reader.info()
    counts = info.counts
    assert info.problems == [] and info.custom_data["shadow_of"] == WELD.name
    assert counts["/fsw/depth"] == 10 * SECONDS
    assert counts["/fsw/command"] >= 10 * SECONDS - 1  # that of the last tick may have been received after the cut
    assert counts["/fsw/decentral/proposal"] >= 10 * SECONDS - 5


def test_another_tuning_is_told_from_what_was_applied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = shadow(tmp_path, "--set", "tuning=tight")
    applied = report["comparisons"][0]
    assert applied["against"] == "what was applied" and applied["ticks"] >= 10 * SECONDS - 5
    assert applied["force"]["first_tick"] <= 5 and applied["force"]["largest"] > 0.01
    assert applied["force"]["mean"] <= applied["force"]["largest"] < 10.0
    assert "compared with what was applied" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--controller", "nobody"], "controller nobody is not available"),
        (["--controller", "decentral", "--rate", "0"], "rate 0 is outside"),
        (["--controller", "decentral", "--set", "nonsense"], "NAME=VALUE"),
        (["--controller", "decentral", "--out", str(WELD)], "exists already"),
    ],
)
def test_bad_arguments_are_one_line(capsys: pytest.CaptureFixture[str], arguments: list[str], text: str) -> None:
    assert main(["bag", "shadow", str(WELD), *arguments]) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and text in captured.err
