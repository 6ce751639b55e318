#!/usr/bin/env python3
"""The history of welds.

False signals of stable welds, delays of shifts and wear, and the time for ten thousand welds.

usage: history.py [--quick] [--json FILE]

Stable histories are normally distributed, or drawn from emulated welds, whose rows are kept in the
folder, so an interrupted run resumes where it stopped.
"""

import json
import tempfile
import time
from functools import partial
from pathlib import Path

import _benchmark
import numpy as np
import pyarrow as pa

import fsw
from fsw_control.schema.files import write_whole
from fsw_quality import history, history_report
from fsw_quality.control_charts import FALSE_SIGNALS, WELDS, chart
from fsw_quality.history_report import CHARTED, LIMITS
from fsw_quality.monitor import Monitor
from fsw_quality.monitor_run import watch
from fsw_scenario.controllers import name_of
from fsw_test_support.made_history import rows

FIGURE = _benchmark.WORKSPACE / "docs" / "figures" / "history.png"
#: emulated welds of each controller, and the folder that keeps their rows
EMULATED, KEPT = 60, Path("out") / "history"
CONTROLLERS = ("decentral:tight", "nmpc:default")
#: the plant differs by so much from weld to weld, as canisters do (chosen), in these coefficients
#: of its model
SPREAD, MODEL = 0.01, ("thermal_gain_c_per_kw", "depth_gain_mm_per_kn_s", "sliding_friction")
#: stable welds before a shift, and welds within which it must signal to count as detected
BEFORE, WITHIN = (10, 20, 50), 100
#: wear of the series of sixty canisters [N m per weld]
WEAR_NM = 0.8
CORRELATION, FEW = 0.3, 50
HISTORIES = 400


def emulated(label, folder, seed):
    """Row of a weld of four minutes: steps of the set-points, and a plant near its model.

    Kept in the folder.
    """
    file = folder / f"{label.replace(':', '_')}_{seed}.json"
    if file.is_file():
        return json.loads(file.read_text(encoding="utf-8"))
    random = np.random.default_rng(seed)
    content = {
        "name": "history",
        "duration_s": 240.0,
        "plant": {
            "seed": seed,
            "factors": {name: float(random.normal(1.0, SPREAD)) for name in MODEL},
        },
        "events": [
            {"at_s": 5.0, "reference": {"depth_mm": 2.66, "temperature_c": 816.4}},
            {"at_s": 140.0, "reference": {"depth_mm": 2.76}},
            {"at_s": 170.0, "reference": {"temperature_c": 826.4}},
        ],
    }
    signals = fsw.simulate(content, label).signals
    row = history.row(f"{label} {seed}", signals, watch(Monitor("paper"), signals), {})
    write_whole(file, json.dumps(row))
    return row


def shares(name, draw, histories, groups=None):
    """Shares of histories with a signal, noted as correlated, and with an unnoted signal.

    ``draw`` returns the quantities of a history, by name.
    """
    signalled, noted = np.zeros((2, histories), bool)
    for i in range(histories):
        charts = history_report.charts_of(draw(), groups=groups)
        signalled[i] = any(at for made in charts.values() for at in made.signals.values())
        noted[i] = bool(history_report.correlated(charts, groups))
    return {
        f"false_share_{name}": float(signalled.mean()),
        f"noted_share_{name}": float(noted.mean()),
        f"unnoted_share_{name}": float((signalled & ~noted).mean()),
    }


def stable(random, correlation=0.0, welds=WELDS):
    """Normally distributed quantities of stable welds, or their logarithms."""
    noise = random.normal(0.0, 1.0, (len(CHARTED), welds))
    for i in range(1, welds):
        noise[:, i] = correlation * noise[:, i - 1] + np.sqrt(1.0 - correlation**2) * noise[:, i]
    return {
        name: 1e6 * np.exp(0.2 * values)
        if name in history_report.SKEWED
        else 1e6 * (10.0 + values)
        for name, values in zip(CHARTED, noise, strict=True)
    }


def delays(random, histories, values_of, before):
    """Median number of welds until a chart signals behind ``before``; share within ``WITHIN``."""
    late = []
    for _ in range(histories):
        made = chart(values_of(random), LIMITS)
        first = [weld for at in made.signals.values() for weld in at if weld >= before]
        late.append(min(first) - before + 1 if first else np.inf)
    return float(np.median(late)), float(np.mean(np.array(late) <= WITHIN))


def shifted(before, shift, random):
    """A normally distributed quantity that shifts after some welds."""
    return random.normal(0.0, 1.0, before + WITHIN) + shift * (
        np.arange(before + WITHIN) >= before
    )


def signals(histories):
    """False signals and delays of normally distributed quantities."""
    random = np.random.default_rng(45)
    figures = {"limit_shewhart_sigma": LIMITS.shewhart, "limit_cusum_sigma": LIMITS.cusum}
    figures |= {"histories": histories, **history_report.performance()}
    figures |= shares("normal", lambda: stable(random), histories)
    tools = [weld // 50 for weld in range(WELDS)]
    figures |= shares("new_tool_every_50", lambda: stable(random), histories, tools)
    figures |= shares("correlated", lambda: stable(random, CORRELATION), histories)
    figures |= shares("correlated_few", lambda: stable(random, CORRELATION, FEW), histories)
    for before in BEFORE:
        for shift in (1, 2, 3):
            late, detected = delays(random, histories, partial(shifted, before, shift), before)
            figures |= {
                f"delay_{shift}_sigma_after_{before}": late,
                f"share_{shift}_sigma_after_{before}": detected,
            }
    return figures


def of_emulated(count, folder, histories):
    """False signals and delay of wear in histories drawn from emulated welds, by controller."""
    figures, made = {"emulated_welds": count}, {}
    folder.mkdir(parents=True, exist_ok=True)
    for label in CONTROLLERS:
        seeds = range(1, count + 1)
        made[label] = welds = _benchmark.each(partial(emulated, label, folder), seeds, label)
        random, name = np.random.default_rng(45), name_of(label)
        table = {column: np.array([weld[column] for weld in welds]) for column in CHARTED}

        def drawn(table=table, random=random, factor=1.0):
            chosen = random.integers(0, count, WELDS)
            return {column: factor * values[chosen] for column, values in table.items()}

        figures |= shares(name, drawn, histories)
        # in other units the least spreads that count do not: what the distributions of the
        # quantities themselves do
        figures |= shares(f"{name}_any_spread", partial(drawn, factor=1e6), histories)
        torque = table["torque_nm"]
        figures[f"sigma_torque_nm_{name}"] = float(torque.std(ddof=1))
        figures[f"weld_of_wear_{name}"], _ = delays(random, histories, partial(_worn, torque), 0)
    even = partial(_worn, np.random.default_rng(45).normal(0.0, 1.0, histories))
    figures["weld_of_wear_1_nm"], _ = delays(random, histories, even, 0)
    return figures, made


def _worn(torque, random):
    return random.choice(torque, WITHIN) + WEAR_NM * np.arange(WITHIN)


def content_of(figures):
    """Content of the page of the results."""
    rows = [
        (
            "quantities normally distributed, or their logarithms, independent of each other",
            "normal",
        ),
        ("the same, a new tool every 50 welds", "new_tool_every_50"),
    ]
    for name in map(name_of, CONTROLLERS):
        rows.append((f"drawn from {figures['emulated_welds']} emulated welds, {name}", name))
        rows.append(("the same, without the least spreads that count", f"{name}_any_spread"))
    rows.append(
        (f"normally distributed, correlated from weld to weld by {CORRELATION}", "correlated")
    )
    return {
        "figures": figures,
        "histories": rows,
        "few": FEW,
        "welds": WELDS,
        "quantities": len(CHARTED),
        "aim": 100.0 * FALSE_SIGNALS,
        "controllers": [name_of(label) for label in CONTROLLERS],
        "correlation": CORRELATION,
        "spread": SPREAD,
        "within": WITHIN,
        "befores": BEFORE,
        "wear_nm": WEAR_NM,
        "delay": _delay,
    }


def _delay(figures, shift, before):
    median, within = (
        figures[f"{what}_{shift}_sigma_after_{before}"] for what in ("delay", "share")
    )
    return f"{'–' if np.isinf(median) else format(median, '.0f')} ({within:.0%})"


def draw(welds, figure):
    """Draw the charts of emulated welds to which wear is added.

    The tool is a new one after five sixths of them.
    """
    new = 5 * len(welds) // 6
    made = [
        weld | {"torque_nm": weld["torque_nm"] + WEAR_NM * (i % new), "tool": f"T{1 + i // new}"}
        for i, weld in enumerate(welds)
    ]
    table = pa.Table.from_pylist(made, history.SCHEMA)
    figure.write_bytes(history_report.draw(table, history_report.charts(table)))


def times(welds):
    """Time of a report, and bytes of a weld."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        history.add(folder, rows(welds, wear_nm=0.01))
        size = sum(file.stat().st_size for file in folder.glob("*.parquet"))
        cpu_s = time.process_time()
        history_report.write(history.load(folder), folder / "report.html", "benchmark")
        cpu_s = time.process_time() - cpu_s
    return {
        "welds": welds,
        "load_and_report_cpu_s": cpu_s,
        "bytes_per_weld": size / welds,
    }


def measure(quick):
    """Figures, and the content of the page; draws its picture."""
    scale = 10 if quick else 1
    figures, content = signals(HISTORIES // scale), {}
    if not quick:
        more, welds = of_emulated(EMULATED, KEPT, HISTORIES)
        figures |= more
    figures |= times(10_000 // scale)
    if not quick:
        content = content_of(figures)
        draw(welds[CONTROLLERS[0]], FIGURE)
    return {key: None if value == np.inf else value for key, value in figures.items()}, content


if __name__ == "__main__":
    _benchmark.run(
        __doc__,
        "a tenth of the histories and of the welds, no emulated ones, no page",
        measure,
        "history",
    )
