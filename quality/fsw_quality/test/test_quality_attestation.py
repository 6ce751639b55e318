"""Attested bags and their chain: every change is found, and nothing is lost by a crash."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from fsw_quality import evidence
from fsw_quality.attestation import ATTESTATION_NAME, Attestation, doubled, read_chain, statement
from fsw_quality.evidence import Policy, Subject, Verification, attest, verify_bag
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.recover import recover
from fsw_recorder.recover_proven import recover_proven
from fsw_recorder.signature import (
    Purpose,
    SigningKey,
    TrustedKey,
    load_private,
    load_trusted,
    make_key,
    sign,
    signature_path,
)
from fsw_scenario import procedure
from fsw_test_support.sample_weld import sample_messages, sample_topics

pytest.importorskip(
    "cryptography", reason="not installed: pip install -r requirements/signing.lock"
)

NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)
COUNT = 4
NO_POLICY = Policy()


class Shop:
    """Welds one after another, their chain and the key."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.chain_folder, self.key_path = folder, folder / "chain", folder / "key"

    @property
    def key(self) -> SigningKey:
        return load_private(self.key_path)

    @property
    def trusted(self) -> tuple[TrustedKey, ...]:
        return load_trusted([self.folder / "key.pub"])

    def bag(self, number: int) -> Path:
        return self.folder / f"weld_{number}"

    def weld(
        self,
        number: int,
        manifest: bool = True,
        canister: int = 0,
        key: Path | str = "",
        ticks: int = 20,
    ) -> Path:
        options = WriterOptions(manifest=manifest, signing_key=str(key))
        with BagWriter(
            self.bag(number), options, {"canister": f"C-{canister or number}"}
        ) as writer:
            for topic in sample_topics():
                writer.add_topic(topic)
            writer.attach("versions.json", "application/json", b'{"numpy": "2.0"}')
            for count, (name, time_ns, data) in enumerate(sample_messages(ticks)):
                writer.write(name, data, time_ns + number, time_ns + number)
                if count % 50 == 0:
                    writer.flush()
        return self.bag(number)

    def attest(
        self, number: int, policy: Policy = NO_POLICY, now: datetime = NOW, **more: Any
    ) -> Attestation:
        return attest(Subject(self.bag(number), **more), self.chain_folder, self.key, now, policy)

    def refused(
        self, number: int, policy: Policy = NO_POLICY, now: datetime = NOW, **more: Any
    ) -> list[Code]:
        """Codes of why a bag is not attested."""
        with pytest.raises(EvidenceError) as caught:
            self.attest(number, policy, now, **more)
        assert "\n" not in str(caught.value)
        return [entry.code for entry in caught.value.findings]

    def chain_codes(self) -> list[Code]:
        return [entry.code for entry in read_chain(self.chain_folder, self.trusted).findings]

    def verified(self, number: int, *documents: Path) -> Verification:
        chain = read_chain(self.chain_folder, self.trusted)
        return verify_bag(self.bag(number), Policy(self.trusted), NOW, chain, documents)

    def codes(self, number: int, *documents: Path) -> list[Code]:
        return [entry.code for entry in self.verified(number, *documents).findings]


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    shop = Shop(tmp_path_factory.mktemp("shop"))
    make_key(shop.key_path)
    for number in range(1, COUNT + 1):
        shop.weld(number)
        shop.attest(number, procedure=procedure.load("copper_lid"))
    return shop.folder


@pytest.fixture
def shop(original: Path, tmp_path: Path) -> Shop:
    return Shop(Path(shutil.copytree(original, tmp_path / "shop")))


def test_a_record_can_say_whether_the_bag_is_what_was_recorded_and_who_signed(shop: Shop) -> None:
    bag = shop.bag(2)
    lines, wrong = statement(bag)
    assert (
        len(lines) == 3
        and shop.verified(2).signers[Purpose.ATTESTATION].key in lines[-1]
        and wrong == []
    )
    signature = (bag / "attestation.json.sig").read_text()
    (bag / "attestation.json.sig").write_bytes((shop.bag(3) / "attestation.json.sig").read_bytes())
    assert len(statement(bag)[1]) == 1
    (bag / "attestation.json.sig").write_text(signature)
    (bag / MANIFEST_NAME).write_bytes((bag / MANIFEST_NAME).read_bytes() + b"\n")
    assert len(statement(bag)[1]) == 1
    (bag / ATTESTATION_NAME).unlink()
    assert statement(bag)[1] == []
    (bag / "weld_2_0.mcap").write_bytes(b"other")
    assert "weld_2_0.mcap" in statement(bag)[1][0]
    (bag / MANIFEST_NAME).unlink()
    assert statement(bag)[1] == []


def test_what_was_not_touched_is_proven(shop: Shop) -> None:
    assert (
        shop.chain_codes() == []
        and [shop.codes(number) for number in range(1, COUNT + 1)] == [[]] * COUNT
    )
    result = shop.verified(2)
    attested = result.attested
    assert (
        attested is not None and attested.number == 2 and attested.identity == {"canister": "C-2"}
    )
    assert attested.software == {"numpy": "2.0"} and attested.attested_at == NOW
    assert attested.procedure == procedure.load("copper_lid").identity
    # a folder may be renamed, and what else is in it does not count
    shop.bag(2).rename(shop.bag(9))
    (shop.bag(9) / "record.json").write_text("{}")
    assert shop.codes(9) == []


def test_what_was_not_checked_is_said(shop: Shop) -> None:
    assert {entry.code for entry in shop.verified(2).not_checked} == {
        Code.ALL_KEYS,
        Code.CLOCK_UNKNOWN,
        Code.MANIFEST_UNSIGNED,
        Code.PROCEDURE_NOT_RECORDED,
        Code.PROCEDURE_UNSIGNED,
    }
    named = [entry.changed(name="quality") for entry in shop.trusted]
    result = verify_bag(shop.bag(2), Policy(named), NOW)
    assert result.signers[Purpose.ATTESTATION].name == "quality"
    codes = {entry.code for entry in result.not_checked}
    assert Code.NO_CHAIN in codes and Code.ALL_KEYS not in codes
    strict = verify_bag(shop.bag(2), Policy(named, require_signed=True), NOW)
    assert {entry.code for entry in strict.findings} == {
        Code.MANIFEST_UNSIGNED,
        Code.PROCEDURE_UNSIGNED,
    }


def test_damage_is_located_to_file_and_chunk(shop: Shop) -> None:
    file = shop.bag(1) / "weld_1_0.mcap"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    [found] = shop.verified(1).findings
    assert (found.code, found.file) == (Code.CHANGED, "weld_1_0.mcap")
    assert found.place is not None and found.place.parts[0].startswith("chunk ")
    assert shop.refused(1) == [Code.CHANGED]
    recover_proven(shop.bag(1), shop.bag(8), (ATTESTATION_NAME, f"{ATTESTATION_NAME}.sig"))
    result = shop.verified(8)
    assert result.attested is not None and result.attested.number == 1
    assert (
        sum(
            any("chunk" in part for part in one.place.parts)
            for one in result.findings
            if one.place
        )
        == 1
    )


def test_an_exchanged_bag_or_manifest_is_found(shop: Shop) -> None:
    for name in (MANIFEST_NAME, ATTESTATION_NAME, f"{ATTESTATION_NAME}.sig"):
        shutil.copyfile(shop.bag(3) / name, shop.bag(2) / name)
    assert shop.codes(2) == [Code.OTHER_WELD]
    shutil.copyfile(shop.bag(3) / MANIFEST_NAME, shop.bag(1) / MANIFEST_NAME)
    assert Code.OTHER_MANIFEST in shop.codes(1)
    shutil.copyfile(shop.bag(3) / "metadata.yaml", shop.bag(4) / "metadata.yaml")
    assert shop.codes(4)[0] is Code.OTHER_IDENTITY
    (shop.bag(3) / ATTESTATION_NAME).unlink()
    assert shop.codes(3) == [Code.MISSING]


def test_a_lost_file_is_missing_not_another_weld(shop: Shop) -> None:
    (shop.bag(2) / "weld_2_0.mcap").unlink()
    assert shop.codes(2) == [Code.MISSING]


def test_documents_of_one_name_are_refused(shop: Shop) -> None:
    """They are listed by their names, so only one of them would be signed for."""
    files = [shop.folder / name / "record.json" for name in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("{}")
    shop.weld(9)
    assert shop.refused(9, documents=files) == [Code.DOUBLED_NAME]


def test_a_changed_attestation_is_found(shop: Shop) -> None:
    path = shop.bag(1) / ATTESTATION_NAME
    path.write_text(path.read_text().replace("C-1", "C-7"))
    assert shop.codes(1) == [Code.CONTENT_CHANGED]


@pytest.mark.parametrize("gone", [(2,), (1, 2, 3)])
def test_a_missing_weld_leaves_a_hole(shop: Shop, gone: tuple[int, ...]) -> None:
    for number in gone:
        (shop.chain_folder / f"{number:06d}.json").unlink()
    [found] = read_chain(shop.chain_folder, shop.trusted).findings
    assert (found.code, found.data) == (Code.GAP, {"first": gone[0], "last": gone[-1]})
    assert shop.codes(gone[0]) == [Code.NOT_IN_CHAIN]
    shop.weld(9)
    assert shop.refused(9) == [Code.GAP]


def test_renumbered_entries_do_not_close_the_hole(shop: Shop) -> None:
    (shop.chain_folder / "000002.json").unlink()
    for number in (3, 4):
        for suffix in ("", ".sig"):
            name = f"{number:06d}.json{suffix}"
            (shop.chain_folder / name).rename(shop.chain_folder / f"{number - 1:06d}.json{suffix}")
    assert shop.chain_codes() == [Code.WRONG_NUMBER, Code.BROKEN_LINK, Code.WRONG_NUMBER]


def test_a_wrong_key_is_found(shop: Shop) -> None:
    make_key(shop.folder / "other")
    foreign = load_private(shop.folder / "other")
    shop.weld(9)
    with pytest.raises(EvidenceError) as caught:
        attest(Subject(shop.bag(9)), shop.chain_folder, foreign, NOW)
    assert {entry.code for entry in caught.value.findings} == {Code.KEY_UNKNOWN}
    attest(Subject(shop.bag(9)), shop.folder / "other_chain", foreign, NOW)
    for suffix in ("", ".sig"):
        name = f"000001.json{suffix}"
        shutil.copyfile(
            shop.folder / "other_chain" / name, shop.chain_folder / f"000005.json{suffix}"
        )
    assert shop.chain_codes() == shop.codes(9) == [Code.KEY_UNKNOWN]


def test_the_next_key_continues_the_chain_and_an_expired_one_does_not(shop: Shop) -> None:
    """The key of the first welds is valid until the day of the last of them."""
    make_key(shop.folder / "next")
    following, later = load_private(shop.folder / "next"), NOW + timedelta(days=1)
    until = [entry.changed(name="former", valid_until=NOW.date()) for entry in shop.trusted]
    trusted = (*until, TrustedKey(name="next", key=following.public))
    shop.weld(9)
    assert shop.refused(9, Policy(trusted), later) == [Code.KEY_EXPIRED]
    assert (
        attest(Subject(shop.bag(9)), shop.chain_folder, following, later, Policy(trusted)).number
        == COUNT + 1
    )
    assert read_chain(shop.chain_folder, trusted).findings == ()
    revoked = [entry.changed(name="former", revoked=NOW.date()) for entry in shop.trusted]
    chain = read_chain(shop.chain_folder, (*revoked, trusted[-1]))
    assert [entry.code for entry in chain.findings] == [Code.KEY_REVOKED] * COUNT


def test_a_key_revoked_later_is_proven_by_what_others_signed_before(shop: Shop) -> None:
    """Else its own clock is the only witness, which is said; what others signed later convicts it."""
    make_key(shop.folder / "next")
    following = load_private(shop.folder / "next")
    first, last = NOW + timedelta(days=2), NOW + timedelta(days=5)
    revoked = [
        entry.changed(name="former", revoked=(NOW + timedelta(days=4)).date())
        for entry in shop.trusted
    ]
    trusted = (*revoked, TrustedKey(name="next", key=following.public))

    def codes(number: int) -> tuple[list[Code], bool]:
        chain = read_chain(shop.chain_folder, trusted)
        result = verify_bag(shop.bag(number), Policy(trusted), last, chain)
        unknown = {entry.code for entry in result.not_checked}
        return [one.code for one in result.findings], Code.REVOCATION_BY_OWN_CLOCK in unknown

    assert codes(COUNT) == ([], True)
    shop.weld(8)
    attest(Subject(shop.bag(8)), shop.chain_folder, following, first, Policy(trusted))
    assert codes(COUNT) == ([], False) and codes(8) == ([], False)
    # the thief of the machine's key: its manifest states a time before the revocation
    make_key(shop.folder / "machine")
    machine = load_private(shop.folder / "machine")
    stolen = TrustedKey(name="machine", key=machine.public, revoked=first.date())
    before = Policy((*trusted, stolen.changed(revoked=None)))
    shop.weld(9, key=shop.folder / "machine")
    manifest = shop.bag(9) / MANIFEST_NAME
    early = NOW - timedelta(hours=1)
    signature = sign(manifest.read_bytes(), manifest.name, Purpose.MANIFEST, machine, early)
    signature_path(manifest).write_text(signature)
    trusted = (*trusted, stolen)
    with pytest.raises(EvidenceError) as refused:
        attest(Subject(shop.bag(9)), shop.chain_folder, following, last, Policy(trusted))
    found = {entry.code for entry in refused.value.findings}
    assert Code.KEY_REVOKED_BEFORE_SHOWN in found
    attest(Subject(shop.bag(9)), shop.chain_folder, following, last, before)
    assert codes(9) == ([Code.KEY_REVOKED_BEFORE_SHOWN], False)


def test_times_are_in_order(shop: Shop) -> None:
    shop.weld(9)
    assert shop.refused(9, now=datetime(2020, 1, 1, tzinfo=UTC)) == [
        Code.TIME_ORDER
    ]  # before the weld
    shop.attest(9, now=NOW - timedelta(days=1))  # before the attestation of the weld before
    assert shop.chain_codes() == [Code.TIME_ORDER]
    result = verify_bag(shop.bag(9), Policy(shop.trusted), NOW - timedelta(days=2))
    assert [entry.code for entry in result.findings] == [Code.TIME_ORDER]  # in the future


def test_a_weld_is_attested_once(shop: Shop) -> None:
    assert shop.refused(2) == [Code.ATTESTED_TWICE]
    shutil.copytree(shop.bag(2), shop.bag(9))
    assert shop.refused(9) == [Code.ATTESTED_TWICE]
    for suffix in ("", ".sig"):  # forced in
        shutil.copyfile(
            shop.chain_folder / f"000002.json{suffix}", shop.chain_folder / f"000005.json{suffix}"
        )
    assert Code.ATTESTED_TWICE in shop.chain_codes()


def test_a_canister_is_welded_once_unless_it_is_said(shop: Shop) -> None:
    shop.weld(9, canister=2)
    assert shop.refused(9) == [Code.CANISTER_TWICE]
    assert shop.attest(9, Policy(repeat=True)).repeats == 2
    assert shop.chain_codes() == [] and shop.codes(9) == []
    entries = read_chain(shop.chain_folder, shop.trusted).entries
    unsaid = replace(entries[-1], content=entries[-1].content.changed(repeats=None))
    assert [entry.code for entry in doubled([*entries[:-1], unsaid])] == [Code.CANISTER_TWICE]


@pytest.mark.parametrize("steps", range(1, 6))
def test_a_crash_while_attesting_is_mended_by_the_same_call(
    shop: Shop, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It dies before the step of this number."""
    shop.weld(9)
    write, count = evidence.write_whole, 0

    def dying(path: Path, text: str, **options: bool) -> None:
        nonlocal count
        count += 1
        if count == steps:
            raise KeyboardInterrupt
        write(path, text, **options)

    with monkeypatch.context() as patch:
        patch.setattr(evidence, "write_whole", dying)
        with pytest.raises(KeyboardInterrupt):
            shop.attest(9)
    assert shop.chain_codes() == []
    assert shop.attest(9).number == COUNT + 1
    assert shop.codes(9) == [] and shop.chain_codes() == []


def test_a_recorder_that_died_is_attested_on_demand_and_noted(shop: Shop) -> None:
    shop.weld(9, manifest=False)
    (shop.bag(9) / "metadata.yaml").unlink()
    file = shop.bag(9) / "weld_9_0.mcap"
    file.write_bytes(file.read_bytes()[:-300])
    assert shop.refused(9) == [Code.NO_MANIFEST, Code.HASHED_AFTERWARDS]
    attested = shop.attest(9, Policy(afterwards=True))
    codes = {note.code for note in attested.notes}
    assert codes >= {Code.NO_MANIFEST, Code.HASHED_AFTERWARDS, Code.BAG_DAMAGED}
    assert shop.codes(9) == []


def test_a_manifest_made_after_bag_recover_is_refused(shop: Shop) -> None:
    """Messages were dropped on the way, so the copy is not what was recorded."""
    shop.weld(9)
    recover(shop.bag(9), shop.folder / "copy", stop_ns=sample_messages(20).__next__()[1] + 10**9)
    shutil.rmtree(shop.bag(9))
    (shop.folder / "copy").rename(shop.bag(9))
    assert set(shop.refused(9)) == {Code.NO_MANIFEST, Code.HASHED_AFTERWARDS, Code.RECOVERED}
    # with a manifest as a recorder writes it
    recover(shop.bag(9), shop.bag(10), WriterOptions(manifest=True))
    assert shop.refused(10) == [Code.RECOVERED]


def test_a_manifest_that_the_recorder_did_not_sign_is_refused(shop: Shop) -> None:
    """The bag was recorded again from its messages, with a manifest as the recorder writes it but for its key."""
    machine = shop.folder / "machine"
    make_key(machine)
    trusted = (*shop.trusted, *load_trusted([shop.folder / "machine.pub"]))
    shop.weld(9, key=machine)
    signature = (shop.bag(9) / f"{MANIFEST_NAME}.sig").read_bytes()
    shutil.rmtree(shop.bag(9))
    shop.weld(9, ticks=19)
    policy = Policy(trusted, require_signed=True)
    assert shop.refused(9, policy) == [Code.MANIFEST_UNSIGNED, Code.PROCEDURE_UNSIGNED]
    (shop.bag(9) / f"{MANIFEST_NAME}.sig").write_bytes(signature)
    assert Code.CONTENT_CHANGED in shop.refused(9)
    make_key(shop.folder / "stranger")
    shop.weld(10, key=shop.folder / "stranger")
    assert shop.refused(10, Policy(trusted)) == [Code.KEY_UNKNOWN]
    assert Code.KEY_UNKNOWN in shop.refused(10, Policy(require_signed=True)), (
        "without any key that counts"
    )
    shop.weld(11, key=machine)
    soon = datetime.now(UTC) + timedelta(seconds=1)  # the recorder's signature is of now
    attested = shop.attest(11, Policy(trusted), soon)
    assert attested.recorder is not None
    result = verify_bag(shop.bag(11), Policy(trusted), soon)
    assert result.findings == [] and result.signers[Purpose.MANIFEST].key == attested.recorder.key
    only_attester = verify_bag(shop.bag(11), Policy(shop.trusted), soon)
    assert [entry.code for entry in only_attester.findings] == [Code.KEY_UNKNOWN]
    (shop.bag(11) / f"{MANIFEST_NAME}.sig").unlink()
    assert Code.OTHER_SIGNER in [
        entry.code for entry in verify_bag(shop.bag(11), Policy(trusted), soon).findings
    ]


def test_every_attested_document_is_checked_wherever_it_is(shop: Shop) -> None:
    shop.weld(9)
    inside, outside = shop.bag(9) / "record" / "note.txt", shop.folder / "report.txt"
    inside.parent.mkdir()
    for file in (inside, outside):
        file.write_text("as it was")
    attested = shop.attest(9, documents=[inside, outside])
    assert set(attested.documents_sha256) == {"record/note.txt", "report.txt"}
    result = shop.verified(9)
    assert result.findings == []
    assert {
        entry.file: entry.code for entry in result.not_checked if entry.file.endswith(".txt")
    } == {
        "record/note.txt": Code.DOCUMENT_FOREIGN,
        "report.txt": Code.DOCUMENT_ABSENT,
    }
    assert shop.codes(9, outside) == []
    assert shop.codes(1, outside) == [Code.NOT_ATTESTED]
    for file in (inside, outside):
        file.write_text("edited")
    assert shop.codes(9, outside) == [Code.DOCUMENT_CHANGED] * 2
    assert shop.codes(9) == [Code.DOCUMENT_CHANGED]  # also when it is not named


def test_what_is_no_bag_is_one_line(shop: Shop) -> None:
    for path in (shop.folder / "none", shop.bag(1) / "weld_1_0.mcap"):
        with pytest.raises(BagError, match="is not the folder of a bag"):
            attest(Subject(path), shop.chain_folder, shop.key, NOW)
        assert [entry.code for entry in verify_bag(path, Policy(shop.trusted), NOW).findings] == [
            Code.UNREADABLE
        ]


def test_the_manifest_says_what_the_schema_allows(shop: Shop) -> None:
    content = json.loads((shop.bag(1) / MANIFEST_NAME).read_text())
    assert content["format"] == "fsw_bag_manifest" and content["clock"]["source"] in (
        "kernel",
        "unknown",
    )
