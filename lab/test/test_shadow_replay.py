"""A recorded weld is shown to a controller in shadow, as ``fsw.py bag shadow`` does it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fsw.main import main
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter

WELD = Path(__file__).parents[2] / "test" / "golden" / "reference_tracking_decentral"
SPACE = "/hall/cell1"
SECONDS = 15


def in_namespace(source: Path, target: Path) -> Path:
    """A copy of a bag as if the weld had run in a namespace."""

    def renamed(name: str) -> str:
        return SPACE + name if name.startswith("/fsw/") else name

    with BagReader(source) as reader, BagWriter(target) as writer:
        for topic in reader.topics().values():
            writer.add_topic(replace(topic, name=renamed(topic.name)))
        for attachment in reader.attachments():
            name = attachment.name.replace(
                "parameters/", f"parameters/{SPACE.strip('/').replace('/', '.')}."
            )
            writer.attach(
                name,
                attachment.media_type,
                attachment.data.replace(b"/fsw_", f"{SPACE}/fsw_".encode()),
            )
        for record in reader.records():
            writer.write(
                renamed(record.topic), record.data, record.log_time_ns, record.publish_time_ns
            )
    return target


def shadow(folder: Path, *arguments: str, weld: Path = WELD) -> dict[str, Any]:
    report = folder / "report.json"
    common = ["--controller", "decentral", "--duration", str(SECONDS), "--json", str(report)]
    assert (
        main(["bag", "shadow", str(weld), *common, "--out", str(folder / "shadow"), *arguments])
        == 0
    )
    return json.loads(report.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


@pytest.mark.parametrize("namespaced", [False, True])
def test_recorded_controller_proposes_again_what_it_proposed(
    tmp_path: Path, namespaced: bool
) -> None:
    weld, space = (in_namespace(WELD, tmp_path / WELD.name), SPACE) if namespaced else (WELD, "")
    report = shadow(tmp_path, weld=weld)
    assert report["ticks"] == 10 * SECONDS and report["unhealthy"] == 0
    applied, own = report["comparisons"]
    assert (
        own["title"].endswith("own recorded proposals")
        and applied["ticks"] == own["ticks"] == 10 * SECONDS
    )
    assert own["differing"] == 0
    with BagReader(tmp_path / "shadow") as reader:
        info = reader.info()
    assert reader.problems == [] and reader.metadata.custom_data["shadow_of"] == WELD.name
    counts = {
        topic: info.counts[f"{space}/fsw/{topic}"]
        for topic in ("depth", "command", "decentral/proposal")
    }
    assert counts["depth"] == counts["decentral/proposal"] == 10 * SECONDS
    assert (
        counts["command"] >= 10 * SECONDS - 1
    )  # that of the last tick may have been received after the cut
    assert main(["bag", "verify", str(tmp_path / "shadow")]) == 0


def test_replay_with_another_tuning_reports_differences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = shadow(tmp_path, "--parameter", "tuning=tight")
    applied = report["comparisons"][0]
    assert applied["title"].endswith("applied commands") and applied["ticks"] == 10 * SECONDS
    assert applied["first_tick"] <= 5 and applied["force_kn"]["largest"] > 0.01
    assert applied["force_kn"]["mean"] <= applied["force_kn"]["largest"] < 10.0
    assert applied["title"] in capsys.readouterr().out
    capsys.readouterr()
    assert (
        main(["bag", "verify", str(tmp_path / "shadow")]) == 0
    )  # the new tuning is in its parameters


def test_a_controller_that_was_not_in_the_weld(tmp_path: Path) -> None:
    """The predictive controller on a weld of the other one."""
    report = shadow(tmp_path, "--controller", "nmpc", "--duration", "3")
    assert (report["controller"], report["ticks"], len(report["comparisons"])) == ("nmpc", 30, 1)
    assert main(["bag", "kpi", str(tmp_path / "shadow")]) == 0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--controller", "nobody"], "controller nobody is not available"),
        (["--controller", "decentral", "--parameter", "nonsense"], "NAME=VALUE"),
        (["--controller", "decentral", "--out", str(WELD)], "exists already"),
    ],
)
def test_bad_arguments_are_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], text: str
) -> None:
    assert main(["bag", "shadow", str(WELD), *arguments]) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and text in captured.err
