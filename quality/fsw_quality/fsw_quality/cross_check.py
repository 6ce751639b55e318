"""Whether record, pages, bag, procedure and identity are of one weld: by judging the weld again, and by hashes."""

from __future__ import annotations

import json
from collections.abc import Callable, Container, Iterator, Mapping
from pathlib import Path

from fsw_analysis.course import Course
from fsw_control.schema.models import json_content_of, validate
from fsw_quality import record_hook
from fsw_quality.record import make
from fsw_quality.record_content import Record, other_version
from fsw_quality.report import JSON, PAGE, PDF, contents, json_sha256, record_bytes
from fsw_recorder.findings import Code, Finding, finding
from fsw_recorder.manifest import sha256
from fsw_scenario.procedure import Procedure

_RECORD = ("format", Record.model_fields["format"].default)
#: fields of a record that the bag alone does not give: where it was, and what it was compared with
_BESIDE = {"bag", "comparison"}
#: fields that differ where a record is not merely edited, but of something else
_OTHER = {
    "files": Code.RECORD_OTHER_WELD,
    "procedure": Code.RECORD_OTHER_PROCEDURE,
    "identity": Code.RECORD_OTHER_IDENTITY,
}


def check_records(
    bag: Path,
    procedure: Procedure | None,
    documents: Mapping[str, bytes],
    progress: Callable[[float], None] | None = None,
) -> Iterator[Finding]:
    """Compare records and their pages with those that the bag gives; reads the whole bag for that.

    Raises
    ------
    fsw_control.schema.models.InputError
        A record cannot be read, or the PDF's extra is missing.
    fsw_recorder.errors.BagError
        The bag cannot be judged.
    """
    for name in (name for name, data in documents.items() if is_record(name, data)):
        content = json_content_of(documents[name].decode("utf-8", "replace"), name)
        if wrong := other_version(content, name):
            yield wrong
            continue
        stated = validate(Record, content, name)
        if procedure is None:
            yield finding(Code.NO_PROCEDURE, name)
            continue
        if stated.comparison is not None:
            yield finding(Code.NOT_COMPARED, name)
        # Everything follows from bag and procedure, so what was edited differs from what is made
        # again; no list of fields or sentences to check can be incomplete.
        record, course = make(bag, procedure, progress)
        said, actual = (one.model_dump(mode="json", exclude=_BESIDE) for one in (stated, record))
        if fields := [key for key in actual if actual[key] != said[key]]:
            code = next((_OTHER[key] for key in _OTHER if key in fields), Code.RECORD_EDITED)
            yield finding(code, name, fields=", ".join(fields))
        elif documents[name] != record_bytes(stated):
            # e.g. a key that is given twice: other software may read the first one
            yield finding(Code.RECORD_EDITED, name, fields="bytes")
        else:
            yield from _check_pages(stated, course, procedure, documents, sha256(documents[name]))


def _check_pages(
    record: Record,
    course: Course,
    procedure: Procedure,
    documents: Mapping[str, bytes],
    made_of: str,
) -> Iterator[Finding]:
    """Whether each page and PDF that names a record.json by its hash is the one that it gives."""
    pages = {name: data for name, data in documents.items() if json_sha256(data) == made_of}
    if any(data.startswith(b"%PDF") for data in pages.values()):
        record_hook.PDF.need("the PDF of a record")
    again = contents(record, course, procedure).values() if pages else ()
    yield from (finding(Code.DOCUMENT_DIFFERS, name) for name in pages if pages[name] not in again)


def is_record(name: str, data: bytes) -> bool:
    """Whether a document is the record of a weld: by its name, or any ``format`` that it states."""
    if Path(name).name == JSON:
        return True
    try:
        pairs = json.loads(data, object_pairs_hook=list)  # also of keys that are given twice
    except (ValueError, RecursionError):
        return False
    return isinstance(pairs, list) and _RECORD in pairs


def check_links(documents: Mapping[str, bytes], hashes: Container[str]) -> Iterator[Finding]:
    """Which pages and PDFs are of no record with one of these hashes, and what nothing links to the bag."""
    for name, data in documents.items():
        made_of = json_sha256(data)
        if not is_record(name, data) and made_of not in hashes:
            is_page = made_of or Path(name).name in (PAGE, PDF)
            yield finding(Code.OTHER_RECORD if is_page else Code.DOCUMENT_FOREIGN, name)
