"""Whether record, bag, procedure and identity are of one weld: by hashes, and by judging the weld again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fsw_control.schema.models import json_content_of, validate
from fsw_quality.attestation import IDENTITY
from fsw_quality.record import make
from fsw_quality.record_content import Record
from fsw_quality.report import PAGE, PDF, json_sha256, stated_otherwise
from fsw_recorder.findings import Code, Finding, finding
from fsw_recorder.manifest import Manifest, sha256
from fsw_scenario.procedure import Procedure

_RECORD = b'"fsw_weld_record"'
#: fields of a record that the bag alone does not give: where it was, and what it was compared with
_BESIDE = {"bag", "comparison"}


@dataclass(frozen=True, slots=True)
class Weld:
    """What documents about a weld must agree with."""

    bag: Path
    manifest: Manifest
    attached: Sequence[Procedure]
    """in the bag: by which it ran"""
    given: Procedure | None = None
    """which is to be signed for"""

    @property
    def procedure(self) -> Procedure | None:
        """The one to judge by: what is given, or else what is attached."""
        return self.given or (self.attached[0] if len(self.attached) == 1 else None)

    def findings(self, source: str) -> list[Finding]:
        """Whether the weld ran by the procedure that is given."""
        hashes = {entry.sha256 for entry in self.attached}
        if self.given is None or not hashes or self.given.sha256 in hashes:
            return []
        actual = ", ".join(_name(entry) for entry in self.attached)
        return [finding(Code.OTHER_PROCEDURE, source, stated=_name(self.given), actual=actual)]


def check_documents(
    weld: Weld, documents: Mapping[str, bytes], progress: Callable[[float], None] | None = None
) -> tuple[list[Finding], list[Finding]]:
    """Compare documents with the weld; a record, also by judging the weld again, which reads the whole bag.

    Returns what is wrong with them, and which nothing links to the bag.

    Raises
    ------
    fsw_control.schema.models.InputError
        A record cannot be read.
    fsw_recorder.errors.BagError
        The bag cannot be judged.
    """
    records, findings = records_of(documents), list[Finding]()
    for name, record in records.items():
        findings += list(record_findings(name, record, weld)) or _edited(
            name, record, weld, progress
        )
    linked = {*records, *_pages(documents, records)}
    notes = [finding(Code.DOCUMENT_FOREIGN, name) for name in documents if name not in linked]
    notes += [
        finding(Code.NOT_COMPARED, name)
        for name, record in records.items()
        if record.comparison is not None
    ]
    return [*findings, *page_findings(documents, records)], notes


def records_of(documents: Mapping[str, bytes]) -> dict[str, Record]:
    """The records among documents; an InputError where one cannot be read."""
    return {
        name: validate(Record, json_content_of(data.decode("utf-8", "replace"), name), name)
        for name, data in documents.items()
        if _RECORD in data
    }


def page_findings(
    documents: Mapping[str, bytes], records: Mapping[str, Record]
) -> Iterator[Finding]:
    """Whether each page and PDF is made of one of the records, and says of verdict and identity what that one says."""
    by_hash = {sha256(documents[name]): record for name, record in records.items()}
    for name, made_of in _pages(documents, records).items():
        if made_of not in by_hash:
            yield finding(Code.OTHER_RECORD, name)
            continue
        try:
            if missing := stated_otherwise(documents[name], by_hash[made_of]):
                yield finding(Code.DOCUMENT_DIFFERS, name, fields=", ".join(missing))
        except ValueError as error:
            yield finding(Code.UNREADABLE, name, reason=error)


def _pages(documents: Mapping[str, bytes], records: Mapping[str, Record]) -> dict[str, str | None]:
    """Which documents are pages and PDFs of a record, with the hash of that, where they carry one."""
    made_of = {name: json_sha256(data) for name, data in documents.items() if name not in records}
    return {
        name: hash_
        for name, hash_ in made_of.items()
        if hash_ is not None or Path(name).name in (PAGE, PDF)
    }


def record_findings(name: str, record: Record, weld: Weld) -> Iterator[Finding]:
    """Where a record is of another weld, by hashes and names alone."""
    if {entry.name: entry.sha256 for entry in record.files} != {
        entry.name: entry.sha256 for entry in weld.manifest.files
    }:
        yield finding(Code.RECORD_OTHER_WELD, name, bag=record.bag)
    for key in IDENTITY:
        stated, actual = (
            record.identity.get(key, "none"),
            weld.manifest.custom_data.get(key, "none"),
        )
        if stated != actual:
            yield finding(
                Code.RECORD_OTHER_IDENTITY, name, field=key, stated=stated, actual=actual
            )
    procedure, judged_by = weld.procedure, record.procedure
    if procedure is None:
        yield finding(Code.NO_PROCEDURE, name)
    elif judged_by.sha256 != procedure.sha256:
        stated = f"{judged_by.id} revision {judged_by.revision} ({judged_by.sha256[:12]})"
        yield finding(Code.RECORD_OTHER_PROCEDURE, name, stated=stated, actual=_name(procedure))


def _edited(
    name: str, record: Record, weld: Weld, progress: Callable[[float], None] | None
) -> list[Finding]:
    """Whether a record is not the one that the bag gives."""
    if weld.procedure is None:
        return []
    stated = record.model_dump(mode="json", exclude=_BESIDE)
    actual = make(weld.bag, weld.procedure, progress)[0].model_dump(mode="json", exclude=_BESIDE)
    fields = [key for key in actual if actual[key] != stated[key]]
    return [finding(Code.RECORD_EDITED, name, fields=", ".join(fields))] if fields else []


def _name(procedure: Procedure) -> str:
    return f"{procedure.id} revision {procedure.revision} ({procedure.sha256[:12]})"
