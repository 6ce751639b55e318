"""Files of welding procedures: those that are shipped, and what differs between two."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fsw_analysis import procedure
from fsw_analysis.procedure import Identity, Procedure, digest
from fsw_recorder.signature import Signer, TrustedKey, load_trusted
from fsw_schema.models import content_of, read_text, shipped_names, validate

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
    """Names of the procedures that come with the package."""
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
    fsw_schema.models.InputError
        It cannot be read, something in it is wrong, or it was changed after it was signed.
    """
    signer_of(source, None)
    return validate(
        Procedure, content_of(read_text(source, "procedure", _SHIPPED), str(source)), str(source)
    )


def signer_of(
    source: str | Path, trusted: Sequence[TrustedKey] | None, required: bool = False
) -> Signer | None:
    """Who signed a procedure that `load` reads; as ``fsw_analysis.procedure.signer_of``."""
    return procedure.signer_of(path_of(source), trusted, required)


def check_signed(source: str | Path, trusted: Sequence[Path], required: bool) -> None:
    """Whether a procedure is signed as is demanded; ``trusted`` are files with keys, without any all keys will do.

    Raises
    ------
    EvidenceError
        As :func:`signer_of`.
    """
    signer_of(source, load_trusted(trusted) if trusted else None, required)


def differences(old: Procedure, new: Procedure) -> list[tuple[str, str, str]]:
    """Path, former and present value of all that differs; ``-`` for what is only in one of them."""
    before, after = (
        dict(_leaves("", one.model_dump(mode="json", exclude_none=True))) for one in (old, new)
    )
    keys = dict.fromkeys([*before, *after])
    return [
        (key, before.get(key, "-"), after.get(key, "-"))
        for key in keys
        if before.get(key) != after.get(key)
    ]


def _leaves(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Values with their paths; entries of a list by name where they have one, so that a new one shifts nothing."""
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
