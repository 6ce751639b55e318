"""The record of a weld for use in Python: ``fsw.record``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

from fsw.arguments import validated
from fsw.welds import Progress
from fsw_analysis.procedure import WeldData
from fsw_control.schema.models import validate
from fsw_quality.comparison import accepted_before, compare
from fsw_quality.record_content import Record
from fsw_scenario import procedure as procedures


@validated
def record(
    bag: str | Path,
    procedure: str | Path,
    folder: str | Path | None = None,
    *,
    compare_with: str | Path | None = None,
    afterwards: Mapping[str, str] | None = None,
    figures: Literal["png", "svg", "pdf"] | None = None,
    progress: Progress | None = None,
    note: Callable[[str], object] = warnings.warn,
) -> Record:
    """The record of a weld: verdict, rules, exceedances with their place.

    Parameters
    ----------
    bag : str or Path
    procedure : str or Path
        A shipped one, or a YAML file.
    folder : str or Path, optional
        Where ``record.html``, ``record.json`` and, with extra ``pdf``, ``record.pdf`` are written.
    compare_with : str or Path, optional
        Folder with records of earlier welds: the last accepted ones of the procedure are compared.
    afterwards : mapping, optional
        What is known only after the weld, with the keys of a procedure's ``weld_data``, e.g.
        ``ndt``.
    figures : {"png", "svg", "pdf"}, optional
        Write the figures also as files of this format, beside the page.
    progress : callable, optional
        Called with the share read, 0 to 1.
    note : callable, optional
        Called with a text for each record that cannot be compared; by default it is a warning.

    Raises
    ------
    fsw_control.schema.models.InputError
        When the procedure is wrong.
    fsw_recorder.errors.BagError
        When there is no bag, it cannot be read, or it holds no weld in the procedure's phases.

    Examples
    --------
    >>> import fsw
    >>> fsw.record("no_such_bag", "copper_lid")
    Traceback (most recent call last):
    fsw_recorder.errors.BagError: no_such_bag: there is no such bag
    """
    from fsw_quality import record as records  # matplotlib takes a second to import
    from fsw_quality import report

    judged_by = procedures.load(procedure)
    stated = validate(WeldData, dict(afterwards), "weld data") if afterwards else None
    record, course = records.make(Path(bag), judged_by, progress)
    if compare_with is not None:
        others = accepted_before(Path(compare_with), record, note)
        record = record.changed(comparison=compare(record, others))
    record = record.changed(afterwards=stated)
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        report.write(record, course, judged_by, Path(folder), figures)
    return record
