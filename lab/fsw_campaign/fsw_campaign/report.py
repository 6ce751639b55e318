"""The report on a campaign: one HTML file with all, or a Markdown page; and its requirements."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from markdown_it import MarkdownIt
from numpy.typing import NDArray
from pydantic import AfterValidator

from fsw_analysis.kpi_table import ROWS
from fsw_analysis.report import numbers, source, templates
from fsw_campaign import figures
from fsw_campaign.dataset import load
from fsw_campaign.definition import Bounds, Limit
from fsw_campaign.distributions import Distribution
from fsw_campaign.statistics import MAIN, Results, Vector
from fsw_campaign.welds import DIVERGED, ERROR, OK
from fsw_control.schema.models import InputError, Many, Model, content_of, read_text, validate

_TEMPLATES = templates("fsw_campaign")
_MOST_PERCENT = 50.0
_INSIDE = ["", "finished", "diverged", "error", "inside", "share [%]", "95 % Wilson interval [%]"]

_SHIPPED = Path(__file__).with_name("quality.yaml")


class Requirement(Model):
    """A requirement on welds, in words and as bounds of columns of the dataset."""

    words: Annotated[str, AfterValidator(lambda text: " ".join(text.split()))]
    limits: dict[str, Bounds]


class _Requirements(Model):
    limits: Many[Requirement]


def requirements_of(file: Path | None, columns: Sequence[str]) -> list[Requirement]:
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
    rules = validate(
        _Requirements, {"limits": content_of(read_text(path, "limits"), str(path))}, str(path)
    ).limits
    unknown = [column for rule in rules for column in rule.limits if column not in columns]
    if unknown and file is not None:
        raise InputError(
            f"{file}: {unknown[0]} is not a figure of merit of this campaign; "
            f"known: {', '.join(columns)}"
        )
    return [rule for rule in rules if not set(unknown) & rule.limits.keys()]


def figure_files(target: Path, ending: str | None) -> dict[str, Path | None]:
    """Files beside a report that its figures are also written to, if in a format."""
    return {
        name: target.with_name(f"{target.stem}_{name}.{ending}") if ending else None
        for name in ("ratios", "outside", "parameters")
    }


def write(
    folder: Path, target: Path, limits: Path | None = None, ending: str | None = None
) -> Path:
    """Write the report on the welds in a campaign's folder; returns its path.

    Parameters
    ----------
    folder : Path
        Folder of the campaign, which may still be running.
    target : Path
        File to write; ends in ``.html`` (everything in one file) or ``.md`` (the answer, with all
        tables in ``<stem>_tables.json`` and the worst welds in ``<stem>_worst.md``).
    limits : Path, optional
        File of further limits, see :func:`requirements_of`; the shipped ones by default.
    ending : {"png", "svg", "pdf"}, optional
        Format of the figures' files beside the report.

    Raises
    ------
    InputError
        If the folder is no campaign's or has too few welds, the limits cannot be read, or the
        report not be written.
    """
    if target.suffix not in (".html", ".md"):
        raise InputError(f"{target}: the name of a report must end in .html or .md")
    results = Results(*load(folder), folder)
    if not results.complete.size:
        raise InputError(
            f"{folder} has no weld yet that all controllers have finished; continue with --resume"
        )
    requirements = requirements_of(limits, results.columns)
    whole = target.suffix == ".html"
    ratios = _ratios(results)
    beside = figure_files(target, ending)
    first = results.labels[0]
    drawn = {"ratios": figures.ratios(ratios, first, beside["ratios"]) if ratios else None}
    if whole:
        drawn["outside"] = figures.times_outside(results, beside["outside"])
        drawn["parameters"] = figures.sensitivities(results, beside["parameters"])
    images = {
        f"{target.stem}_{name}.png": image for name, image in drawn.items() if image is not None
    }
    content = _content(results, requirements) | {
        "ratios": [["", *results.labels[1:]], *_ratio_rows(ratios, results.labels[1:])],
        "stem": target.stem,
        "figures": {name for name, image in drawn.items() if image is not None},
        "worst_page": "" if whole else f"{target.stem}_worst.md",
    }
    text = _rendered("report.md.j2" if whole else "page.md.j2", content)
    worst = _rendered("worst.md.j2", content)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if whole:
            text = _html(f"Campaign {results.campaign.name}", f"{text}\n{worst}", images)
        else:
            target.with_name(content["worst_page"]).write_text(worst, encoding="utf-8")
            target.with_name(f"{target.stem}_tables.json").write_text(
                numbers(content["tables"] | {"ratios": ratios}), encoding="utf-8"
            )
            for name, image in images.items():
                target.with_name(name).write_bytes(image)
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror}") from None
    return target


def _rendered(template: str, content: dict[str, Any]) -> str:
    text = re.sub(r"\n{3,}", "\n\n", _TEMPLATES.get_template(template).render(content))
    return f"{text.strip()}\n"


def _html(title: str, markdown: str, images: dict[str, bytes]) -> str:
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    for name, image in images.items():
        body = body.replace(f'src="{name}"', f'src="{source(image)}"')
    return _TEMPLATES.get_template("report.html.j2").render(title=title, body=body)


def _content(results: Results, requirements: Sequence[Requirement]) -> dict[str, Any]:
    """Values for the template."""
    worst, labels = results.worst(), results.labels
    distributions = [
        (path, _words(drawn)) for path, drawn in results.campaign.distributions.items()
    ]
    inside, merit = _inside(results), _figures_of_merit(results)
    one_by_one = _one_by_one(results, requirements)
    return {
        "tables": {
            "distributions": [["parameter", "distribution"], *distributions],
            "welds inside the limits": [_INSIDE, *inside],
            "limits one by one": [["limit", *labels], *one_by_one],
            "figures of merit": [["", *labels], *merit],
        },
        "losses": _losses(results),
        "campaign": results.campaign,
        "labels": labels,
        "best": _best(results),
        "complete": results.complete.size,
        "begun": np.unique(results.table["index"].to_numpy()).size,
        "distributions": distributions,
        "versions": list(
            zip(*np.unique(results.texts("versions"), return_counts=True), strict=True)
        ),
        "limits": [_limit(signal, limit) for signal, limit in results.campaign.limits.items()],
        "one_by_one": one_by_one,
        "chance": results.chance,
        "main": [ROWS[key] for key in MAIN],
        "main_headers": [f"{ROWS[key][0]} [{ROWS[key][1]}]" for key in MAIN],
        "worst": [
            [
                f"{row['index']}, {row['controller']}",
                why,
                *("–" if row[key] is None else f"{row[key]:.3g}" for key in MAIN),
                "yes" if row["inside"] else "no",
            ]
            for row, why in worst
        ],
        "commands": [results.command(row) for row, _ in worst],
    }


def _best(results: Results) -> dict[str, Any] | None:
    """Which controller is best in what; None with one controller."""
    first, *others = results.labels
    if not others:
        return None
    inside = None
    if results.campaign.limits:
        percent = {
            label: 100 * results.inside[results.controller == label].mean()
            for label in results.labels
        }
        inside = max(percent.items(), key=lambda item: item[1])
    medians_by_figure = []
    for key in MAIN:
        medians = {
            label: float(np.median(results.numbers(key, label))) for label in results.labels
        }
        best, second = min(medians, key=medians.__getitem__), min(others, key=medians.__getitem__)
        worse = (
            results.ratio(key, second) > 1.0 if best == first else results.ratio(key, best) < 1.0
        )
        medians_by_figure.append(
            {
                "figure": ROWS[key][0],
                "label": best,
                "is_first": best == first,
                "next": second,
                "percent": 100 * np.mean(worse),
            }
        )
    return {"inside": inside, "medians": medians_by_figure}


def _words(law: Distribution) -> str:
    if law.choice:
        return f"one of {', '.join(map(str, law.choice))}"
    mean = f", mean {law.normal.mean:g}, deviation {law.normal.deviation:g}" if law.normal else ""
    low, high = law.bounds
    return f"{law.kind}, {low:g} to {high:g}{mean}"


def _limit(signal: str, limit: Limit) -> str:
    low = f"from {limit.min:g} " if limit.min is not None else ""
    high = f"to {limit.max:g}" if limit.max is not None else ""
    return f"`{signal}` {low}{high}".rstrip() + (
        f", outside for at most {limit.at_most_s:g} s" if limit.at_most_s else ""
    )


def _inside(results: Results) -> list[list[str]]:
    status, rows = results.texts("status"), []
    for label in results.labels:
        own = results.controller == label
        good, total = results.count(results.inside, label)
        low, high = wilson(good, total)
        counts = [str(int(np.sum(status[own] == word))) for word in (OK, DIVERGED, ERROR)]
        rows.append(
            [
                label,
                *counts,
                str(good),
                f"{100 * good / total:.2f}",
                f"{100 * low:.2f} to {100 * high:.2f}",
            ]
        )
    return rows


def _one_by_one(results: Results, requirements: Sequence[Requirement]) -> list[list[str]]:
    """Share of the welds that keep each limit of the campaign, and each further one, alone."""
    own = [
        (_limit(signal, limit), {f"outside_{signal}_s": Bounds(max=limit.at_most_s)})
        for signal, limit in results.campaign.limits.items()
    ]
    rows, all_met = [], results.texts("status") == OK
    for words, bounds in [*own, *((rule.words, rule.limits) for rule in requirements)]:
        met = results.meets(bounds)
        if met is not None:
            all_met &= met
            rows.append([words, *(_share(results, met, label) for label in results.labels)])
    if rows:
        rows.append(
            ["all of these", *(_share(results, all_met, label) for label in results.labels)]
        )
    return rows


def wilson(good: int, total: int) -> tuple[float, float]:
    """Wilson interval (95 %) of a share."""
    from scipy.stats import binomtest  # heavy to import

    low, high = binomtest(good, total).proportion_ci(method="wilson")
    return float(low), float(high)


def _share(results: Results, good: NDArray[np.bool_], label: str) -> str:
    count, total = results.count(good, label)
    low, high = wilson(count, total)
    return f"{100 * count / total:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def _figures_of_merit(results: Results) -> list[list[str]]:
    rows = []
    for key in results.figures:
        meaning, unit, factor = ROWS[key]
        cells = []
        for label in results.labels:
            values = results.numbers(key, label) * factor
            values = values[np.isfinite(values)]
            cells.append(
                f"{np.median(values):.3g} [{np.quantile(values, 0.95):.3g}]"
                if values.size
                else "–"
            )
        rows.append([f"{meaning} [{unit}]" if unit else meaning, *cells])
    return rows


def _losses(results: Results) -> list[tuple[str, str, float]]:
    """Figures in which another controller beats the first on most plants, and their percentage."""
    losses = []
    for key in results.figures:
        if ROWS[key][1] in ("", "%"):  # counts and shares
            continue
        for label in results.labels[1:]:
            values = results.ratio(key, label)
            percent = 100.0 * float(np.mean(values < 1.0)) if values.size else 0.0
            if percent > _MOST_PERCENT:
                losses.append((ROWS[key][0], label, percent))
    return losses


def _ratios(results: Results) -> dict[str, dict[str, figures.Spread]]:
    """Spread of the ratios to the first controller, by figure of merit and controller."""
    spreads = {}
    for key in results.figures:
        if ROWS[key][1] in ("", "%"):  # counts and shares
            continue
        ratios = {label: results.ratio(key, label) for label in results.labels[1:]}
        if own := {label: _spread(values) for label, values in ratios.items() if values.size}:
            spreads[ROWS[key][0]] = own
    return spreads


def _spread(values: Vector) -> figures.Spread:
    low, middle, high = (float(np.quantile(values, share)) for share in (0.05, 0.5, 0.95))
    return low, middle, high, 100.0 * float(np.mean(values < 1.0))


def _ratio_rows(
    ratios: Mapping[str, Mapping[str, figures.Spread]], labels: Sequence[str]
) -> list[list[str]]:
    cell = "{1:.2f} [{0:.2f}, {2:.2f}], {3:.1f} %"
    return [
        [title, *(cell.format(*of[label]) if label in of else "–" for label in labels)]
        for title, of in ratios.items()
    ]
