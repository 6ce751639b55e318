"""Results of checks of bags and signatures: codes with fields, and the table of their texts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from fsw_control.coded import Worded
from fsw_control.schema.models import InputError, Many, Model

_MOST_FINDINGS = 5
_BEFORE = "what happened to it before is not known"


class Code(Worded):
    """Result of a check."""

    # the files of a bag
    UNREADABLE = "{reason}"
    MISSING = "is missing"
    UNLISTED = "is not in the manifest"
    REORDERED = "every piece is there, but not alone or in another order"
    OTHER_FILE = "is another file: none of its chunks is one that was recorded"
    CHANGED = "{place}is not what was recorded"
    NO_MANIFEST = (
        "the recorder did not write one, e.g. because it was killed: what happened to the bag "
        "before it was attested is not known"
    )
    HASHED_AFTERWARDS = f"hashed after the recording; {_BEFORE}"
    RECOVERED = (
        "is of a copy that 'bag recover' made; what was lost is not known: attest the bag itself, "
        "{source}"
    )
    # signatures and keys
    NOT_SIGNED = "has no signature"
    SIGNATURE_DAMAGED = (
        "the signature is damaged, for another purpose, or by an earlier version of this software"
    )
    CONTENT_CHANGED = "the signature does not fit: the file was changed after it was signed"
    KEY_UNKNOWN = "signed by key {key}, which is not a trusted one ({trusted})"
    KEY_PURPOSE = "signed by {name}, whose key {key} is not for {limit}"
    KEY_EARLY = "signed by {name} at {signed_at}, before the key {key} is valid ({limit})"
    KEY_EXPIRED = "signed by {name} at {signed_at}, after the key {key} expired ({limit})"
    KEY_REVOKED = (
        "signed by {name}, who states {signed_at}, but no other signature shows that it was "
        "before {limit}, from when on the key {key} is revoked"
    )
    # files signed together must be of one weld
    RECORD_OTHER_WELD = "is the record of another weld: other {fields}"
    RECORD_OTHER_PROCEDURE = (
        "was judged by another procedure than that of the weld: other {fields}"
    )
    RECORD_OTHER_IDENTITY = (
        "names another canister, lid, tool or machine than the bag: other {fields}"
    )
    RECORD_EDITED = "is not the record that the bag gives: other {fields}"
    RECORD_OTHER_VERSION = (
        "is a record of version {version}, this software reads {read}: write it again"
    )
    OTHER_RECORD = "was not made of the record.json that is attested with it"
    DOCUMENT_DIFFERS = "is not what its record.json gives"
    OTHER_PROCEDURE = (
        "the weld ran by another procedure than {id} revision {revision}, SHA-256 {sha256:.12}…"
    )
    NO_PROCEDURE = "cannot be judged: give the procedure of the weld, which the bag does not have"
    # an attested bag
    CHANGED_SINCE = "is not the file that was attested"
    NOT_ATTESTED = (
        "is not a file that was attested: it was changed since, or belongs to another weld"
    )
    TIME_ORDER = "{later} ({later_at}) is before {earlier} ({earlier_at})"
    # the chain of welds
    BROKEN_LINK = "weld {number} does not follow the file before it: one was removed or exchanged"
    NOT_IN_CHAIN = "the attestation of this bag, weld {number}, is not in the chain"
    ATTESTED_TWICE = "is a second attestation of weld {number} ({bag})"
    CANISTER_TWICE = "{identity} was welded as weld {number}, too"
    EMPTY = "there is no attested weld in it"
    # not demanded by every policy
    MANIFEST_UNSIGNED = f"the recorder did not sign it: until it was attested, {_BEFORE}"
    PROCEDURE_UNSIGNED = "the procedure of the weld was attested without a signature"
    PROCEDURE_ABSENT = "no procedure was attested with the bag"


class Unchecked(Worded):
    """Limits of a check; not faults."""

    BAG_DAMAGED = "{problem}; what was lost is not known"
    CLOCK_UNKNOWN = "times are as stated: the recorder's clock was not known to be synchronized"
    PROCEDURE_NOT_RECORDED = "whether the weld ran by procedure {id} is not in the bag"
    NO_RECORD = "no record was attested with the bag: its weld is not judged"
    DOCUMENT_ABSENT = "was attested with the bag and is not here"
    NOT_COMPARED = "its comparison with earlier welds was not checked against their records"
    STATED_AFTERWARDS = (
        "what was stated after the weld was attested as it was; the bag does not prove it"
    )
    NOT_JUDGED_AGAIN = "documents were compared with the bag when they were attested, not now"
    REVOCATION_BY_OWN_CLOCK = (
        "signed by {name} at {signed_at} by the signer's own clock alone; the key {key} is now "
        "revoked: whether it was signed before was not checked"
    )
    NO_CHAIN = "no chain given: whether welds are missing was not checked"
    ALL_KEYS = "no trusted key has dates: neither validity nor revocations were checked"
    FILES_NOT_CHECKED = (
        "files, documents and other signatures: there is no valid attestation that lists them"
    )
    CHAIN_END = (
        "welds removed from its end cannot be seen; compare weld {number} and {sha256} with notes"
    )


class Place(Model):
    """Consecutive pieces of a file."""

    parts: Many[str]
    """text, e.g. ``chunk 17``"""
    begin: int
    end: int
    """bytes"""
    begin_s: float | None = None
    end_s: float | None = None
    """after the first message of the file"""

    @property
    def words(self) -> str:
        """E.g. ``chunk 17 (bytes 1200 to 4800, 6.8 to 7.2 s after the first message)``."""
        when = (
            ""
            if self.begin_s is None
            else f", {self.begin_s:.1f} to {self.end_s:.1f} s after the first message"
        )
        return f"{' and '.join(self.parts)} (bytes {self.begin} to {self.end}{when})"


_CODES = {code.value: code for codes in (Code, Unchecked) for code in codes}


def _coded(value: Any) -> Any:
    """Code of a value in JSON; older pydantic does not find it in a union of strict enums."""
    return _CODES.get(value, value) if isinstance(value, str) else value


class Finding(Model):
    """Result of a check of a file: a code with its fields; ``pieces`` index the manifest's."""

    code: Annotated[Code | Unchecked, BeforeValidator(_coded)]
    file: str
    data: dict[str, Any] = Field(default_factory=dict)
    pieces: Many[int] = ()
    place: Place | None = None

    @property
    def line(self) -> str:
        """Text in one line."""
        place = f"{self.place.words} " if self.place else ""
        text = self.code.words.format(**{"place": place, **self.data})
        if "bytes" in self.data:
            text += (
                f"; the file has {self.data['bytes']} bytes instead of {self.data['listed_bytes']}"
            )
        return f"{self.file}: {text}"


def finding(code: Code | Unchecked, file: object, **data: Any) -> Finding:
    """Create a finding with the fields of its code."""
    plain = {key: value if isinstance(value, int) else str(value) for key, value in data.items()}
    return Finding(code=code, file=str(file), data=plain)


class EvidenceError(InputError):
    """A failed check: its ``findings``, whose texts are the message."""

    def __init__(self, *findings: Finding) -> None:
        super().__init__(summary(findings))
        self.findings = findings


def summary(findings: Sequence[Finding]) -> str:
    """Findings in one line."""
    lines = [entry.line for entry in findings[:_MOST_FINDINGS]]
    return "; ".join(
        lines + [f"and {len(findings) - _MOST_FINDINGS} more"] * (len(findings) > _MOST_FINDINGS)
    )
