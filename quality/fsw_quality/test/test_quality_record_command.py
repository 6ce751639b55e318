"""The record of a weld that was recorded in the graph, and of what is left of its bag."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from random import Random
from typing import Any

import pytest
import yaml

from fsw.main import main
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.kpi import compute
from fsw_analysis.kpi_table import ROWS
from fsw_analysis.rules import FactCode, decide
from fsw_analysis.signals import load_weld
from fsw_quality import report
from fsw_quality.record import make
from fsw_quality.record_content import Record
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_scenario import procedure
from fsw_test_support.keys import make_key
from fsw_test_support.programme_bag import write_programme_weld
from fsw_test_support.waiting import wait_until

pytest.importorskip("fpdf", reason="fpdf2 is not installed: pip install -r requirements/pdf.lock")

#: a weld of 10 s, with an edge that lifts the tool by more than the quality limit
SCENARIO = {
    "name": "short_weld",
    "description": "a dwell and 4 deg of a joint line",
    "controller": "decentral",
    "plant": {"seed": 3},
    "phases": [
        {"name": "dwell", "duration_s": 3.0},
        {"name": "joint_line", "to_deg": 4.0, "speed_mm_per_min": 300.0},
    ],
    "events": [
        {"at_s": 6.0, "disturbance": {"channel": "depth", "shape": "step", "amplitude_mm": 0.2}}
    ],
}
PHASES = [
    {"name": "dwell", "duration_s": 3.0, "source": "test"},
    {"name": "joint_line", "to_deg": 4.0, "source": "test"},
]


def run(*arguments: object) -> int:
    return main(["record", *map(str, arguments)])


def verdict(record: Record) -> str:
    """But for the rule that the weld ran by another procedure."""
    return str(decide([rule for rule in record.rules if rule.name != "procedure"]).verdict)


def with_changes(folder: Path, **changes: Any) -> Path:
    values = procedure.load("copper_lid").model_dump(mode="json", exclude_none=True)
    values["machine"]["traverse_mm_per_min"] = 300.0
    values |= {"phases": PHASES} | changes
    file = folder / "procedure.yaml"
    file.write_text(yaml.safe_dump(values), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of the short weld, recorded over the middleware in lockstep; not to be changed."""
    folder = tmp_path_factory.mktemp("recorded")
    scenario = folder / "short_weld.yaml"
    scenario.write_text(yaml.safe_dump(SCENARIO, sort_keys=False), encoding="utf-8")
    words = [
        "simulate",
        str(scenario),
        "--bag",
        "--procedure",
        str(with_changes(folder)),
        "--no-figures",
    ]
    words += ["--controller", "decentral:tight"]
    words += ["--identity", "canister=C-1", "--identity", "tool=T-4"]
    assert main([*words, "--out", str(folder / "out")]) == 0
    bag = folder / "out" / "graph_decentral_tight" / "bag"
    log = bag / "on_finished.log"
    wait_until(
        lambda: log.exists() and "exit code" in log.read_text("utf-8"),
        "the record that is written by itself",
    )
    return bag


@pytest.mark.slow
def test_the_record_is_written_by_itself(recorded: Path) -> None:
    """By the procedure of the weld, whose limits the nodes had; what they told is on record."""
    log = (recorded / "on_finished.log").read_text(encoding="utf-8")
    assert log.endswith("exit code 0\n"), log
    record = Record.model_validate_json(
        (recorded / "record" / "record.json").read_text(encoding="utf-8")
    )
    assert record.verdict == "review" and (recorded / "record" / "record.pdf").exists()
    assert {"procedure.yaml", "parameters/fsw_procedure.yaml"} <= set(record.attachments_sha256)
    assert "code of fsw_supervisor" in record.software
    assert not [event for event in record.events if event.kind == "deviation"]
    (welded_by,) = [rule for rule in record.rules if rule.name == "procedure"]
    assert welded_by.verdict == "accept" and welded_by.data["sha256"] == record.procedure.sha256


@pytest.mark.slow
def test_the_bag_is_of_the_weld_that_was_simulated(recorded: Path) -> None:
    """With the same variant of the controller, which the figures of merit show."""
    (offline,) = json.loads((recorded.parent.parent / "kpi.json").read_text(encoding="utf-8"))
    bag = compute(cut_to_scenario(load_weld(recorded)))
    assert sum(offline[key] is not None for key in ROWS) > 5
    for key in ROWS:
        expected = offline[key]
        assert bag[key] == (
            expected if expected is None else pytest.approx(expected, rel=1e-6, abs=1e-9)
        ), key


@pytest.mark.slow
def test_record_of_a_recorded_weld(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = with_changes(tmp_path)
    assert run(recorded, "--procedure", asked, "--out", tmp_path / "out") == 0
    assert "REVIEW (quality: depth_error_mm -0.1 to 0.1: " in capsys.readouterr().out
    text = (tmp_path / "out" / "record.json").read_text(encoding="utf-8")
    record = Record.model_validate_json(text)
    assert {rule.name for rule in record.rules if rule.verdict != "accept"} == {"quality"}
    assert record.procedure.sha256 == procedure.load(asked).sha256
    assert record.identity == {"canister": "C-1", "tool": "T-4"}
    assert [fact.code for fact in record.proof] == [FactCode.AS_LISTED, FactCode.UNSIGNED]
    edge = next(exceedance for exceedance in record.exceedances if exceedance.duration_s > 0.3)
    assert (
        6.0 <= edge.begin_s <= 6.3
        and edge.phases == ("joint_line",)
        and edge.commanded_by == "decentral"
    )
    assert edge.beyond == pytest.approx(0.1, abs=0.03)
    # 300 mm/min from 3 s on
    assert edge.travel_mm is not None and edge.travel_mm[0] == pytest.approx(
        5.0 * (edge.begin_s - 3.0), abs=0.6
    )
    assert edge.angle_deg is not None and edge.angle_deg[0] == pytest.approx(
        edge.travel_mm[0] / 9.163, abs=0.6
    )
    joint_line = next(phase for phase in record.phases if phase.phase == "joint_line")
    assert joint_line.envelopes["traverse_mm_per_min"].mean == pytest.approx(300.0, rel=0.03)
    assert {file.name for file in record.files} == {
        "bag_0.mcap",
        "metadata.yaml",
    } and "numpy" in record.software
    page = (tmp_path / "out" / "record.html").read_text(encoding="utf-8")
    assert (
        "REVIEW" in page
        and page.count("data:image/png;base64,") == 2
        and "http" not in page.partition("<body")[2]
    )
    assert (tmp_path / "out" / "record.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_a_recorded_weld_is_attested_with_the_record_that_was_written_by_itself(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Judged again it gives the same record, by the procedure that is in the bag."""
    pytest.importorskip(
        "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
    )
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    bag = Path(shutil.copytree(recorded, tmp_path / "bag"))
    make_key(tmp_path / "config" / "fsw-control" / "evidence_key")
    assert main(["bag", "attest", str(bag), "--chain", str(tmp_path / "chain")]) == 0
    target = tmp_path / "found.json"
    assert (
        main(
            [
                "bag",
                "verify-evidence",
                str(bag),
                "--chain",
                str(tmp_path / "chain"),
                "--json",
                str(target),
            ]
        )
        == 0
    )
    [result] = json.loads(target.read_text(encoding="utf-8"))["bags"]
    assert (
        result["attested"]["procedure"]["sha256"] == procedure.load(with_changes(tmp_path)).sha256
    )
    assert result["attested"]["documents"] == [f"record/{name}" for name in report.files()]
    assert "not_judged_again" in {entry["code"] for entry in result["not_checked"]}


@pytest.mark.slow
def test_a_damaged_bag_is_never_accepted(recorded: Path, tmp_path: Path) -> None:
    """With limits that the whole weld keeps, see the next test."""
    asked = procedure.load(with_changes(tmp_path, quality=[]))
    data = (recorded / "bag_0.mcap").read_bytes()
    for share in (0.5, 0.8, 0.999):
        cut = tmp_path / f"cut_{share}.mcap"
        cut.write_bytes(data[: int(share * len(data))])
        record = make(cut, asked)[0]
        assert verdict(record) != "accept"
        assert any("not finished" in str(fact.data) for fact in record.cannot_say)


@pytest.mark.slow
@pytest.mark.full
def test_a_flipped_bit_is_told_or_changes_nothing(recorded: Path, tmp_path: Path) -> None:
    """Messages and attachments have checksums.

    Indexes have none, and nothing is read from them.
    """
    asked, bag = procedure.load(with_changes(tmp_path, quality=[])), tmp_path / "bag"
    shutil.copytree(recorded, bag)
    data = (bag / "bag_0.mcap").read_bytes()
    unharmed = make(bag, asked)[0]
    assert verdict(unharmed) == "accept" and unharmed.deciding.name == "procedure"
    random = Random(26)
    for _ in range(12):
        at = random.randrange(len(data))
        (bag / "bag_0.mcap").write_bytes(
            data[:at] + bytes([data[at] ^ (1 << random.randrange(8))]) + data[at + 1 :]
        )
        try:
            record = make(bag, asked)[0]
        except BagError:
            continue
        assert verdict(record) != "accept" or record.changed(files=unharmed.files) == unharmed, at
        assert record.files != unharmed.files


def test_what_has_no_record_is_said_in_one_line(
    weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / "empty"):
        pass
    for bag, asked, said in (
        (tmp_path / "none", "copper_lid", "there is no such bag"),
        (tmp_path / "empty", "copper_lid", "the bag holds no messages"),
        (weld_bag, "no_such", "cannot read procedure no_such"),
    ):
        assert run(bag, "--procedure", asked, "--out", tmp_path / "out") == 1
        error = capsys.readouterr().err.strip()
        assert said in error.splitlines()[-1] and error.count("error:") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("has_programme", [False, True])
def test_weld_without_a_phase_of_its_procedure_is_rejected(
    weld_bag: Path, tmp_path: Path, has_programme: bool
) -> None:
    """Whether it has no programme, or that of another procedure.

    It was welded, so it has a record.
    """
    if has_programme:
        write_programme_weld(tmp_path / "programme")
    foreign = procedure.load(with_changes(tmp_path, phases=[PHASES[1]]))
    record, _ = make(tmp_path / "programme" if has_programme else weld_bag, foreign)
    assert (verdict(record), record.deciding.name) == ("reject", "complete")
    assert "no_phase" in [fact.code for fact in record.deciding.facts]
    names = ["dwell", "start"] if has_programme else []
    assert [phase.phase for phase in record.phases] == [*names, "whole weld"]


def test_what_is_not_as_the_manifest_has_it_is_on_record(tmp_path: Path) -> None:
    """E.g. with the manifest of another canister."""
    values = procedure.load("copper_lid")
    texts = {}
    for canister in ("one", "other"):
        bag = tmp_path / canister / "bag"
        write_programme_weld(bag, 2 if canister == "one" else 1, WriterOptions(manifest=True))
        texts[canister] = (bag / MANIFEST_NAME).read_text(encoding="utf-8")
    bag = tmp_path / "one" / "bag"
    for canister, differs in (("one", False), ("other", True)):
        (bag / MANIFEST_NAME).write_text(texts[canister], encoding="utf-8")
        record = make(bag, values)[0]
        [rule] = [rule for rule in record.rules if rule.name == "recording"]
        assert ("bag_0.mcap" in rule.figure) is differs
        assert (FactCode.NOT_AS_LISTED in {fact.code for fact in record.proof}) is differs
        assert (FactCode.DAMAGE in {fact.code for fact in record.cannot_say}) is differs


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--identity", "canister=C-1"], "--identity needs --bag"),
        (
            ["--bag", "--identity", "canister"],
            "write KEY=VALUE with one of canister, lid, tool, machine",
        ),
        (
            ["--bag", "--identity", "colour=red"],
            "write KEY=VALUE with one of canister, lid, tool, machine",
        ),
        (["--bag", "--identity", "tool=1", "--identity", "tool=2"], "tool is given twice"),
    ],
)
def test_a_wrong_identity_is_refused_before_the_weld(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "quick", *words]) == 1
    assert said in capsys.readouterr().err


def test_a_record_is_not_replaced_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_programme_weld(tmp_path / "weld")
    arguments = (tmp_path / "weld", "--procedure", "copper_lid", "--out", tmp_path / "out")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "record.json").write_text("{}")
    assert run(*arguments) == 1
    assert "record.json exists; " in capsys.readouterr().err
    assert run(tmp_path / "weld", *arguments, "--force") == 1
    assert "given twice" in capsys.readouterr().err
    assert run(*arguments, "--force", "--data", "colour=red") == 1
    assert run(*arguments, "--force", "--data", "ndt=UT 5", "--data", "ndt=none") == 1
    assert "colour" in capsys.readouterr().err
    data = ("--data", "ndt=UT 5", "--data", "disposition=use as is")
    (tmp_path / "out" / "traces.svg").touch()
    assert run(*arguments, "--force", *data, "--format", "svg") == 0
    assert (tmp_path / "out" / "traces.svg").read_bytes().startswith(b"<?xml")
    assert "REJECT" in capsys.readouterr().out
    made = json.loads((tmp_path / "out" / "record.json").read_text(encoding="utf-8"))
    assert made["operators"] == ["anna (3f2a)"]
    assert made["afterwards"] == {"ndt": "UT 5", "disposition": "use as is"}
    assert "UT 5" in (tmp_path / "out" / "record.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("lines", "pages"), [(84, 1), (90, 2)])
def test_a_heading_stands_on_the_page_of_what_follows(lines, pages):
    """With 90 lines it would be the last on its page."""
    body = "<h1>ACCEPT</h1>" + "line<br>" * lines + "<h2>Exceedances</h2><p>none</p>"
    assert report._pdf(body, "weld").count(b"/Type /Page\n") == pages
