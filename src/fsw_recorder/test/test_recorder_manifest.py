"""The manifest finds every change of a bag and names the place."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fsw_control.schema.models import InputError, validate
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, EvidenceError
from fsw_recorder.manifest import (
    MANIFEST_NAME,
    FileManifest,
    Manifest,
    check_file,
    check_files,
    hashed,
    mapped,
    read_manifest,
)
from fsw_recorder.signature import Purpose, load_trusted, signer_of
from fsw_test_support.keys import make_key
from fsw_test_support.sample_weld import sample_messages, sample_topics

START_NS = 10**18
FILES = ("weld_0.mcap", "weld_1.mcap")


def write_weld(
    folder: Path, ticks: int = 40, split: bool = True, options: WriterOptions | None = None
) -> Path:
    """A bag of two files with chunks of about ten ticks, and an attachment in each."""
    with BagWriter(
        folder, options or WriterOptions(manifest=True), {"canister": "C-117"}
    ) as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        writer.attach("scenario.yaml", "application/yaml", b"name: test\n")
        for count, (name, time_ns, data) in enumerate(sample_messages(ticks)):
            writer.write(name, data, time_ns, time_ns)
            if count % 100 == 0:
                writer.flush()
            if split and count == 300:
                writer.split()
                writer.attach("more.txt", "text/plain", b"more")
    assert writer.error is None
    return folder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return write_weld(tmp_path_factory.mktemp("recorded") / "weld")


@pytest.fixture(scope="module")
def manifest(recorded: Path) -> Manifest:
    read = read_manifest(recorded)
    assert read is not None
    return read


@pytest.fixture
def bag(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "weld"))


def file_of(manifest: Manifest, name: str) -> FileManifest:
    return next(file for file in manifest.files if file.name == name)


def place(listed: FileManifest, kind: str, number: int) -> tuple[int, int, int]:
    """Index, begin and end of a piece of a kind, from 1."""
    rows = [row for row, piece in enumerate(listed.pieces) if piece.kind == kind]
    row = rows[number - 1]
    return row, listed.pieces[row - 1].end if row else 0, listed.pieces[row].end


def test_the_recorder_lists_every_byte(recorded: Path, manifest: Manifest) -> None:
    assert [file.name for file in manifest.files] == [*FILES, "metadata.yaml"]
    assert manifest.bag == "weld" and manifest.custom_data == {"canister": "C-117"}
    assert set(manifest.attachments_sha256) == {"scenario.yaml", "more.txt"}
    assert check_files(recorded, manifest) == []
    for listed in manifest.files:
        assert listed.pieces[-1].end == listed.bytes == (recorded / listed.name).stat().st_size
        assert listed.hashed == "while_recording"
    chunks = [piece for piece in manifest.files[0].pieces if piece.kind == "chunk"]
    assert len(chunks) >= 3 and all(chunk.begin_ns is not None for chunk in chunks)


def test_afterwards_the_chunks_are_the_same(recorded: Path, manifest: Manifest) -> None:
    for name in FILES:
        listed, now = file_of(manifest, name), hashed(name, mapped(recorded / name), "afterwards")
        assert now.sha256 == listed.sha256 and now.hashed == "afterwards"
        assert [piece for piece in now.pieces if piece.kind != "other"] == [
            piece for piece in listed.pieces if piece.kind != "other"
        ]


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_flipped_bit_is_found_and_its_chunk_named(
    recorded: Path, manifest: Manifest, tmp_path: Path, data: st.DataObject
) -> None:
    listed = data.draw(st.sampled_from(manifest.files))
    content = bytearray((recorded / listed.name).read_bytes())
    offset = data.draw(st.integers(0, len(content) - 1))
    content[offset] ^= 1 << data.draw(st.integers(0, 7))
    (tmp_path / listed.name).write_bytes(content)
    findings = check_file(tmp_path / listed.name, listed)
    row = next(row for row, piece in enumerate(listed.pieces) if offset < piece.end)
    assert len(findings) == 1 and findings[0].pieces == (row,) and findings[0].file == listed.name
    if listed.pieces[row].kind == "chunk":
        number = sum(piece.kind == "chunk" for piece in listed.pieces[: row + 1])
        assert findings[0].place is not None and findings[0].place.parts == (f"chunk {number}",)
        assert (
            findings[0].place.begin_s is not None
            and findings[0].place.begin <= offset < findings[0].place.end
        )


def test_removed_chunk_is_named_and_later_chunks_stay_proven(
    bag: Path, manifest: Manifest
) -> None:
    listed = file_of(manifest, FILES[0])
    row, begin, end = place(listed, "chunk", 2)
    content = (bag / FILES[0]).read_bytes()
    (bag / FILES[0]).write_bytes(content[:begin] + content[end:])
    [damage] = check_files(bag, manifest)
    assert (damage.code, damage.pieces, damage.data["listed_bytes"]) == (
        Code.CHANGED,
        (row,),
        listed.bytes,
    )
    assert damage.place is not None and damage.place.parts == ("chunk 2",)


def test_removed_message_is_reported(
    bag: Path, recorded: Path, manifest: Manifest, tmp_path: Path
) -> None:
    """Everything copied but one message: the checksums inside the file are right again."""
    with BagReader(recorded / FILES[0]) as reader, BagWriter(tmp_path / "weld_other") as writer:
        for topic in reader.topics().values():
            writer.add_topic(topic)
        for count, record in enumerate(reader.records()):
            if count != 20:
                writer.write(
                    record.topic,
                    record.data,
                    record.log_time_ns,
                    record.publish_time_ns,
                    record.sequence,
                )
    shutil.copyfile(tmp_path / "weld_other" / "weld_other_0.mcap", bag / FILES[0])
    [damage] = check_files(bag, manifest)
    assert (damage.file, damage.code) == (FILES[0], Code.OTHER_FILE)


def test_exchanged_missing_and_added_files_are_reported(bag: Path, manifest: Manifest) -> None:
    first, second = (bag / name for name in FILES)
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)
    assert [(item.file, item.code) for item in check_files(bag, manifest)] == [
        (FILES[0], Code.OTHER_FILE),
        (FILES[1], Code.OTHER_FILE),
    ]
    first.unlink()
    (bag / "weld_2.mcap").write_bytes(content)
    codes = {item.file: item.code for item in check_files(bag, manifest)}
    assert codes[FILES[0]] is Code.MISSING and codes["weld_2.mcap"] is Code.UNLISTED


def test_reordering_and_additions_are_reported(bag: Path, manifest: Manifest) -> None:
    listed = file_of(manifest, FILES[0])
    content = (bag / FILES[0]).read_bytes()
    (_, begin, middle), (_, _, end) = place(listed, "chunk", 1), place(listed, "chunk", 2)
    swapped = content[:begin] + content[middle:end] + content[begin:middle] + content[end:]
    (bag / FILES[0]).write_bytes(swapped)
    assert [item.code for item in check_files(bag, manifest)] == [Code.REORDERED]
    (bag / FILES[0]).write_bytes(content + b"more")
    assert [item.code for item in check_files(bag, manifest)] == [Code.REORDERED]


def test_crash_before_the_manifest_loses_no_data_and_is_reported(
    bag: Path, manifest: Manifest
) -> None:
    """The first file was closed, the recorder was killed in the second."""
    partial = manifest.changed(files=manifest.files[:1])
    cut = (bag / FILES[1]).read_bytes()[:-200]
    (bag / FILES[1]).write_bytes(cut)
    assert {(entry.code, entry.file) for entry in check_files(bag, partial)} == {
        (Code.UNLISTED, FILES[1]),
        (Code.UNLISTED, "metadata.yaml"),
    }


@pytest.mark.parametrize(
    "text", ["", "{}", "[1", '{"format": "fsw_bag_manifest", "version": 2}', "[" * 100000]
)
def test_invalid_manifest_error_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / MANIFEST_NAME).write_text(text)
    with pytest.raises(BagError, match=r"manifest\.json"):
        read_manifest(tmp_path)


def test_the_recorder_signs_the_manifest_when_it_closes(tmp_path: Path) -> None:
    pytest.importorskip(
        "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
    )
    make_key(tmp_path / "machine")
    options = WriterOptions(manifest=True, signing_key=str(tmp_path / "machine"))
    bag = write_weld(tmp_path / "weld", 3, options=options)
    trusted = load_trusted([tmp_path / "machine.pub"])
    assert signer_of(bag / MANIFEST_NAME, Purpose.MANIFEST, trusted).name == "machine"
    text = (bag / MANIFEST_NAME).read_text()
    (bag / MANIFEST_NAME).write_text(text.replace("C-117", "C-118"))
    with pytest.raises(EvidenceError) as caught:
        signer_of(bag / MANIFEST_NAME, Purpose.MANIFEST, trusted)
    assert caught.value.findings[0].code is Code.CONTENT_CHANGED
    with pytest.raises(InputError):
        BagWriter(
            tmp_path / "other", WriterOptions(manifest=True, signing_key=str(tmp_path / "none"))
        )
    assert not (tmp_path / "other").exists()


def test_a_failed_disk_leaves_a_manifest_of_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with BagWriter(tmp_path / "weld", WriterOptions(manifest=True)) as writer:
        for name, time_ns, data in sample_messages(5):
            writer.write(name, data, time_ns, time_ns)
        assert writer.flush()

        def full(*_: object) -> int:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr("fsw_recorder.bag_file.os.write", full)
            writer.write("/x", b"", START_NS, START_NS)
            writer.flush()
            writer.close()
    assert writer.error is not None
    read = read_manifest(tmp_path / "weld")
    assert read is not None and check_files(tmp_path / "weld", read) == []


def test_without_the_option_there_is_no_manifest(tmp_path: Path) -> None:
    write_weld(tmp_path / "weld", 3, options=WriterOptions())
    assert not (tmp_path / "weld" / MANIFEST_NAME).exists()


@pytest.mark.parametrize("name", ["../other.mcap", "/data/other.mcap", "a/b.mcap", "..", ".", ""])
def test_a_file_of_a_manifest_is_in_the_bag_s_folder(name):
    content = {"name": name, "bytes": 1, "sha256": "", "hashed": "afterwards", "pieces": []}
    with pytest.raises(InputError):
        validate(FileManifest, content, "manifest.json")
