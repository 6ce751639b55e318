"""Whether record, pages, bag, procedure and identity are of one weld: by judging the weld again, and by hashes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from fsw_control.schema.models import json_content_of, validate
from fsw_quality.record import make
from fsw_quality.record_content import Record
from fsw_quality.report import PAGE, PDF, json_sha256, stated_otherwise
from fsw_recorder.findings import Code, Finding, finding
from fsw_recorder.manifest import sha256
from fsw_scenario.procedure import Procedure

_RECORD = b'"fsw_weld_record"'
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
) -> list[Finding]:
    """Compare records with those that the bag gives; reads the whole bag if there is a record.

    Raises
    ------
    fsw_control.schema.models.InputError
        A record cannot be read.
    fsw_recorder.errors.BagError
        The bag cannot be judged.
    """
    findings = []
    for name, record in records_of(documents).items():
        if procedure is None:
            findings.append(finding(Code.NO_PROCEDURE, name))
            continue
        # The verdict follows from bag and procedure, so every edited figure differs from the
        # record that is made again; no list of fields to check can be incomplete.
        stated = record.model_dump(mode="json", exclude=_BESIDE)
        actual = make(bag, procedure, progress)[0].model_dump(mode="json", exclude=_BESIDE)
        fields = [key for key in actual if actual[key] != stated[key]]
        code = next((_OTHER[key] for key in _OTHER if key in fields), Code.RECORD_EDITED)
        if fields:
            findings.append(finding(code, name, fields=", ".join(fields)))
    return findings


def records_of(documents: Mapping[str, bytes]) -> dict[str, Record]:
    """The records among documents; an InputError where one cannot be read."""
    return {
        name: validate(Record, json_content_of(data.decode("utf-8", "replace"), name), name)
        for name, data in documents.items()
        if _RECORD in data
    }


def check_links(documents: Mapping[str, bytes]) -> Iterator[Finding]:
    """Whether each page and PDF is made of a record among the documents, and says its verdict and identity.

    Also which documents nothing links to a record, and what of the records is not in the bag.
    """
    records = records_of(documents)
    by_hash = {sha256(documents[name]): record for name, record in records.items()}
    for name, data in documents.items():
        made_of = json_sha256(data)
        if name in records:
            if records[name].comparison is not None:
                yield finding(Code.NOT_COMPARED, name)
        elif made_of in by_hash:
            try:
                if missing := stated_otherwise(data, by_hash[made_of]):
                    yield finding(Code.DOCUMENT_DIFFERS, name, fields=", ".join(missing))
            except ValueError as error:
                yield finding(Code.UNREADABLE, name, reason=error)
        else:
            is_page = made_of or Path(name).name in (PAGE, PDF)
            yield finding(Code.OTHER_RECORD if is_page else Code.DOCUMENT_FOREIGN, name)
