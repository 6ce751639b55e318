"""Attested bags and their chain: every change is told, and nothing is lost by a crash."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from fsw_quality import attestation, procedure
from fsw_quality.attestation import ATTESTATION_NAME, attest, read_chain, statement, verify_bag
from fsw_quality.signature import PublicKey, load_private, load_public, make_key
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.recover_proven import recover_proven
from fsw_schema.models import InputError
from fsw_test_support.sample_weld import sample_messages, sample_topics

pytest.importorskip("cryptography", reason="not installed: pip install -r requirements/quality.lock")

NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)
COUNT = 4


class Shop:
    """Welds one after another, their chain and the key."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.chain_folder, self.key_path = folder, folder / "chain", folder / "key"

    @property
    def key(self) -> attestation.Ed25519PrivateKey:
        return load_private(self.key_path)

    @property
    def trusted(self) -> list[PublicKey]:
        return [load_public(self.folder / "key.pub")]

    def bag(self, number: int) -> Path:
        return self.folder / f"weld_{number}"

    def weld(self, number: int, manifest: bool = True) -> Path:
        with BagWriter(self.bag(number), WriterOptions(manifest=manifest), {"canister": f"C-{number}"}) as writer:
            for topic in sample_topics():
                writer.add_topic(topic)
            writer.attach("versions.json", "application/json", b'{"numpy": "2.0"}')
            for count, (name, time_ns, data) in enumerate(sample_messages(20)):
                writer.write(name, data, time_ns + number, time_ns + number)
                if count % 50 == 0:
                    writer.flush()
        return self.bag(number)

    def attest(self, number: int, **more: object) -> attestation.Attestation:
        return attest(self.bag(number), self.chain_folder, self.key, NOW, **more)  # type: ignore[arg-type]

    def chain_problems(self) -> tuple[str, ...]:
        return read_chain(self.chain_folder, self.trusted).problems

    def findings(self, number: int) -> list[str]:
        chain = read_chain(self.chain_folder, self.trusted)
        return [one.line for one in verify_bag(self.bag(number), self.trusted, chain)[1]]


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    shop = Shop(tmp_path_factory.mktemp("shop"))
    make_key(shop.key_path)
    for number in range(1, COUNT + 1):
        shop.weld(number)
        shop.attest(number, procedure=procedure.load("copper_lid").identity)
    return shop.folder


@pytest.fixture
def shop(original: Path, tmp_path: Path) -> Shop:
    return Shop(Path(shutil.copytree(original, tmp_path / "shop")))


def test_a_record_can_say_whether_the_bag_is_what_was_recorded_and_who_signed(shop: Shop) -> None:
    bag = shop.bag(2)
    told, wrong = statement(bag)
    signer = shop.trusted[0].fingerprint
    assert told == [
        "2 files as manifest.json has them",
        f"attested as weld 2 at {NOW.isoformat()}, signed by key {signer}",
    ]
    assert wrong == []
    signature = (bag / "attestation.json.sig").read_text()
    (bag / "attestation.json.sig").write_bytes((shop.bag(3) / "attestation.json.sig").read_bytes())
    told, wrong = statement(bag)
    assert "the signature does not fit" in told[-1] and len(wrong) == 1
    (bag / "attestation.json.sig").write_text(signature)
    (bag / MANIFEST_NAME).write_bytes((bag / MANIFEST_NAME).read_bytes() + b"\n")
    assert "not as it was attested: manifest.json: is not the manifest that was signed" in statement(bag)[1][0]
    (bag / ATTESTATION_NAME).unlink()
    assert statement(bag) == (["2 files as manifest.json has them", "not attested when this was written"], [])
    (bag / "weld_2_0.mcap").write_bytes(b"other")
    assert "not as manifest.json has it: weld_2_0.mcap" in statement(bag)[1][0]
    (bag / MANIFEST_NAME).unlink()
    assert statement(bag) == (["no manifest.json: whether the files are what was recorded is not known"], [])


def test_what_was_not_touched_is_proven(shop: Shop) -> None:
    assert shop.chain_problems() == () and [shop.findings(number) for number in range(1, COUNT + 1)] == [[]] * COUNT
    attested, _ = verify_bag(shop.bag(2), shop.trusted)
    assert attested is not None and attested.number == 2 and attested.identity == {"canister": "C-2"}
    assert attested.software == {"numpy": "2.0"} and attested.notes == ()
    assert attested.procedure == procedure.load("copper_lid").identity
    # a folder may be renamed, and what else is in it does not count
    shop.bag(2).rename(shop.bag(9))
    (shop.bag(9) / "record.json").write_text("{}")
    assert shop.findings(9) == []


def test_damage_is_told_with_file_and_chunk(shop: Shop) -> None:
    file = shop.bag(1) / "weld_1_0.mcap"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    [line] = shop.findings(1)
    assert line.startswith("weld_1_0.mcap: chunk ") and "not what was recorded" in line
    with pytest.raises(BagError, match=r"cannot be attested: weld_1_0\.mcap: chunk"):
        shop.attest(1)
    recover_proven(shop.bag(1), shop.bag(8), (ATTESTATION_NAME, f"{ATTESTATION_NAME}.sig"))
    attested, found = verify_bag(shop.bag(8), shop.trusted)
    assert attested is not None and attested.number == 1
    assert sum("chunk" in one.text for one in found) == 1


def test_an_exchanged_bag_or_manifest_is_told(shop: Shop) -> None:
    for name in (MANIFEST_NAME, ATTESTATION_NAME, f"{ATTESTATION_NAME}.sig"):
        shutil.copyfile(shop.bag(3) / name, shop.bag(2) / name)
    assert shop.findings(2) == [
        f"{ATTESTATION_NAME}: belongs to another weld (bag weld_3, canister C-3): none of its files is here"
    ]
    shutil.copyfile(shop.bag(3) / MANIFEST_NAME, shop.bag(1) / MANIFEST_NAME)
    assert "manifest.json: is not the manifest that was signed" in shop.findings(1)[0]
    shutil.copyfile(shop.bag(3) / "metadata.yaml", shop.bag(4) / "metadata.yaml")
    assert shop.findings(4)[0] == f"{ATTESTATION_NAME}: has canister C-4, metadata.yaml has C-3"
    (shop.bag(3) / ATTESTATION_NAME).unlink()
    assert "No such file" in shop.findings(3)[0]


def test_a_lost_file_is_missing_not_another_weld(shop: Shop) -> None:
    (shop.bag(2) / "weld_2_0.mcap").unlink()
    assert shop.findings(2) == ["weld_2_0.mcap: is missing"]


def test_documents_of_one_name_are_refused(shop: Shop) -> None:
    """They are listed by their names, so only one of them would be signed for."""
    files = [shop.folder / name / "record.json" for name in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("{}")
    shop.weld(9)
    with pytest.raises(InputError, match=r"two of the files to attest have the name record\.json"):
        shop.attest(9, documents=files)


def test_a_changed_attestation_is_told(shop: Shop) -> None:
    path = shop.bag(1) / ATTESTATION_NAME
    path.write_text(path.read_text().replace("C-1", "C-7"))
    assert "changed after it was signed" in shop.findings(1)[0]


@pytest.mark.parametrize(("gone", "said"), [((2,), "weld 2 is missing"), ((1, 2, 3), "welds 1 to 3 are missing")])
def test_a_missing_weld_leaves_a_hole(shop: Shop, gone: tuple[int, ...], said: str) -> None:
    for number in gone:
        (shop.chain_folder / f"{number:06d}.json").unlink()
    assert [said in one for one in shop.chain_problems()] == [True]
    assert "is not in the chain" in shop.findings(gone[0])[-1]
    shop.weld(9)
    with pytest.raises(InputError, match="chain cannot be continued"):
        shop.attest(9)


def test_numbers_written_anew_do_not_close_the_hole(shop: Shop) -> None:
    (shop.chain_folder / "000002.json").unlink()
    for number in (3, 4):
        for suffix in ("", ".sig"):
            name = f"{number:06d}.json{suffix}"
            (shop.chain_folder / name).rename(shop.chain_folder / f"{number - 1:06d}.json{suffix}")
    found = " ".join(shop.chain_problems())
    assert "is the attestation of weld 3, not of weld 2" in found and "does not follow 000001.json" in found


def test_a_wrong_key_is_told(shop: Shop) -> None:
    make_key(shop.folder / "other")
    foreign = load_private(shop.folder / "other")
    shop.weld(9)
    with pytest.raises(InputError, match="is not the trusted one"):
        attest(shop.bag(9), shop.chain_folder, foreign, NOW)
    attest(shop.bag(9), shop.folder / "other_chain", foreign, NOW)
    for suffix in ("", ".sig"):
        name = f"000001.json{suffix}"
        shutil.copyfile(shop.folder / "other_chain" / name, shop.chain_folder / f"000005.json{suffix}")
    assert ["which is not the trusted one" in one for one in shop.chain_problems()] == [True]
    assert "which is not the trusted one" in shop.findings(9)[0]


def test_a_whole_chain_by_another_key_is_one_line(shop: Shop) -> None:
    make_key(shop.folder / "stranger")
    (problem,) = read_chain(shop.chain_folder, [load_public(shop.folder / "stranger.pub")]).problems
    assert problem.startswith(f"{shop.chain_folder}: weld 1 and those after it, to 4: signed by key SHA256:")


def test_a_weld_is_attested_once(shop: Shop) -> None:
    with pytest.raises(BagError, match=r"is in .*chain already, as weld 2 \(weld_2\)"):
        shop.attest(2)
    copy = shutil.copytree(shop.bag(2), shop.bag(9))
    with pytest.raises(BagError, match="already, as weld 2"):
        attest(Path(copy), shop.chain_folder, shop.key, NOW)
    for suffix in ("", ".sig"):  # forced in
        shutil.copyfile(shop.chain_folder / f"000002.json{suffix}", shop.chain_folder / f"000005.json{suffix}")
    assert "a second attestation of the weld of number 2" in " ".join(shop.chain_problems())


@pytest.mark.parametrize("steps", range(1, 6))
def test_a_crash_while_attesting_is_mended_by_the_same_call(
    shop: Shop, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It dies before the step of this number."""
    shop.weld(9)
    write, count = attestation.write_whole, 0

    def dying(path: Path, text: str, **options: bool) -> None:
        nonlocal count
        count += 1
        if count == steps:
            raise KeyboardInterrupt
        write(path, text, **options)

    with monkeypatch.context() as patch:
        patch.setattr(attestation, "write_whole", dying)
        with pytest.raises(KeyboardInterrupt):
            shop.attest(9)
    assert shop.chain_problems() == ()
    assert shop.attest(9).number == COUNT + 1
    assert shop.findings(9) == [] and shop.chain_problems() == ()


def test_a_recorder_that_died_is_noted(shop: Shop) -> None:
    shop.weld(9, manifest=False)
    (shop.bag(9) / "metadata.yaml").unlink()
    file = shop.bag(9) / "weld_9_0.mcap"
    file.write_bytes(file.read_bytes()[:-300])
    attested = shop.attest(9)
    notes = " ".join(attested.notes)
    assert "no manifest.json: the recorder was killed" in notes and "not finished" in notes
    assert "weld_9_0.mcap: hashed afterwards" in notes
    assert shop.findings(9) == []


def test_documents_are_attested_too(shop: Shop) -> None:
    shop.weld(9)
    record = shop.folder / "record.json"
    record.write_text("{}")
    shop.attest(9, documents=[record])
    assert verify_bag(shop.bag(9), shop.trusted, None, [record])[1] == []
    assert "was not attested" in verify_bag(shop.bag(1), shop.trusted, None, [record])[1][0].line
    record.write_text('{"verdict": "accept"}')
    assert "is not the file that was attested" in verify_bag(shop.bag(9), shop.trusted, None, [record])[1][0].line


def test_what_is_no_bag_is_one_line(shop: Shop) -> None:
    for path in (shop.folder / "none", shop.bag(1) / "weld_1_0.mcap"):
        with pytest.raises(BagError, match="is not the folder of a bag"):
            attest(path, shop.chain_folder, shop.key, NOW)
        assert "is not the folder of a bag" in verify_bag(path, shop.trusted)[1][0].line


def test_the_manifest_says_what_the_schema_allows(shop: Shop) -> None:
    content = json.loads((shop.bag(1) / MANIFEST_NAME).read_text())
    assert content["format"] == "fsw_bag_manifest" and content["clock"]["source"] == "unknown"
