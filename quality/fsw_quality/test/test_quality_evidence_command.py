"""The commands on evidence: keys, attested bags, their chain.

What is wrong is said in one line.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from fsw.main import main
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_test_support.keys import make_key
from fsw_test_support.sample_weld import sample_messages, sample_topics

pytest.importorskip(
    "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
)


def weld(folder: Path, shift_ns: int = 0) -> Path:
    with BagWriter(folder, WriterOptions(manifest=True), {"canister": folder.name}) as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        for count, (name, time_ns, data) in enumerate(sample_messages(20)):
            writer.write(name, data, time_ns + shift_ns, time_ns + shift_ns)
            if count % 50 == 0:
                writer.flush()
    return folder


@pytest.fixture(autouse=True)
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path / "config" / "fsw-control"


def run(*words: object) -> int:
    return main(["bag", *map(str, words)])


def test_from_key_to_proof(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chain, bags = tmp_path / "chain", [weld(tmp_path / f"C-{number}", number) for number in (1, 2)]
    assert run("attest", bags[0], "--chain", chain) == 1
    assert f"ssh-keygen -t ed25519 -N '' -f {config / 'evidence_key'}" in capsys.readouterr().err
    make_key(config / "evidence_key")
    assert run("attest", *bags, "--chain", chain, "--procedure", "copper_lid") == 0
    target = tmp_path / "found.json"
    assert run("verify-evidence", *bags, "--chain", chain, "--json", target) == 0
    out, content = capsys.readouterr().out, json.loads(target.read_text())
    assert (
        "intact, 2 welds" in out
        and "C-1: proven: weld 1" in out
        and out.count("attestation signed by evidence_key") == 2
    )
    assert content["chain"] == [] and [bag["findings"] for bag in content["bags"]] == [[], []]
    assert {"manifest_unsigned", "procedure_unsigned", "all_keys"} <= {
        entry["code"] for entry in content["bags"][0]["not_checked"]
    }
    assert run("verify-evidence", "--chain", chain) == 0
    assert run("verify-evidence", *bags, "--require-signed") == 1
    alone = tmp_path / "alone"
    assert run("attest", bags[0], "--chain", alone) == 0  # without a procedure
    assert run("verify-evidence", bags[0], "--chain", alone, "--json", target, "--force") == 0
    notes = json.loads(target.read_text())["bags"][0]["not_checked"]
    assert {note["code"] for note in notes} == {
        "manifest_unsigned",
        "procedure_absent",
        "clock_unknown",
        "no_record",
        "all_keys",
    }
    again = weld(tmp_path / "more" / "C-1", 3)
    capsys.readouterr()
    assert run("attest", again, "--chain", chain) == 1
    assert "canister C-1 " in capsys.readouterr().err


def test_keys_expire(tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, keys = weld(tmp_path / "C-1"), tmp_path / "keys.yaml"
    make_key(config / "evidence_key")
    assert run("attest", bag, "--chain", tmp_path / "chain") == 0
    entry = {
        "name": "quality",
        "key": (config / "evidence_key.pub").read_text(),
        "valid_until": "2020-01-01",
    }
    keys.write_text(json.dumps({"format": "fsw_trusted_keys", "version": 1, "keys": [entry]}))
    capsys.readouterr()
    assert run("verify-evidence", bag, "--trusted", keys, "--json", tmp_path / "found.json") == 1
    [finding] = json.loads((tmp_path / "found.json").read_text())["bags"][0]["findings"]
    assert finding["code"] == "key_expired" and finding["data"]["name"] == "quality"
    [note] = json.loads((tmp_path / "found.json").read_text())["bags"][0]["not_checked"]
    assert note["code"] == "files_not_checked"
    assert "signed by quality" in capsys.readouterr().out


def test_damage_is_located_and_a_recovered_copy_proves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = weld(tmp_path / "C-1")
    make_key(tmp_path / "key")
    assert run("attest", bag, "--chain", tmp_path / "chain", "--key", tmp_path / "key") == 0
    file = bag / "C-1_0.mcap"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    capsys.readouterr()
    words = ("--trusted", tmp_path / "key.pub", "--json", tmp_path / "found.json")
    assert run("verify-evidence", bag, *words) == 1
    assert "C-1_0.mcap: chunk " in capsys.readouterr().out
    [finding] = json.loads((tmp_path / "found.json").read_text())["bags"][0]["findings"]
    assert (
        finding["file"] == "C-1_0.mcap"
        and len(finding["pieces"]) == 1
        and finding["code"] == "changed"
    )
    assert run("recover", bag, tmp_path / "all") == 0
    assert (
        run("attest", tmp_path / "all", "--chain", tmp_path / "other", "--key", tmp_path / "key")
        == 1
    )


def test_what_is_wrong_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, key, chain = weld(tmp_path / "C-1"), tmp_path / "key", tmp_path / "chain"
    make_key(key)
    open_key = tmp_path / "open_key"
    shutil.copyfile(key, open_key)
    open_key.chmod(0o644)
    capsys.readouterr()
    for words, said in (
        (("attest", bag, "--chain", chain, "--key", open_key), "chmod 600"),
        (("attest", bag, "--chain", chain, "--key", tmp_path / "key.pub"), "chmod 600"),
        (
            ("attest", tmp_path / "none", "--chain", chain, "--key", key),
            "is not the folder of a bag",
        ),
        (
            ("attest", bag, "--chain", chain, "--key", key, "--procedure", "no_such"),
            "cannot read procedure no_such",
        ),
        (
            ("attest", bag, "--chain", chain, "--key", key, "--record", tmp_path / "none"),
            "none/record.json: is missing",
        ),
        (("attest", bag, "--chain", chain, "--key", key, "--require-signed"), "manifest: "),
        (("verify-evidence",), "give bags, or --chain, or both"),
        (("verify-evidence", bag), "evidence_key.pub: No such file"),
    ):
        assert run(*words) == 1
        error = capsys.readouterr().err.strip()
        assert said in error and "\n" not in error, words
    assert run("verify-evidence", bag, "--trusted", f"{key}.pub") == 1  # never attested
    assert "attestation.json: " in capsys.readouterr().out
    target, words = tmp_path / "found.json", ("--chain", tmp_path / "no_chain")
    assert run("verify-evidence", *words, "--trusted", f"{key}.pub", "--json", target) == 1
    [empty] = json.loads(target.read_text())["chain"]
    assert empty["code"] == "empty" and "no_chain" in capsys.readouterr().out
