"""Files of welding procedures: shipped ones, differences between two and from a running weld."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fsw_analysis import procedure
from fsw_analysis.procedure import Identity, Procedure, digest, tuning_sha256
from fsw_control.cause import Cause
from fsw_control.schema.models import content_of, read_text, shipped_names, validate
from fsw_recorder.signature import Signer, TrustedKey, load_trusted

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


class ProcedureWatch:
    """Deviations of a weld from its procedure, each with a name and a text."""

    def __init__(self, procedure: Procedure) -> None:
        self._procedure = procedure
        self._permitted = {one.name: one.parameters_sha256 for one in procedure.controllers}
        self._found: dict[str, str] = {}
        self._first = ""
        self._welds = False  # before automatic control has begun, hold is normal

    @property
    def deviations(self) -> dict[str, str]:
        """Present deviations, including those that cannot be undone."""
        return dict(self._found)

    def _set(self, name: str, text: str) -> None:
        if text:
            self._found[name] = text
        else:
            self._found.pop(name, None)

    def set_points(self, depth_mm: float, temperature_c: float) -> None:
        """Take the set-points in force."""
        for name, value in (("depth_mm", depth_mm), ("temperature_c", temperature_c)):
            point = getattr(self._procedure.set_points, name)
            inside = point.min <= value <= point.max
            text = (
                f"set-point {name} {value:g} is in force; "
                f"permitted: {point.min:g} to {point.max:g}"
            )
            self._set(f"set_point_{name}", "" if inside else text)

    def state(self, controller: str, mode: str, cause: Cause) -> None:
        """Take controller, mode and cause, as reported by the supervisor."""
        foreign = controller and controller not in self._permitted
        text = f"{controller} is in command; permitted: {', '.join(self._permitted)}"
        self._set("controller", text if foreign else "")
        self._welds = self._welds or mode == "auto"
        text = f"mode {mode} ({cause.words}) instead of auto"
        self._set("mode", text if self._welds and mode != "auto" else "")
        if not controller:
            return
        if not self._first:
            self._first = controller
        acceptance = self._procedure.acceptance
        if controller != self._first and not acceptance.permits_swap(cause):
            # kept: a swap back does not undo it
            self._found.setdefault(
                "swap", f"swap to {controller} ({cause.words}); permitted: {acceptance.swap_words}"
            )

    def tuning(self, controller: str, parameters: Mapping[str, Any]) -> None:
        """Take the present parameters of a controller's node."""
        wanted = self._permitted.get(controller)
        actual = tuning_sha256(parameters)
        text = (
            f"{controller} has parameters {actual[:12]}…, "
            f"the procedure wants {(wanted or '')[:12]}…"
        )
        self._set(f"tuning_{controller}", text if wanted is not None and actual != wanted else "")


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
    """Signer of a procedure, see ``fsw_analysis.procedure.signer_of``."""
    return procedure.signer_of(path_of(source), trusted, required)


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
        dict(_leaves("", one.model_dump(mode="json", exclude_none=True))) for one in (old, new)
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
