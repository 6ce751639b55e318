"""Whether record, pages, bag, procedure and identity are of one weld: by judging the weld again, and by hashes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from fsw_control.schema.models import json_content_of, validate
from fsw_quality import record_hook
from fsw_quality.record import make
from fsw_quality.record_content import Record, other_version
from fsw_quality.report import JSON, PAGE, PDF, contents, json_sha256, record_bytes
from fsw_recorder.findings import Code, Finding, Unchecked, finding
from fsw_recorder.manifest import sha256
from fsw_scenario.procedure import Procedure

_RECORD = ("format", Record.model_fields["format"].default)
#: fields of a record that the bag alone does not give, and what is noted of them
_BESIDE: dict[str, Unchecked | None] = {
    "bag": None,
    "comparison": Unchecked.NOT_COMPARED,
    "afterwards": Unchecked.STATED_AFTERWARDS,
}
#: fields that differ where a record is not merely edited, but of something else
_OTHER = {
    "files": Code.RECORD_OTHER_WELD,
    "procedure": Code.RECORD_OTHER_PROCEDURE,
    "identity": Code.RECORD_OTHER_IDENTITY,
}


def check_documents(
    bag: Path,
    procedure: Procedure | None,
    documents: Mapping[str, bytes],
    progress: Callable[[float], None] | None = None,
) -> Iterator[Finding]:
    """Compare records, and pages made of them, with those that the bag gives; reads the whole bag for that.

    Raises
    ------
    fsw_control.schema.models.InputError
        A record cannot be read, or the PDF's extra is missing.
    fsw_recorder.errors.BagError
        The bag cannot be judged.
    """
    records = {name: sha256(data) for name, data in documents.items() if _is_record(name, data)}
    made_of = {name: json_sha256(documents[name]) for name in documents if name not in records}
    for name, digest in records.items():
        pages = {page: documents[page] for page in made_of if made_of[page] == digest}
        yield from _check_record(bag, procedure, name, documents[name], pages, progress)
    for name in made_of:
        if made_of[name] not in records.values():
            is_page = made_of[name] or Path(name).name in (PAGE, PDF)
            yield finding(Code.OTHER_RECORD if is_page else Unchecked.DOCUMENT_FOREIGN, name)


def _check_record(
    bag: Path,
    procedure: Procedure | None,
    name: str,
    data: bytes,
    pages: Mapping[str, bytes],
    progress: Callable[[float], None] | None,
) -> Iterator[Finding]:
    """Whether a record and its pages are those that bag and procedure give."""
    content = json_content_of(data.decode("utf-8", "replace"), name)
    if wrong := other_version(content, name):
        yield wrong
    elif procedure is None:
        yield finding(Code.NO_PROCEDURE, name)
    else:
        stated = validate(Record, content, name)
        for key, note in _BESIDE.items():
            if note and getattr(stated, key) is not None:
                yield finding(note, name)
        # All else follows from bag and procedure, so what was edited differs from what is made
        # again; no list of fields or sentences to check can be incomplete.
        made, course = make(bag, procedure, progress)
        made = made.changed(**{key: getattr(stated, key) for key in _BESIDE})
        if data != record_bytes(made):
            said, real = (entry.model_dump(mode="json") for entry in (stated, made))
            # bytes: e.g. a key that is given twice, of which other software may read the first
            fields = [key for key in real if real[key] != said[key]] or ["bytes"]
            code = next((_OTHER[key] for key in _OTHER if key in fields), Code.RECORD_EDITED)
            yield finding(code, name, fields=", ".join(fields))
        elif pages:
            if any(page.startswith(b"%PDF") for page in pages.values()):
                record_hook.PDF.need("the PDF of a record")
            again = contents(made, course, procedure).values()
            yield from (
                finding(Code.DOCUMENT_DIFFERS, at) for at in pages if pages[at] not in again
            )


def _is_record(name: str, data: bytes) -> bool:
    """Whether a document is the record of a weld: by its name, or any ``format`` that it states."""
    if Path(name).name == JSON:
        return True
    try:
        pairs = json.loads(data, object_pairs_hook=list)  # also of keys that are given twice
    except (ValueError, RecursionError):
        return False
    return isinstance(pairs, list) and _RECORD in pairs
