"""A weld that is launched runs by a procedure that is signed as it has to be."""

import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from fsw_control.schema.errors import InputError
from fsw_recorder.signature import Purpose, load_private, sign, signature_path
from fsw_scenario.procedure import path_of
from fsw_scenario.weld_options import WeldOptions
from fsw_test_support.keys import make_key

pytest.importorskip(
    "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
)
NOW = datetime(2026, 11, 25, tzinfo=UTC)


@pytest.fixture
def lid(tmp_path):
    for name in ("own", "foreign"):
        make_key(tmp_path / name)
    return Path(shutil.copyfile(path_of("copper_lid"), tmp_path / "lid.yaml"))


def signed_with(lid, name):
    text = sign(
        lid.read_bytes(), lid.name, Purpose.PROCEDURE, load_private(lid.with_name(name)), NOW
    )
    signature_path(lid).write_text(text)


def launched(lid, **more):
    """Parameters of the nodes that follow; None where the launch is refused."""
    arguments = {
        "procedure": str(lid),
        "require_signed": "true",
        "trusted": str(lid.with_name("own.pub")),
    } | more
    try:
        return WeldOptions.from_texts(arguments).graph(lid.parent).derived
    except InputError:
        return None


def test_unsigned_procedure_is_refused_if_signing_is_required(lid):
    assert launched(lid) is None
    assert launched(lid, require_signed="false")["fsw_procedure"]
    signed_with(lid, "own")
    assert "fsw_supervisor" in launched(lid)


def test_signature_by_an_untrusted_key_is_refused(lid):
    signed_with(lid, "foreign")
    assert launched(lid) is None
    assert launched(lid, require_signed="false") is None, "it is signed by somebody who may not"
    assert launched(lid, trusted="") is None, "anybody can sign with a key that nobody knows"
    assert launched(lid, trusted="", require_signed="false") is not None


def test_procedure_changed_after_signing_is_refused(lid):
    signed_with(lid, "own")
    lid.write_text(lid.read_text().replace("tolerated_s: 0.3", "tolerated_s: 3.0"))
    assert launched(lid, require_signed="false") is None


def test_requiring_a_signature_needs_a_procedure(lid):
    assert launched(lid, procedure="") is None
    assert "fsw_procedure" not in launched(lid, procedure="", require_signed="false")
