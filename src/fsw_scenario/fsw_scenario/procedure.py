"""Files of welding procedures: shipped ones, and differences between two."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fsw_analysis.procedure import Identity, Procedure, digest
from fsw_control.schema.models import content_of, read_text, shipped_names, validate
from fsw_recorder import signature
from fsw_recorder.signature import Purpose, Signer, TrustedKey, load_trusted

__all__ = [
    "Identity",
    "Procedure",
    "check_signed",
    "differences",
    "digest",
    "load",
    "path_of",
    "shipped",
    "signer_of",
]
_SHIPPED = Path(__file__).parent / "procedures"


def shipped() -> list[str]:
    """Names of the shipped procedures."""
    return shipped_names(_SHIPPED)


def path_of(source: str | Path) -> Path:
    """The file that `load` reads."""
    path = Path(source).expanduser()
    return (
        _SHIPPED / f"{source}.yaml"
        if str(source) in shipped() and not path.is_file()
        else path.absolute()
    )


def load(source: str | Path) -> Procedure:
    """Read a procedure: a YAML file, or a shipped one by its name.

    Raises
    ------
    fsw_control.schema.models.InputError
        If it cannot be read, is invalid, or was changed after it was signed.
    """
    signer_of(source, None)
    return validate(
        Procedure, content_of(read_text(source, "procedure", _SHIPPED), str(source)), str(source)
    )


def signer_of(
    source: str | Path, trusted: Sequence[TrustedKey] | None, required: bool = False
) -> Signer | None:
    """Signer of a procedure, see :func:`fsw_recorder.signature.signer_of`."""
    return signature.signer_of(path_of(source), Purpose.PROCEDURE, trusted, required)


def check_signed(source: str | Path, trusted: Sequence[Path], required: bool) -> None:
    """Check a procedure's signature if required; ``trusted`` are key files, default: any key.

    Raises
    ------
    EvidenceError
        As in :func:`signer_of`.
    """
    signer_of(source, load_trusted(trusted) if trusted else None, required)


def differences(old: Procedure, new: Procedure) -> list[tuple[str, str, str]]:
    """Differences as path, old and new value; ``-`` for entries in only one of them."""
    before, after = (
        dict(_leaves("", side.model_dump(mode="json", exclude_none=True))) for side in (old, new)
    )
    keys = dict.fromkeys([*before, *after])
    return [
        (key, before.get(key, "-"), after.get(key, "-"))
        for key in keys
        if before.get(key) != after.get(key)
    ]


def _leaves(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Values by path; list entries by their name if they have one, so that paths are stable."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(f"{path}.{key}" if path else key, inner)
    elif isinstance(value, list):
        seen: dict[str, int] = {}
        for row, inner in enumerate(value):
            name = (
                str(inner.get("name") or inner.get("variable"))
                if isinstance(inner, dict)
                else str(row)
            )
            seen[name] = seen.get(name, 0) + 1
            yield from _leaves(f"{path}[{name}{f' {seen[name]}' * (seen[name] > 1)}]", inner)
    else:
        yield path, f"{value:g}" if isinstance(value, float) else str(value)
