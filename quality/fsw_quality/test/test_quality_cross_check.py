"""What is signed together is of one weld.

Each attack on record, procedure and identity is refused with its code.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from fsw_analysis.procedure import Procedure, WeldData
from fsw_quality import record, report
from fsw_quality.attestation import Chain
from fsw_quality.evidence import Policy, Subject, attest, verify_bag
from fsw_quality.record_content import Comparison, Record
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.findings import Code, EvidenceError, Unchecked
from fsw_recorder.signature import (
    Purpose,
    load_private,
    load_trusted,
    sign,
    signature_path,
)
from fsw_scenario.procedure import load, signer_of
from fsw_test_support.keys import make_key
from fsw_test_support.programme_bag import write_programme_weld

pytest.importorskip(
    "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
)
pytest.importorskip("fpdf", reason="not installed: pip install -r requirements/pdf.lock")

NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)
ALL = (report.JSON, report.PAGE, report.PDF)


def text_of(procedure: Procedure) -> bytes:
    return yaml.safe_dump(procedure.model_dump(mode="json", exclude_none=True)).encode()


@pytest.fixture(scope="module")
def welded_by() -> Procedure:
    return load("copper_lid").changed(revision="test")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, welded_by: Procedure) -> Path:
    """Two welds by a procedure that is attached to their bags, with their records, and a key.

    Not to be changed.
    """
    folder = tmp_path_factory.mktemp("made")
    make_key(folder / "key")
    for number in (1, 2):
        bag, attached = folder / f"weld_{number}", {"procedure.yaml": text_of(welded_by)}
        write_programme_weld(
            bag, number, WriterOptions(manifest=True), {"canister": f"C-{number}"}, attached
        )
        content, course = record.make(bag, welded_by)
        (bag / "record").mkdir()
        report.write(content, course, welded_by, bag / "record")
    return folder


@pytest.fixture
def shop(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "shop"))


def signed_for(shop: Path, number: int = 1, names: tuple[str, ...] = ALL, **more: Any) -> Subject:
    """A weld with these files of its record alone."""
    bag = shop / f"weld_{number}"
    for name in set(ALL) - set(names):
        (bag / "record" / name).unlink(missing_ok=True)
    return Subject(bag, **more)


def own(shop: Path, **more: bool) -> Policy:
    return Policy(load_trusted([shop / "key.pub"]), **more)


def codes(shop: Path, subject: Subject, policy: Policy | None = None) -> list[Code]:
    """Of why something is not attested; empty: it is."""
    try:
        attest(subject, shop / "chain", load_private(shop / "key"), NOW, policy or own(shop))
    except EvidenceError as error:
        assert not (shop / "chain").exists() and not (subject.bag / "attestation.json").exists()
        return [entry.code for entry in error.findings]
    return []


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_what_fits_together_is_attested_and_verified(shop: Path, welded_by: Procedure) -> None:
    assert codes(shop, signed_for(shop)) == []
    trusted = load_trusted([shop / "key.pub"])
    result = verify_bag(shop / "weld_1", Policy(trusted), NOW, Chain(shop / "chain", trusted))
    assert result.findings == () and result.attested is not None
    assert result.attested.procedure == welded_by.identity and len(result.attested.documents) == 3
    assert result.attested.identity == {"canister": "C-1"}
    noted = {entry.code for entry in result.not_checked}
    assert Unchecked.NOT_JUDGED_AGAIN in noted and Unchecked.NO_RECORD not in noted
    (shop / "weld_1" / "record" / report.PAGE).unlink()
    (shop / "weld_1" / "record" / report.PDF).write_bytes(b"%PDF-1.4 other")
    changed = verify_bag(shop / "weld_1", Policy(trusted), NOW)
    assert [entry.code for entry in changed.findings] == [Code.CHANGED_SINCE]
    assert Unchecked.DOCUMENT_ABSENT in {entry.code for entry in changed.not_checked}


def test_the_record_of_another_weld(shop: Path) -> None:
    shutil.copyfile(
        shop / "weld_2" / "record" / "record.json", shop / "weld_1" / "record" / "record.json"
    )
    assert codes(shop, signed_for(shop, names=("record.json",))) == [Code.RECORD_OTHER_WELD]


def accept(content: dict[str, Any]) -> None:
    content["verdict"] = content["deciding"]["verdict"] = "accept"


def accept_all(content: dict[str, Any]) -> None:
    accept(content)
    for rule in content["rules"]:
        rule["verdict"] = "accept"


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (accept, Code.RECORD_EDITED),
        (accept_all, Code.RECORD_EDITED),
        (lambda content: content["rules"].pop(), Code.RECORD_EDITED),
        (
            lambda content: content.update(
                proof=[{"code": "signed", "data": {"signer": "the inspector"}}]
            ),
            Code.RECORD_EDITED,
        ),
        (lambda content: content["identity"].update(canister="C-9"), Code.RECORD_OTHER_IDENTITY),
        (
            lambda content: content["procedure"].update(sha256="0" * 64),
            Code.RECORD_OTHER_PROCEDURE,
        ),
    ],
)
def test_an_edited_record(
    shop: Path, change: Callable[[dict[str, Any]], object], code: Code
) -> None:
    path = shop / "weld_1" / "record" / "record.json"
    assert json.loads(path.read_text())["verdict"] == "reject"
    edit(path, change)
    assert codes(shop, signed_for(shop, names=("record.json",))) == [code]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"{", b'{"verdict": "accept",'),  # the last one is read
        (b"fsw_weld_record", rb"fsw\u005fweld_record"),
        (b"}", b', "comparison": null}'),
    ],
)
def test_a_record_whose_bytes_say_something_else(shop: Path, old: bytes, new: bytes) -> None:
    """What is read of it is what the bag gives."""
    path = shop / "weld_1" / "record" / "record.json"
    data = path.read_bytes()
    head, _, tail = data.rpartition(old) if old == b"}" else data.partition(old)
    path.write_bytes(head + new + tail)
    assert codes(shop, signed_for(shop, names=("record.json",))) == [Code.RECORD_EDITED]


def test_a_record_of_an_earlier_version_is_refused_as_such(shop: Path) -> None:
    path = shop / "weld_1" / "record" / "record.json"
    edit(path, lambda content: content.update(version=2, rules="other words"))
    assert codes(shop, signed_for(shop, names=("record.json",))) == [Code.RECORD_OTHER_VERSION]


def test_what_the_bag_does_not_give_is_noted_as_not_checked(shop: Path) -> None:
    path = shop / "weld_1" / "record" / "record.json"
    stated = Record.model_validate_json(path.read_bytes())
    compared = Comparison(welds=("weld_0",), figures=())
    more = stated.changed(comparison=compared, afterwards=WeldData(ndt="UT 5"))
    path.write_bytes(report.record_bytes(more))
    subject = signed_for(shop, names=("record.json",))
    made = attest(subject, shop / "chain", load_private(shop / "key"), NOW, own(shop))
    codes = {note.code for note in made.notes}
    assert {Unchecked.NOT_COMPARED, Unchecked.STATED_AFTERWARDS} <= codes


def test_a_procedure_that_the_weld_did_not_run_by(shop: Path, welded_by: Procedure) -> None:
    assert codes(shop, signed_for(shop, names=(), procedure=load("copper_lid"))) == [
        Code.OTHER_PROCEDURE
    ]
    assert codes(shop, signed_for(shop, names=(), procedure=welded_by)) == []


def test_a_record_without_any_procedure_cannot_be_judged(shop: Path) -> None:
    write_programme_weld(shop / "weld_3", 2, WriterOptions(manifest=True))
    content, course = record.make(shop / "weld_3", load("copper_lid"))
    record_folder = shop / "records" / "weld_3"
    record_folder.mkdir(parents=True)
    report.write(content, course, load("copper_lid"), record_folder)
    assert codes(shop, Subject(shop / "weld_3", record=record_folder)) == [Code.NO_PROCEDURE]
    lid = load("copper_lid")
    assert codes(shop, Subject(shop / "weld_3", lid, record=shop / "weld_1")) == [Code.MISSING]
    assert codes(shop, Subject(shop / "weld_3", lid, record=record_folder)) == []
    (record_folder / report.PAGE).write_text("edited")
    wrong = verify_bag(shop / "weld_3", own(shop), NOW).findings
    assert [(entry.code, entry.file) for entry in wrong] == [
        (Code.CHANGED_SINCE, f"../records/weld_3/{report.PAGE}")
    ]


def test_figures_beside_a_page_do_not_change_it(shop: Path, welded_by: Procedure) -> None:
    content, course = record.make(shop / "weld_1", welded_by)
    beside = [shop / name for name in report.figure_names("svg")]
    alone = report.contents(content, course, welded_by)
    assert report.contents(content, course, welded_by, beside) == alone


@pytest.mark.parametrize("name", [report.PAGE, report.PDF])
def test_a_page_of_another_record(shop: Path, name: str) -> None:
    path = shop / "weld_1" / "record" / name
    assert report.json_sha256(path.read_bytes()) is not None
    for other in (
        (shop / "weld_2" / "record" / name).read_bytes(),
        b"without the hash of any record",
    ):
        path.write_bytes(other)
        assert codes(shop, signed_for(shop)) == [Code.OTHER_RECORD]
    assert codes(shop, signed_for(shop, names=(name,))) == [Code.MISSING], "its record"


@pytest.mark.parametrize("name", [report.PAGE, report.PDF])
def test_a_page_that_says_something_else_than_its_record(
    shop: Path, welded_by: Procedure, name: str
) -> None:
    """It carries the right hash, and another figure somewhere."""
    folder = shop / "weld_1" / "record"
    content, course = record.make(shop / "weld_1", welded_by)
    made_of = report.json_sha256((folder / name).read_bytes()) or ""
    *phases, whole = content.phases
    better = content.changed(phases=(*phases, whole.changed(end_s=1.0)))
    report.write(better, course, welded_by, shop)
    wrong = report.json_sha256((shop / name).read_bytes()) or ""
    path = folder / name
    path.write_bytes((shop / name).read_bytes().replace(wrong.encode(), made_of.encode()))
    assert codes(shop, signed_for(shop)) == [Code.DOCUMENT_DIFFERS]


def test_a_procedure_s_signature_can_be_demanded(shop: Path, welded_by: Procedure) -> None:
    path, key = shop / "lid.yaml", load_private(shop / "key")
    path.write_bytes(text_of(welded_by))
    with pytest.raises(EvidenceError) as caught:
        signer_of(path, None, required=True)
    assert caught.value.findings[0].code is Code.NOT_SIGNED
    weld_begins = datetime.fromtimestamp(1.7e9, UTC)
    trusted = load_trusted([shop / "key.pub"])
    for signed_at, expected in (
        (weld_begins + timedelta(days=1), [Code.TIME_ORDER]),  # after the weld
        (weld_begins - timedelta(days=1), []),
    ):
        text = sign(path.read_bytes(), path.name, Purpose.PROCEDURE, key, signed_at)
        signature_path(path).write_text(text)
        signer = signer_of(path, trusted, required=True)
        subject = signed_for(shop, names=(), procedure=load(path), procedure_signer=signer)
        assert codes(shop, subject, own(shop, require_signed=True)) == [
            Code.MANIFEST_UNSIGNED,
            *expected,
        ]
        assert codes(shop, subject) == expected
    result = verify_bag(shop / "weld_1", Policy(trusted), NOW)
    assert result.findings == () and result.signers[Purpose.PROCEDURE].signed_at == signed_at
    machine = [entry.changed(purposes=(Purpose.ATTESTATION,)) for entry in trusted]
    wrong = verify_bag(shop / "weld_1", Policy(machine), NOW).findings
    assert [entry.code for entry in wrong] == [Code.KEY_PURPOSE]
