"""Attested bags and their chain: every change is found, and nothing is lost by a crash."""

from __future__ import annotations

import base64
import json
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from fsw_analysis.rules import FactCode
from fsw_quality import evidence
from fsw_quality.attestation import Attestation, Chain
from fsw_quality.evidence import Policy, Subject, Verification, attest, verify_bag
from fsw_quality.record import proof_of
from fsw_recorder.bag_metadata import ATTESTATION_NAME
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError, Unchecked
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.recover import recover
from fsw_recorder.signature import (
    Purpose,
    Stated,
    TrustedKey,
    envelope,
    fingerprint,
    load_private,
    load_trusted,
    sign,
    signature_path,
)
from fsw_scenario import procedure
from fsw_test_support.keys import make_key
from fsw_test_support.sample_weld import sample_messages, sample_topics

pytest.importorskip(
    "cryptography", reason="not installed: pip install -r requirements/signing.lock"
)

NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)
COUNT = 4


class Shop:
    """Welds one after another, their chain and the key."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.chain_folder, self.key_path = folder, folder / "chain", folder / "key"

    @property
    def key(self) -> Any:
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

    def policy(self, *others: TrustedKey, **more: bool) -> Policy:
        return Policy((*self.trusted, *others), **more)

    def attest(
        self, number: int, policy: Policy | None = None, now: datetime = NOW, **more: Any
    ) -> Attestation:
        subject = Subject(self.bag(number), **more)
        return attest(subject, self.chain_folder, self.key, now, policy or self.policy())

    def refused(
        self, number: int, policy: Policy | None = None, now: datetime = NOW, **more: Any
    ) -> list[Code]:
        """Codes of why a bag is not attested."""
        with pytest.raises(EvidenceError) as caught:
            self.attest(number, policy, now, **more)
        assert "\n" not in str(caught.value)
        return [entry.code for entry in caught.value.findings]

    def chain_codes(self) -> list[Code]:
        return [entry.code for entry in Chain(self.chain_folder, self.trusted).findings]

    def verified(self, number: int) -> Verification:
        chain = Chain(self.chain_folder, self.trusted)
        return verify_bag(self.bag(number), Policy(self.trusted), NOW, chain)

    def codes(self, number: int) -> list[Code | Unchecked]:
        return [entry.code for entry in self.verified(number).findings]


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
    bag = shop.weld(9, key=shop.key_path)
    (listed, signed), wrong = proof_of(bag)
    assert (listed.code, signed.code, wrong) == (FactCode.AS_LISTED, FactCode.SIGNED, [])
    assert fingerprint(shop.trusted[0].key) in signed.data["signer"]
    content = (bag / MANIFEST_NAME).read_bytes()
    (bag / MANIFEST_NAME).write_bytes(content + b"\n")
    assert len(proof_of(bag)[1]) == 1
    (bag / MANIFEST_NAME).write_bytes(content)
    signature_path(bag / MANIFEST_NAME).unlink()
    assert proof_of(bag)[1] == []
    (bag / "weld_9_0.mcap").write_bytes(b"other")
    assert "weld_9_0.mcap" in proof_of(bag)[1][0]
    (bag / MANIFEST_NAME).unlink()
    assert proof_of(bag)[1] == []


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
    assert attested.signed_at == NOW
    assert attested.procedure == procedure.load("copper_lid").identity
    # a folder may be renamed, and what else is in it does not count
    shop.bag(2).rename(shop.bag(9))
    (shop.bag(9) / "record.json").write_text("{}")
    assert shop.codes(9) == []


def test_what_was_not_checked_is_said(shop: Shop) -> None:
    assert {entry.code for entry in shop.verified(2).not_checked} == {
        Unchecked.ALL_KEYS,
        Unchecked.CLOCK_UNKNOWN,
        Unchecked.NO_RECORD,
        Code.MANIFEST_UNSIGNED,
        Unchecked.PROCEDURE_NOT_RECORDED,
        Code.PROCEDURE_UNSIGNED,
    }
    named = [
        entry.changed(name="quality", valid_until=NOW.date() + timedelta(days=365))
        for entry in shop.trusted
    ]
    result = verify_bag(shop.bag(2), Policy(named), NOW)
    assert result.signers[Purpose.ATTESTATION].name == "quality"
    codes = {entry.code for entry in result.not_checked}
    assert Unchecked.NO_CHAIN in codes and Unchecked.ALL_KEYS not in codes
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
    [finding] = shop.verified(1).findings
    assert (finding.code, finding.file) == (Code.CHANGED, "weld_1_0.mcap")
    assert finding.place is not None and finding.place.parts[0].startswith("chunk ")
    assert shop.refused(1) == [Code.CHANGED]


def test_an_exchanged_bag_or_manifest_is_found(shop: Shop) -> None:
    for name in (MANIFEST_NAME, ATTESTATION_NAME):
        shutil.copyfile(shop.bag(3) / name, shop.bag(2) / name)
    wrong = [(entry.code, entry.file) for entry in shop.verified(2).findings]
    assert (Code.MISSING, "weld_3_0.mcap") in wrong
    assert (Code.NOT_ATTESTED, str(shop.bag(2) / "weld_2_0.mcap")) in wrong
    shutil.copyfile(shop.bag(3) / MANIFEST_NAME, shop.bag(1) / MANIFEST_NAME)
    wrong = [(entry.code, entry.file) for entry in shop.verified(1).findings]
    assert wrong == [(Code.CHANGED_SINCE, MANIFEST_NAME)]
    shutil.copyfile(shop.bag(3) / "metadata.yaml", shop.bag(4) / "metadata.yaml")  # canister C-3
    wrong = [(entry.code, entry.file) for entry in shop.verified(4).findings]
    assert wrong == [(Code.CHANGED, "metadata.yaml")]
    (shop.bag(3) / ATTESTATION_NAME).unlink()
    assert shop.codes(3) == [Code.MISSING]


def test_a_lost_file_is_missing_not_another_weld(shop: Shop) -> None:
    (shop.bag(2) / "weld_2_0.mcap").unlink()
    assert shop.codes(2) == [Code.MISSING]


def test_a_changed_attestation_is_found(shop: Shop) -> None:
    path = shop.bag(1) / ATTESTATION_NAME
    content = json.loads(path.read_text())
    payload = base64.b64decode(content["payload"])
    assert b"C-1" in payload
    content["payload"] = base64.b64encode(payload.replace(b"C-1", b"C-7")).decode()
    for text in (json.dumps(content), ""):
        path.write_text(text)
        assert shop.codes(1) == [Code.SIGNATURE_DAMAGED]


@pytest.mark.parametrize("gone", [(2,), (1, 2, 3)])
def test_a_missing_weld_leaves_a_hole(shop: Shop, gone: tuple[int, ...]) -> None:
    for number in gone:
        (shop.chain_folder / f"{number:06d}.json").unlink()
    [finding] = Chain(shop.chain_folder, shop.trusted).findings
    assert (finding.code, finding.data) == (Code.BROKEN_LINK, {"number": gone[-1] + 1})
    assert shop.codes(gone[0]) == [Code.NOT_IN_CHAIN]
    shop.weld(9)
    assert shop.refused(9) == [Code.BROKEN_LINK]


def test_renumbered_entries_do_not_close_the_hole(shop: Shop) -> None:
    (shop.chain_folder / "000002.json").unlink()
    for number in (3, 4):
        name = f"{number:06d}.json"
        (shop.chain_folder / name).rename(shop.chain_folder / f"{number - 1:06d}.json")
    assert shop.chain_codes() == [Code.BROKEN_LINK] * 2


def test_an_exchanged_entry_breaks_the_link_behind_it(shop: Shop) -> None:
    """Also one that its signer made again, which is in itself intact."""
    path = shop.chain_folder / "000002.json"
    made = Chain(shop.chain_folder, shop.trusted).entries[1]
    stated = made.predicate.changed(identity={"canister": "C-7"})
    path.write_text(envelope(made.sha256, Purpose.ATTESTATION, stated, shop.key))
    [finding] = Chain(shop.chain_folder, shop.trusted).findings
    assert (finding.code, finding.file) == (Code.BROKEN_LINK, "000003.json")
    assert shop.codes(2) == [Code.NOT_IN_CHAIN]


def test_a_wrong_key_is_found(shop: Shop) -> None:
    make_key(shop.folder / "other")
    foreign = load_private(shop.folder / "other")
    shop.weld(9)
    with pytest.raises(EvidenceError) as caught:
        attest(Subject(shop.bag(9)), shop.chain_folder, foreign, NOW, shop.policy())
    assert {entry.code for entry in caught.value.findings} == {Code.KEY_UNKNOWN}
    own = Policy(load_trusted([shop.folder / "other.pub"]))
    attest(Subject(shop.bag(9)), shop.folder / "other_chain", foreign, NOW, own)
    shutil.copyfile(shop.folder / "other_chain" / "000001.json", shop.chain_folder / "000005.json")
    assert shop.chain_codes() == shop.codes(9) == [Code.KEY_UNKNOWN]


def test_the_next_key_continues_the_chain_and_an_expired_one_does_not(shop: Shop) -> None:
    """The key of the first welds is valid until the day of the last of them."""
    make_key(shop.folder / "next")
    following, later = load_private(shop.folder / "next"), NOW + timedelta(days=1)
    until = [entry.changed(name="former", valid_until=NOW.date()) for entry in shop.trusted]
    trusted = (*until, TrustedKey(name="next", key=following.public_key.keyid))
    shop.weld(9)
    assert shop.refused(9, Policy(trusted), later) == [Code.KEY_EXPIRED]
    assert (
        attest(Subject(shop.bag(9)), shop.chain_folder, following, later, Policy(trusted)).number
        == COUNT + 1
    )
    assert Chain(shop.chain_folder, trusted).findings == []
    revoked = [entry.changed(name="former", revoked=NOW.date()) for entry in shop.trusted]
    chain = Chain(shop.chain_folder, (*revoked, trusted[-1]))
    assert [entry.code for entry in chain.findings] == [Code.KEY_REVOKED] * COUNT


def test_a_key_revoked_later_is_proven_by_what_others_signed_before(shop: Shop) -> None:
    """Else its own clock is the only witness, which is said.

    What others signed later convicts it.
    """
    make_key(shop.folder / "next")
    following = load_private(shop.folder / "next")
    first, last = NOW + timedelta(days=2), NOW + timedelta(days=5)
    revoked = [
        entry.changed(name="former", revoked=(NOW + timedelta(days=4)).date())
        for entry in shop.trusted
    ]
    trusted = (*revoked, TrustedKey(name="next", key=following.public_key.keyid))

    def codes(number: int) -> tuple[list[Code], bool]:
        chain = Chain(shop.chain_folder, trusted)
        result = verify_bag(shop.bag(number), Policy(trusted), last, chain)
        unknown = {entry.code for entry in result.not_checked if entry.line}
        return [
            finding.code for finding in result.findings
        ], Unchecked.REVOCATION_BY_OWN_CLOCK in unknown

    assert codes(COUNT) == ([], True)
    shop.weld(8)
    attest(Subject(shop.bag(8)), shop.chain_folder, following, first, Policy(trusted))
    assert codes(COUNT) == ([], False) and codes(8) == ([], False)
    # the thief of the machine's key: its manifest states a time before the revocation
    make_key(shop.folder / "machine")
    machine = load_private(shop.folder / "machine")
    stolen = TrustedKey(name="machine", key=machine.public_key.keyid, revoked=first.date())
    before = Policy((*trusted, stolen.changed(revoked=None)))
    shop.weld(9, key=shop.folder / "machine")
    manifest = shop.bag(9) / MANIFEST_NAME
    early = NOW - timedelta(hours=1)
    signature = sign(manifest.read_bytes(), manifest.name, Purpose.MANIFEST, machine, early)
    signature_path(manifest).write_text(signature)
    trusted = (*trusted, stolen)
    with pytest.raises(EvidenceError) as refused:
        attest(Subject(shop.bag(9)), shop.chain_folder, following, last, Policy(trusted))
    reasons = {entry.code for entry in refused.value.findings}
    assert Code.KEY_REVOKED in reasons
    attest(Subject(shop.bag(9)), shop.chain_folder, following, last, before)
    assert codes(9) == ([Code.KEY_REVOKED], False)


def test_times_are_in_order(shop: Shop) -> None:
    shop.weld(9)
    assert shop.refused(9, now=datetime(2020, 1, 1, tzinfo=UTC)) == [
        Code.TIME_ORDER
    ]  # before the weld
    early = NOW - timedelta(days=1)  # before the attestation of the weld before
    assert shop.refused(9, now=early) == [Code.TIME_ORDER]
    last = Chain(shop.chain_folder, shop.trusted).entries[-1]
    stated = last.predicate.changed(signed_at=early)
    path, intact = shop.chain_folder / f"{COUNT:06d}.json", last.data
    path.write_text(envelope(last.sha256, Purpose.ATTESTATION, stated, shop.key))
    assert shop.chain_codes() == [Code.TIME_ORDER]
    path.write_bytes(intact)
    shop.attest(9)
    result = verify_bag(shop.bag(9), Policy(shop.trusted), NOW - timedelta(days=2))
    assert [entry.code for entry in result.findings] == [Code.TIME_ORDER]  # in the future


def test_a_weld_is_attested_once(shop: Shop) -> None:
    assert shop.refused(2) == [Code.ATTESTED_TWICE]
    shutil.copytree(shop.bag(2), shop.bag(9))
    assert shop.refused(9) == [Code.ATTESTED_TWICE]
    shutil.copyfile(shop.chain_folder / "000002.json", shop.chain_folder / "000005.json")
    assert Code.ATTESTED_TWICE in shop.chain_codes()


def test_a_canister_is_welded_once(shop: Shop) -> None:
    shop.weld(9, canister=2)
    assert shop.refused(9) == [Code.CANISTER_TWICE]
    chain = Chain(shop.chain_folder, shop.trusted)
    stated = chain.entries[-1].predicate.changed(
        number=COUNT + 1, previous_sha256=chain.last_sha256
    )
    other = envelope({"other_0.mcap": "0" * 64}, Purpose.ATTESTATION, stated, shop.key)
    (shop.chain_folder / f"{COUNT + 1:06d}.json").write_text(other)
    assert shop.chain_codes() == [Code.CANISTER_TWICE]


@pytest.mark.parametrize("steps", [1, 2])
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


def test_a_bag_whose_recorder_was_killed_is_attested_as_such(shop: Shop) -> None:
    """It is noted, and refused where signatures are required.

    What is changed afterwards is found.
    """
    shop.weld(9, manifest=False)
    (shop.bag(9) / "metadata.yaml").unlink()
    file = shop.bag(9) / "weld_9_0.mcap"
    file.write_bytes(file.read_bytes()[:-300])
    unsigned = {Code.NO_MANIFEST, Code.MANIFEST_UNSIGNED, Code.PROCEDURE_ABSENT}
    assert set(shop.refused(9, shop.policy(require_signed=True))) == unsigned
    noted = {entry.code for entry in shop.attest(9).notes}
    assert noted == {
        *unsigned,
        Unchecked.BAG_DAMAGED,
        Unchecked.CLOCK_UNKNOWN,
        Unchecked.NO_RECORD,
    }
    assert shop.codes(9) == []
    assert noted <= {entry.code for entry in shop.verified(9).not_checked}
    file.write_bytes(file.read_bytes()[:-1])
    assert shop.codes(9) == [Code.CHANGED_SINCE]
    shutil.copyfile(shop.bag(1) / MANIFEST_NAME, shop.bag(9) / MANIFEST_NAME)
    assert set(shop.codes(9)) == {Code.CHANGED_SINCE, Code.NOT_ATTESTED}


def test_a_bag_of_which_the_recorder_did_not_hash_all(shop: Shop) -> None:
    shop.weld(9)
    shutil.copyfile(shop.bag(1) / "weld_1_0.mcap", shop.bag(9) / "weld_9_1.mcap")
    assert shop.refused(9) == [Code.UNLISTED]
    path = shop.bag(1) / MANIFEST_NAME
    path.write_text(path.read_text().replace("while_recording", "afterwards"))
    shutil.rmtree(shop.chain_folder)
    assert set(shop.refused(1)) == {Code.HASHED_AFTERWARDS}, "as earlier versions completed it"


def test_a_manifest_made_after_bag_recover_is_refused(shop: Shop) -> None:
    """Messages were dropped on the way, so the copy is not what was recorded."""
    shop.weld(9)
    recover(shop.bag(9), shop.folder / "copy", stop_ns=sample_messages(20).__next__()[1] + 10**9)
    shutil.rmtree(shop.bag(9))
    (shop.folder / "copy").rename(shop.bag(9))
    assert shop.refused(9) == [Code.RECOVERED]
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
    assert shop.refused(9, policy) == [Code.MANIFEST_UNSIGNED, Code.PROCEDURE_ABSENT]
    (shop.bag(9) / f"{MANIFEST_NAME}.sig").write_bytes(signature)
    assert Code.CONTENT_CHANGED in shop.refused(9, Policy(trusted))
    make_key(shop.folder / "stranger")
    shop.weld(10, key=shop.folder / "stranger")
    assert shop.refused(10, Policy(trusted)) == [Code.KEY_UNKNOWN]
    shop.weld(11, key=machine)
    soon = datetime.now(UTC) + timedelta(seconds=1)  # the recorder's signature is of now
    shop.attest(11, Policy(trusted), soon)
    result = verify_bag(shop.bag(11), Policy(trusted), soon)
    assert result.findings == () and result.signers[Purpose.MANIFEST].name == "machine"
    only_attester = verify_bag(shop.bag(11), Policy(shop.trusted), soon)
    assert [entry.code for entry in only_attester.findings] == [Code.KEY_UNKNOWN]
    (shop.bag(11) / f"{MANIFEST_NAME}.sig").unlink()
    result = verify_bag(shop.bag(11), Policy(trusted), soon)
    assert [(entry.code, entry.file) for entry in result.findings] == [
        (Code.MISSING, f"{MANIFEST_NAME}.sig")
    ]


def test_what_is_no_bag_is_one_line(shop: Shop) -> None:
    for path in (shop.folder / "none", shop.bag(1) / "weld_1_0.mcap"):
        with pytest.raises(BagError, match=path.name):
            attest(Subject(path), shop.chain_folder, shop.key, NOW, shop.policy())
        [finding] = verify_bag(path, Policy(shop.trusted), NOW).findings
        assert finding.code in (Code.MISSING, Code.UNREADABLE)


def test_the_manifest_says_what_the_schema_allows(shop: Shop) -> None:
    content = json.loads((shop.bag(1) / MANIFEST_NAME).read_text())
    assert content["format"] == "fsw_bag_manifest" and content["clock"]["source"] in (
        "kernel",
        "unknown",
    )


def test_a_renamed_entry_is_not_overwritten(shop: Shop) -> None:
    last = shop.chain_folder / f"{COUNT:06d}.json"
    content = last.read_bytes()
    renamed = last.rename(shop.chain_folder / f"{COUNT + 1:06d}.json")
    shop.weld(9)
    assert shop.refused(9) == [Code.BROKEN_LINK]
    assert renamed.read_bytes() == content


def test_a_log_of_an_sqlite_file_belongs_to_the_bag(shop: Shop) -> None:
    bag = shop.weld(9)
    shop.attest(9)
    (bag / "weld_9_0.db3-wal").write_bytes(b"x")
    assert shop.codes(9) == [Code.NOT_ATTESTED]


def test_an_entry_of_another_form_is_a_finding(shop: Shop) -> None:
    """Also one whose attestation states what this version does not know."""
    last = Chain(shop.chain_folder, shop.trusted).entries[-1]

    class Later(Attestation):
        another: int

    stated = Later(**dict(last.predicate), another=1)
    for predicate in (stated, Stated(signed_at=NOW)):
        data = envelope(last.sha256, Purpose.ATTESTATION, predicate, shop.key)
        (shop.chain_folder / "000099.json").write_text(data)
        assert shop.chain_codes() == [Code.SIGNATURE_DAMAGED]
