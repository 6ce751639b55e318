"""Writes the record of a weld.

``record.json``, and ``record.html`` and ``record.pdf`` from one template.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import matplotlib

from fsw_analysis.course import Course
from fsw_analysis.procedure import Procedure
from fsw_analysis.report import page, source
from fsw_control.schema.files import write_whole
from fsw_control.units import NANOSECONDS
from fsw_quality import figures, record_hook
from fsw_quality.record_content import Record
from fsw_recorder.manifest import sha256

#: of a section in the PDF: its heading, and a table's head and first row, which stand on one page
_BEGIN_MM = 25.0
JSON, PAGE, PDF = "record.json", "record.html", "record.pdf"
#: in page and PDF, before the hash of the record.json that they were made of
_MADE_OF = "fsw-record-sha256:"


def json_sha256(document: bytes) -> str | None:
    """Hash of the record.json that a page or a PDF was made of; None where it says none."""
    match = re.search(_MADE_OF.encode() + rb"([0-9a-f]{64})", document)
    return match.group(1).decode() if match else None


def _statement(record: Record) -> tuple[str, str]:
    """Heading and first sentence of page and PDF: what was decided of which weld, by what."""
    canister, deciding = record.identity.get("canister"), record.deciding
    heading = f"{canister}: {record.verdict.upper()}" if canister else record.verdict.upper()
    procedure = f"{record.procedure.id} revision {record.procedure.revision}"
    judged = f"Weld {record.bag}, judged by procedure {procedure}."
    return heading, f"{judged} Decided by: {deciding.name}, {deciding.words}: {deciding.figure}."


def can_write_pdf() -> bool:
    """Whether the extra ``pdf`` is installed; in a clone it is, from now on."""
    return not record_hook.PDF.missing()


def files() -> tuple[str, ...]:
    """Names of the files that :func:`write` writes."""
    return (JSON, PAGE, *((PDF,) if can_write_pdf() else ()))


def record_bytes(record: Record) -> bytes:
    """Content of a record's ``record.json``: one record has one spelling."""
    return record.model_dump_json(indent=2, exclude_none=True).encode() + b"\n"


def figure_names(ending: str | None) -> list[str]:
    """Names of the files that the figures are also written to."""
    return [f"{name}.{ending}" for name in ("traces", "unrolled")] if ending else []


def contents(
    record: Record,
    course: Course,
    procedure: Procedure,
    beside: Sequence[Path | None] = (None, None),
) -> dict[str, bytes]:
    """Files of a record by name, the same whenever they are made; the PDF needs extra ``pdf``.

    ``beside``: files that the two figures are also written to.
    """
    images = {"traces": source(figures.traces(course, procedure, beside[0]))}
    if (drawn := figures.unrolled(course, procedure, record, beside[1])) is not None:
        images["unrolled"] = source(drawn)
    heading, sentence = _statement(record)
    parts = {"heading": heading, "sentence": sentence, "images": images}
    body = page("fsw_quality", "body.html.j2", record=record, procedure=procedure, **parts)
    content = record_bytes(record)
    made_of = f"{_MADE_OF}{sha256(content)}"
    body += f"<p>Made of record.json, {made_of}</p>"
    title = record.identity.get("canister") or f"Weld {record.bag}"
    whole = {
        JSON: content,
        PAGE: page("fsw_quality", "record.html.j2", title=title, body=body).encode(),
    }
    if can_write_pdf():
        whole[PDF] = _pdf(body, title, made_of, record.start_ns / NANOSECONDS)
    return whole


def write(
    record: Record, course: Course, procedure: Procedure, folder: Path, ending: str | None = None
) -> list[Path]:
    """Write the files into a folder, each whole or not at all; returns their paths.

    ``ending``: format of the figures' files beside the page, ``png``, ``svg`` or ``pdf``.
    """
    beside = [folder / name for name in figure_names(ending)]
    for path in beside:  # one of them may not be drawn
        path.unlink(missing_ok=True)
    whole = contents(record, course, procedure, beside or (None, None))
    for name, data in whole.items():
        write_whole(folder / name, data)
    return [folder / name for name in whole] + [path for path in beside if path.exists()]


def _pdf(body: str, title: str, keywords: str = "", time_s: float = 0.0) -> bytes:
    from fpdf import FPDF, TextStyle  # of the extra

    class Pages(FPDF):  # type: ignore[misc]
        def footer(self) -> None:
            self.set_y(-12)
            self.set_font("DejaVu", size=7)
            self.cell(0, 5, f"{title}, page {self.page_no()} of {{nb}}", align="C")

    pages = Pages(format="A4")
    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    for style, name in (("", "DejaVuSans"), ("B", "DejaVuSans-Bold"), ("I", "DejaVuSans-Oblique")):
        pages.add_font("DejaVu", style, fonts / f"{name}.ttf")
    pages.set_font("DejaVu", size=7.5)
    pages.set_title(title)
    pages.set_keywords(keywords)
    pages.set_creation_date(datetime.fromtimestamp(time_s, UTC))  # not the time of writing
    pages.add_page()
    heads = {
        f"h{level}": TextStyle(
            color="#000000", font_style="B", font_size_pt=size, t_margin=3.0, b_margin=0.3
        )
        for level, size in ((1, 20), (2, 11))
    }
    for section in re.split("(?=<h2>)", body):
        if pages.will_page_break(_BEGIN_MM):
            pages.add_page()
        pages.write_html(
            section,
            font_family="DejaVu",
            table_line_separators=True,
            li_prefix_color="#000000",
            ul_bullet_char="–",
            tag_styles=heads,
        )
    return bytes(pages.output())
