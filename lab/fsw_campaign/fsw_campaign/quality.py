"""Requirements on stored figures of merit: part of a report, not of the campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

from fsw_campaign.definition import Bounds
from fsw_control.schema.models import InputError, Many, Model, content_of, read_text, validate

_SHIPPED = Path(__file__).with_name("quality.yaml")


class Requirement(Model):
    """A requirement on welds, in words and as bounds of columns of the dataset."""

    words: Annotated[str, AfterValidator(lambda text: " ".join(text.split()))]
    limits: dict[str, Bounds]


class _Requirements(Model):
    limits: Many[Requirement]


def read(file: Path | None, columns: Sequence[str]) -> list[Requirement]:
    """Read a file of requirements, a list of ``words`` and ``limits``.

    Parameters
    ----------
    file : Path or None
        None: the shipped ones for which the campaign has the columns.
    columns : sequence of str
        Numeric columns of the campaign.

    Raises
    ------
    fsw_control.schema.models.InputError
        If it cannot be read or something in it is wrong.
    """
    path = file or _SHIPPED
    found = validate(
        _Requirements, {"limits": content_of(read_text(path, "limits"), str(path))}, str(path)
    ).limits
    unknown = [column for one in found for column in one.limits if column not in columns]
    if unknown and file is not None:
        raise InputError(
            f"{file}: {unknown[0]} is not a figure of merit of this campaign; known: {', '.join(columns)}"
        )
    return [one for one in found if not set(unknown) & one.limits.keys()]
