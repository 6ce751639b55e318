"""The report on a campaign: one HTML file with its figures in it, or Markdown with the figures beside it."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fsw_analysis.kpi_table import ROWS
from fsw_campaign import figures, quality
from fsw_campaign.dataset import load
from fsw_campaign.definition import Limit
from fsw_campaign.distributions import Distribution
from fsw_campaign.errors import CampaignError
from fsw_campaign.quality import Requirement
from fsw_campaign.statistics import MAIN, Results
from fsw_campaign.welds import DIVERGED, ERROR, OK

_STYLE = (
    "body{font:15px/1.45 sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}table{border-collapse:collapse}"
    "td,th{border:1px solid #ccc;padding:.2rem .6rem;text-align:right}td:first-child,th:first-child{text-align:left}"
    "img{max-width:100%}pre{background:#f4f4f4;padding:.6rem;white-space:pre-wrap;overflow-wrap:anywhere}"
)


@dataclass(frozen=True, slots=True)
class _Table:
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class _Figure:
    name: str
    title: str
    png: bytes


@dataclass(frozen=True, slots=True)
class _Code:
    text: str


_Block = str | _Table | _Figure | _Code
_Section = tuple[str, list[_Block]]


def write(folder: Path, target: Path, limits: Path | None = None) -> Path:
    """Write the report on the welds in a campaign's folder; returns its path.

    Parameters
    ----------
    folder : Path
        Of the campaign; it may still be running.
    target : Path
        Name ends in ``.html`` or ``.md``.
    limits : Path, optional
        File of further limits, see :mod:`fsw_campaign.quality`; the shipped ones by default.

    Raises
    ------
    CampaignError
        If the folder is no campaign's or has too few welds, the limits cannot be read, or the report not be written.
    """
    if target.suffix not in (".html", ".md"):
        raise CampaignError(f"{target}: the name of a report ends in .html or .md")
    results = Results(*load(folder), folder)
    if not results.complete.size:
        raise CampaignError(f"{folder} has no weld yet that all controllers have run; go on with --resume")
    requirements = quality.read(limits, results.columns)
    sections = _sections(results, requirements)
    title = f"Campaign {results.campaign.name}"
    text = _markdown(title, sections, target) if target.suffix == ".md" else _html(title, sections)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.suffix == ".md":
            for _, blocks in sections:
                for block in blocks:
                    if isinstance(block, _Figure):
                        _beside(target, block).write_bytes(block.png)
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CampaignError(f"cannot write {target}: {error.strerror}") from None
    return target


def _beside(target: Path, figure: _Figure) -> Path:
    return target.with_name(f"{target.stem}_{figure.name}.png")


def _sections(results: Results, requirements: Sequence[Requirement]) -> list[_Section]:
    campaign = results.campaign
    ratios, outside = figures.ratios(results), figures.times_outside(results)
    sensitivities = figures.sensitivities(results)
    found: list[_Section] = [("", _head(results))]
    if campaign.limits:
        found.append(("Welds inside the limits", _inside(results)))
        if outside:
            found[-1][1].append(_Figure("outside", "Time outside the limits", outside))
    if one_by_one := _one_by_one(results, requirements):
        found.append(("Limits one by one", one_by_one))
    found.append(("Figures of merit", _figures_of_merit(results)))
    if ratios:
        words = (
            f"Each weld's figure over that of `{results.labels[0]}` on the same plant with the same noise: median "
            "[5 %, 95 %], and how often it is below 1."
        )
        found.append(("Ratios", [words, _ratios(results), _Figure("ratios", "Distributions of the ratios", ratios)]))
    if sensitivities:
        found.append(
            ("Which parameters matter", [_meaning(results), _Figure("parameters", "Sensitivities", sensitivities)])
        )
    found.append(("The worst welds", _worst(results)))
    return found


def _head(results: Results) -> list[_Block]:
    campaign, index = results.campaign, results.table["index"].to_numpy()
    complete = "" if results.complete.size == campaign.welds else f" ({np.unique(index).size} are there so far)"
    words = (
        f"Scenario `{campaign.scenario['name']}`, {campaign.welds} welds{complete} with each controller, sampler "
        f"{campaign.sampler.replace('_', ' ')}, seed {campaign.seed}, digest {campaign.digest}. A weld has the same "
        "plant and the same sensor noise under all controllers. Errors are those of the true outputs, without noise."
    )
    rows = [(one.path, _words(one)) for one in campaign.distributions]
    return [
        campaign.description,
        *_findings(results),
        words,
        *([_Table(("parameter", "distribution"), rows)] if rows else []),
        *_versions(results.texts("versions")),
    ]


def _findings(results: Results) -> list[str]:
    """Which controller is best in what, in a sentence each; nothing with one controller."""
    first, *others = results.labels
    if not others:
        return []
    found = []
    if results.campaign.limits:
        shares = {label: results.share(results.inside, label)[0] for label in results.labels}
        best = max(shares, key=lambda label: shares[label])
        of_best, total, *_ = results.share(results.inside, best)
        found.append(f"`{best}` is most often inside all limits, in {100 * of_best / total:.1f} % of the welds.")
    for key in MAIN:
        medians = {label: float(np.median(results.numbers(key, label))) for label in results.labels}
        best = min(medians, key=lambda label: medians[label])
        sentence = f"The median {ROWS[key][0]} is least with `{best}`"
        if best == first:
            second = min(others, key=lambda label: medians[label])
            above = 100 * np.mean(results.ratio(key, second) > 1.0)
            found.append(f"{sentence}; `{second}`, the next one, is worse on {above:.0f} % of the plants.")
        else:
            below = 100 * np.mean(results.ratio(key, best) < 1.0)
            found.append(f"{sentence}, which is better than `{first}` on {below:.0f} % of the plants.")
    return [" ".join(found)]


def _versions(versions: NDArray[np.str_]) -> list[str]:
    """Software that computed the welds; with a warning where it was not one."""
    found, counts = np.unique(versions, return_counts=True)
    if found.size == 1:
        return [f"Versions: {found[0]}."]
    listed = "; ".join(f"{count} welds by {one}" for one, count in zip(found, counts, strict=True))
    return [f"Mixed versions: {listed}. Welds of different software are not to be compared: differences may be its."]


def _words(one: Distribution) -> str:
    if one.kind == "choice":
        return f"one of {', '.join(map(str, one.choices))}"
    mean = f", mean {one.mean:g}, deviation {one.deviation:g}" if one.kind == "normal" else ""
    return f"{one.kind}, {one.low:g} to {one.high:g}{mean}"


def _limit(one: Limit) -> str:
    low = f"from {one.low:g} " if one.low is not None else ""
    high = f"to {one.high:g}" if one.high is not None else ""
    return f"`{one.signal}` {low}{high}, outside for at most {one.at_most_s:g} s"


def _inside(results: Results) -> list[_Block]:
    status, rows = results.texts("status"), []
    for label in results.labels:
        own = results.controller == label
        good, total, low, high = results.share(results.inside, label)
        counts = [str(int(np.sum(status[own] == word))) for word in (OK, DIVERGED, ERROR)]
        rows.append([label, *counts, str(good), f"{100 * good / total:.2f}", f"{100 * low:.2f} to {100 * high:.2f}"])
    header = ("", "ended", "diverged", "error", "inside", "share [%]", "Wilson interval, 95 % [%]")
    words = f"A weld is inside while it keeps {'; '.join(map(_limit, results.campaign.limits))}."
    return [words, _Table(header, rows)]


def _one_by_one(results: Results, requirements: Sequence[Requirement]) -> list[_Block]:
    """Share of the welds that keep each limit of the campaign, and each further one, alone."""
    own = [(_limit(one), {f"outside_{one.signal}_s": (0.0, one.at_most_s)}) for one in results.campaign.limits]
    rows, all_met = [], results.texts("status") == OK
    for words, bounds in [*own, *((one.words, one.bounds) for one in requirements)]:
        met = results.meets(bounds)
        if met is not None:
            all_met &= met
            rows.append([words, *(_share(results, met, label) for label in results.labels)])
    if not rows:
        return []
    words = (
        "Share of the welds that ended and kept a limit, in percent, with Wilson's interval (95 %). Limits that are "
        "not the campaign's own are limits of figures of merit, chosen for the report."
    )
    rows.append(["all of these", *(_share(results, all_met, label) for label in results.labels)])
    return [words, _Table(("limit", *results.labels), rows)]


def _share(results: Results, good: NDArray[np.bool_], label: str) -> str:
    count, total, low, high = results.share(good, label)
    return f"{100 * count / total:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def _meaning(results: Results) -> str:
    correlation, share = results.chance
    return (
        "Of the ranks of each figure. Left, Spearman's rank correlation with a parameter: 1 or -1 where it alone "
        f"orders the welds; chance stays within ±{correlation:.2f} (95 %, {results.complete.size} plants; grey). "
        "Right, Sobol's first-order index (from 75 plants on): the share of the variance that goes with the parameter "
        f"alone, in whatever direction; chance stays below {share:.3f}. Where it is much above the square of the "
        "correlation, the figure is best at a middle value. What 'together' lacks of 1 is due to parameters acting "
        "together, and to noise."
    )


def _figures_of_merit(results: Results) -> list[_Block]:
    rows = []
    for key in results.figures:
        meaning, unit, factor = ROWS[key]
        cells = []
        for label in results.labels:
            values = results.numbers(key, label) * factor
            values = values[np.isfinite(values)]
            cells.append(f"{np.median(values):.3g} [{np.quantile(values, 0.95):.3g}]" if values.size else "–")
        rows.append([f"{meaning} [{unit}]" if unit else meaning, *cells])
    words = f"Median [95 % quantile] over the {results.complete.size} plants on which all controllers ended."
    return [words, _Table(("", *results.labels), rows)]


def _ratios(results: Results) -> _Table:
    rows = []
    for key in results.figures:
        if ROWS[key][1] in ("", "%"):  # counts and shares
            continue
        cells = []
        for label in results.labels[1:]:
            values = results.ratio(key, label)
            if not values.size:
                cells.append("–")
                continue
            low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
            cells.append(f"{middle:.2f} [{low:.2f}, {high:.2f}], {100 * np.mean(values < 1.0):.1f} %")
        if any(cell != "–" for cell in cells):
            rows.append([ROWS[key][0], *cells])
    return _Table(("", *results.labels[1:]), rows)


def _worst(results: Results) -> list[_Block]:
    worst = results.worst()
    names = " or ".join(ROWS[key][0] for key in MAIN)
    words = (
        f"First those that did not end, then those with the largest {names} over the median of their controller. Each "
        "command runs the weld again, to the last digit of its figures of merit, and draws it; with `--bag` it also "
        "records the weld in the graph."
    )
    rows = []
    for row, why in worst:
        numbers = ["–" if row[key] is None else f"{row[key]:.3g}" for key in MAIN]
        rows.append([f"{row['index']}, {row['controller']}", why, *numbers, "yes" if row["inside"] else "no"])
    table = _Table(("weld", "why", *(f"{ROWS[key][0]} [{ROWS[key][1]}]" for key in MAIN), "inside"), rows)
    return [words, table, _Code("\n".join(results.command(row) for row, _ in worst))]


def _markdown(title: str, sections: Sequence[_Section], target: Path) -> str:
    lines = [f"# {title}", ""]
    for heading, blocks in sections:
        lines += [f"## {heading}", ""] if heading else []
        for block in blocks:
            if isinstance(block, _Table):
                marks = ["---", *["---:"] * (len(block.header) - 1)]
                lines += ["| " + " | ".join(row) + " |" for row in [block.header, marks, *block.rows]]
            elif isinstance(block, _Figure):
                lines.append(f"![{block.title}]({_beside(target, block).name})")
            elif isinstance(block, _Code):
                lines += ["```", block.text, "```"]
            else:
                lines.append(block)
            lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _html(title: str, sections: Sequence[_Section]) -> str:
    lines = [f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title><style>{_STYLE}</style>"]
    lines.append(f"<h1>{escape(title)}</h1>")
    for heading, blocks in sections:
        lines += [f"<h2>{escape(heading)}</h2>"] if heading else []
        for block in blocks:
            if isinstance(block, _Table):
                rows = [("th", block.header), *(("td", row) for row in block.rows)]
                cells = ("".join(f"<{tag}>{_words_html(cell)}</{tag}>" for cell in row) for tag, row in rows)
                lines.append(f"<table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>")
            elif isinstance(block, _Figure):
                data = base64.b64encode(block.png).decode()
                lines.append(f'<p><img alt="{escape(block.title)}" src="data:image/png;base64,{data}">')
            elif isinstance(block, _Code):
                lines.append(f"<pre>{escape(block.text)}</pre>")
            else:
                lines.append(f"<p>{_words_html(block)}</p>")
    return "\n".join([*lines, "</html>"]) + "\n"


def _words_html(text: str) -> str:
    """Words with their ``code`` as HTML."""
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text))
