"""The history of welds.

Rows are kept, what is unlike is found, and a tool's life has an interval.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyarrow")

import pyarrow as pa

from fsw_control.schema.extensions import all_loaded
from fsw_control.schema.models import InputError
from fsw_quality import control_charts, history, history_report
from fsw_quality.diagnosis import Finding, WatchCause
from fsw_quality.history_report import LIMITS, Kind
from fsw_test_support.made_history import rows


def test_welds_are_added_and_read_in_order(tmp_path: Path) -> None:
    made = rows(9)
    for i, row in enumerate(made):
        assert history.add(tmp_path, [row]) == i + 1
    table = history.load(tmp_path)
    assert table["weld"].to_pylist() == [row["weld"] for row in made]
    assert table.to_pylist()[7] == made[7]


def test_a_weld_twice_is_refused_and_nothing_is_added(tmp_path: Path) -> None:
    made = rows(6)
    history.add(tmp_path, made[:5])
    with pytest.raises(InputError, match="W00003"):
        history.add(tmp_path, [made[5], made[3]])
    assert history.load(tmp_path).num_rows == 5


def test_a_weld_under_another_name_is_refused_and_nothing_is_added(tmp_path: Path) -> None:
    made = rows(6)
    made[1]["files_sha256"] += ",a1"
    history.add(tmp_path, made[:5])
    with pytest.raises(InputError, match=r"again .* W00001"):
        history.add(tmp_path, [made[5], made[0] | {"weld": "again", "files_sha256": "a1"}])
    with pytest.raises(InputError, match=r"\bB .*\bA\b"):
        history.add(tmp_path, [made[5] | {"weld": "A"}, made[5] | {"weld": "B"}])
    assert history.load(tmp_path).num_rows == 5
    # of a weld whose files are not known, as in a history that was begun before they were noted,
    # the name counts
    assert (
        history.add(
            tmp_path, [made[5] | {"files_sha256": ""}, made[5] | {"weld": "C", "files_sha256": ""}]
        )
        == 7
    )


def test_a_history_that_was_begun_without_hashes_and_settings_is_continued(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    made, new = rows(12), [*history.SETTINGS, "files_sha256"]
    pq.write_table(pa.Table.from_pylist(made[:6]).drop_columns(new), tmp_path / "history.parquet")
    assert history.add(tmp_path, made[6:]) == 12
    table = history.load(tmp_path)
    assert all(table[name].to_pylist()[0] is None and table[name].to_pylist()[6] for name in new)
    # what is not known has not changed
    assert history.changes(table.to_pylist()[0], table.to_pylist()[6]) == []
    assert not [
        remark
        for remark in history_report.write(table, tmp_path / "a.html", "A")
        if remark.kind is Kind.CHANGE
    ]
    assert np.isnan(
        history_report.charts(table)["torque_nm"].scores[6:11]
    ).all()  # of the procedure, known from here on


def test_what_was_set_otherwise_is_told_by_its_name() -> None:
    before = rows(1)[0]
    tuning = {"decentral": {"tuning": "smith", "band": 3}, "nmpc": {"horizon": 40}}
    after = before | {
        "tool": "T2",
        "procedure": "lid B",
        "procedure_sha256": "b" * 64,
        "tuning": json.dumps(tuning),
        "software": json.dumps(
            {"welded": {"numpy": "2.1"}, "judged": {"fsw-control": "1.0", "scipy": "1"}}
        ),
        "controllers": "decentral, nmpc",
    }
    assert history.changes(before, before) == []
    assert history.changes(before, after) == [
        ("tool", "T1", "T2"),
        ("procedure", "lid A", "lid B"),
        ("procedure_sha256", "a" * 12, "b" * 12),
        ("controllers", "decentral", "decentral, nmpc"),
        ("tuning, decentral: tuning", "tight", "smith"),
        ("tuning, decentral: band", "-", "3"),
        ("software, welded: numpy", "2.0", "2.1"),
        ("software, judged: scipy", "-", "1"),
    ]
    table = pa.Table.from_pylist([before, after], history.SCHEMA)
    changed = [
        remark for remark in history_report.remarks(table, {}) if remark.kind is Kind.CHANGE
    ]
    assert [remark.at for remark in changed] == [1]
    for word in ("tool", "procedure", "tuning, decentral: tuning", "software, welded: numpy"):
        assert word in changed[0].subject


def test_no_history_and_a_damaged_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no history"):
        history.load(tmp_path)
    history.add(tmp_path, rows(2))
    (tmp_path / "history.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(InputError, match=r"history.parquet: cannot be read"):
        history.load(tmp_path)


def test_a_history_of_numbered_files_is_refused_not_begun_again(tmp_path: Path) -> None:
    old = tmp_path / "000001.parquet"
    old.touch()
    with pytest.raises(InputError):
        history.add(tmp_path, rows(1))
    assert list(tmp_path.glob("*.parquet")) == [old]


def test_what_changed_between_two_welds_is_told_and_what_did_not_is_not(tmp_path: Path) -> None:
    made = rows(30, wear_nm=0.0)
    made[20] |= {"tool": "T2", "torque_nm": 1060.0, "swaps": 1}
    history.add(tmp_path, made)
    changes = history.difference(history.load(tmp_path), "W00010", "W00020")
    assert [change[0] for change in changes] == ["tool", "swaps", history.NUMBERS["torque_nm"]]
    assert changes[-1][3] > 10.0
    assert history.difference(history.load(tmp_path), "W00010", "W00010") == []
    with pytest.raises(InputError, match=r"W99999 .*W000"):
        history.difference(history.load(tmp_path), "W00010", "W99999")


def test_equal_welds_give_no_signal_and_a_shift_and_an_outlier_do() -> None:
    values = np.random.default_rng(2).normal(5.0, 0.1, 60)
    quiet = control_charts.chart(values, LIMITS)
    assert quiet is not None and quiet.signals == {"shewhart": [], "cusum": []}
    assert np.isnan(quiet.scores[:5]).all() and np.abs(quiet.scores[5:]).max() < LIMITS.shewhart
    assert quiet.centre[-1] == pytest.approx(5.0, abs=0.1)
    shifted = control_charts.chart(values + 0.2 * (np.arange(60) >= 40), LIMITS)
    assert shifted is not None and 40 <= shifted.signals["cusum"][0] < 55
    values[30] = 7.0
    outlier = control_charts.chart(values, LIMITS)
    assert outlier is not None and outlier.signals == {"shewhart": [30], "cusum": []}
    assert outlier.centre[31] == outlier.centre[30]  # it has not said what is normal


@pytest.mark.parametrize("skewed", [False, True])
@given(
    seed=st.integers(0, 1000),
    scale=st.floats(1e-3, 1e3),
    shift=st.floats(-100.0, 100.0),
)
def test_scores_do_not_depend_on_unit_and_origin_nor_signals_on_sign(
    skewed: bool, seed: int, scale: float, shift: float
) -> None:
    values = np.random.default_rng(seed).normal(5.0, 1.0, 40)
    values[30:] += 4.0
    least = 0.01
    made = control_charts.chart(values, LIMITS, least, skewed)
    origin = 0.0 if skewed else shift
    other = control_charts.chart(scale * (values + origin), LIMITS, scale * least, skewed)
    assert made is not None and other is not None and other.signals == made.signals
    np.testing.assert_allclose(other.scores, made.scores, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        other.high[5:], scale * (made.high[5:] + origin), rtol=1e-6, atol=scale * 1e-6
    )
    if not skewed:
        mirrored = control_charts.chart(-values, LIMITS, least)
        assert mirrored is not None and mirrored.signals == made.signals
        np.testing.assert_array_equal(mirrored.fall, made.rise)


@given(seed=st.integers(0, 1000), welds=st.integers(6, 40))
def test_a_score_depends_on_the_welds_before_but_not_on_their_order_nor_on_gaps(
    seed: int, welds: int
) -> None:
    """As long as nothing signals: a weld that does says nothing of the later ones."""
    quiet = control_charts.Limits(shewhart=30.0, cusum=1000.0)
    random = np.random.default_rng(seed)
    values = random.normal(5.0, 1.0, welds)
    made = control_charts.chart(values, quiet)
    mixed = control_charts.chart(np.append(random.permutation(values[:-1]), values[-1]), quiet)
    gaps = np.full(2 * welds, np.nan)
    gaps[1::2] = values
    apart = control_charts.chart(gaps, quiet)
    assert made is not None and mixed is not None and apart is not None
    assert mixed.scores[-1] == pytest.approx(made.scores[-1], abs=1e-9)
    np.testing.assert_array_equal(apart.scores[1::2], made.scores)
    assert np.isnan(apart.scores[::2]).all()
    shorter = control_charts.chart(values[:-1], quiet)
    if shorter is not None:
        np.testing.assert_array_equal(shorter.scores, made.scores[:-1])


def test_scores_of_normal_welds_are_normal_from_the_first_that_is_judged_on() -> None:
    random = np.random.default_rng(6)
    made = [control_charts.chart(random.normal(5.0, 1.0, 9), LIMITS) for _ in range(500)]
    scores = np.array(
        [entry.scores[control_charts.LEAST_WELDS :] for entry in made if entry is not None]
    )
    assert scores.shape == (500, 4)
    for weld in range(4):
        assert scipy.stats.kstest(scores[:, weld], "norm").pvalue > 1e-3


def test_correlation_from_weld_to_weld_is_noted_and_a_shift_or_wear_is_none() -> None:
    random, welds, quantities = np.random.default_rng(10), 100, 13
    fresh = random.normal(size=(200, welds))
    correlated = scipy.signal.lfilter([np.sqrt(0.75)], [1.0, -0.5], fresh)
    away = np.arange(welds) > 50

    def noted(histories: np.ndarray, groups: list[int] | None = None) -> tuple[float, int]:
        made = [control_charts.chart(history, LIMITS, groups=groups) for history in histories]
        judged = [
            control_charts.correlation(entry, quantities, groups)
            for entry in made
            if entry is not None
        ]
        return float(np.median([share for share, _ in judged])), sum(sure for _, sure in judged)

    share, count = noted(correlated)
    assert share == pytest.approx(0.5, abs=0.1) and count > 100
    share, count = noted(fresh)
    assert share == pytest.approx(0.0, abs=0.1) and count <= 2
    assert noted(fresh + 3.0 * away)[1] <= 2 and noted(fresh + 0.1 * np.arange(welds))[1] <= 2
    # of two tools in turn each has its own correlation, and none with the other
    assert noted(correlated, [weld % 2 for weld in range(welds)])[0] < 0.35
    assert noted(fresh + 9.0 * (np.arange(welds) % 2), [weld % 2 for weld in range(welds)])[1] <= 2


def test_the_report_notes_correlated_quantities() -> None:
    made, random = rows(120, wear_nm=0.0), np.random.default_rng(11)
    power_kw = 50.0 + scipy.signal.lfilter([1.0], [1.0, -0.6], random.normal(size=120))
    made = [row | {"power_kw": float(power)} for row, power in zip(made, power_kw, strict=True)]
    table = pa.Table.from_pylist(made, history.SCHEMA)
    said = history_report.remarks(table, history_report.charts(table))
    noted = [(remark.at, remark.subject) for remark in said if remark.kind is Kind.CORRELATION]
    assert noted == [(119, "power_kw")]


def test_no_chart_of_few_values_or_without_spread() -> None:
    assert control_charts.chart(np.array([1.0, np.nan, 2.0]), LIMITS) is None
    assert control_charts.chart(np.arange(5.0), LIMITS) is None
    assert control_charts.chart(np.array([]), LIMITS) is None
    assert control_charts.chart(np.full(20, 0.1), LIMITS) is None
    assert control_charts.chart(np.full(20, 0.1), LIMITS, least=0.1) is not None
    jump = control_charts.chart(np.append(np.ones(20), 2.0), LIMITS, least=0.1)
    assert jump is not None and jump.signals["shewhart"] == [20]


def test_a_new_tool_begins_a_new_chart_and_an_old_one_continues_its_own() -> None:
    random = np.random.default_rng(7)
    first, second = random.normal(5.0, 0.1, 30), random.normal(9.0, 0.1, 30)
    groups = ["a"] * 20 + ["b"] * 30 + ["a"] * 10
    made = control_charts.chart(
        np.concatenate([first[:20], second, first[20:]]), LIMITS, groups=groups
    )
    alone = control_charts.chart(first, LIMITS)
    assert made is not None and alone is not None and made.signals == {"shewhart": [], "cusum": []}
    np.testing.assert_array_equal(np.delete(made.scores, np.s_[20:50]), alone.scores)


def test_welds_that_were_not_accepted_do_not_say_what_is_normal() -> None:
    made = rows(40, wear_nm=0.0)
    for i in range(10, 20):
        made[i] |= {"torque_nm": made[i]["torque_nm"] + 3.0}
    alike = history_report.charts(pa.Table.from_pylist(made, history.SCHEMA))["torque_nm"]
    for i in range(10, 20):
        made[i] |= {"verdict": "review"} if i % 2 else {"verdict": "", "alarms": 1}
    apart = history_report.charts(pa.Table.from_pylist(made, history.SCHEMA))["torque_nm"]
    assert alike.centre[20] > alike.centre[10] + 1.0
    assert apart.centre[20] == apart.centre[10]


def test_each_tool_has_its_first_signal() -> None:
    made = rows(60, wear_nm=0.0)
    for i, row in enumerate(made):
        row |= {
            "tool": f"T{1 + i // 30}",
            "torque_nm": row["torque_nm"] + 30.0 * (i in (20, 25, 50)),
        }
    table = pa.Table.from_pylist(made, history.SCHEMA)
    said = history_report.remarks(table, history_report.charts(table))
    shown = [
        remark.at for remark in said if (remark.kind, remark.subject) == (Kind.CHART, "torque_nm")
    ]
    assert shown == [20, 50]


def test_limits_keep_the_share_of_false_signals_that_they_follow_from() -> None:
    quantities, histories = 3, 300
    charts, random = control_charts.limits(quantities), np.random.default_rng(8)
    both = charts.quiet(control_charts.WELDS) ** (2 * quantities)
    assert 1.0 - both == pytest.approx(control_charts.FALSE_SIGNALS, rel=1e-6)
    signalled = 0
    for _ in range(histories):
        made = [
            control_charts.chart(random.normal(size=control_charts.WELDS), charts)
            for _ in range(quantities)
        ]
        signalled += any(
            at for entry in made if entry is not None for at in entry.signals.values()
        )
    assert scipy.stats.binomtest(signalled, histories, control_charts.FALSE_SIGNALS).pvalue > 1e-3
    lengths = [charts.run_length(shift) for shift in (0.0, 1.0, 2.0, 3.0)]
    assert lengths == sorted(lengths, reverse=True) and charts.run_length(-1.0) == pytest.approx(
        lengths[1]
    )
    wider = control_charts.limits(4 * quantities)
    assert wider.cusum > charts.cusum and wider.shewhart > charts.shewhart


def test_the_run_length_is_that_of_the_charts() -> None:
    charts, random = control_charts.Limits(3.0, 4.0), np.random.default_rng(9)
    # Montgomery, Introduction to Statistical Quality Control, table 9.4: a CUSUM with these
    # figures, alone
    assert control_charts.Limits(9.0, 4.0).run_length() == pytest.approx(168.0, rel=0.01)
    assert control_charts.Limits(9.0, 5.0).run_length(1.0) == pytest.approx(10.4, rel=0.01)
    lengths = []
    for _ in range(2000):
        scores = random.normal(1.0, 1.0, 200)
        rise, weld = 0.0, 0
        while weld < 200 and scores[weld] <= charts.shewhart and rise <= charts.cusum:
            rise = max(0.0, rise + scores[weld] - control_charts.SLACK)
            weld += rise <= charts.cusum
        lengths.append(weld + 1)
    assert charts.run_length(1.0) == pytest.approx(np.mean(lengths), rel=0.05)


def test_a_tool_that_wears_has_a_life_whose_interval_holds_the_true_one() -> None:
    torque = 1000.0 + 0.8 * np.arange(30) + np.random.default_rng(3).normal(0.0, 2.0, 30)
    trend = control_charts.trend(torque, 50.0)
    assert trend is not None and trend.significant
    soonest, expected, latest = trend.life
    assert soonest < 50.0 / 0.8 < latest and expected == pytest.approx(50.0 / 0.8, rel=0.3)
    steady = control_charts.trend(np.random.default_rng(4).normal(1000.0, 2.0, 30), 50.0)
    assert steady is not None and not steady.significant and steady.life[2] == float("inf")
    assert control_charts.trend(torque[:4], 50.0) is None


def alarm(
    cause: WatchCause, begin_s: float, size: float, *others: WatchCause
) -> dict[str, object]:
    error = 0.1 * size
    return {"begin_s": begin_s, "cause": cause, "size": size, "error": error, "others": others}


def alarms_of(table: pa.Table) -> list[history_report.Remark]:
    said = history_report.remarks(table, {})
    return [remark for remark in said if remark.kind is Kind.ALARM]


def test_an_alarm_that_many_welds_have_is_one_line(tmp_path: Path) -> None:
    made = rows(30)
    for at in range(5, 25):  # neither figures nor other causes make it another alarm
        others = [WatchCause.TORQUE_DRIFT] * (at % 2)
        made[at][history.FINDINGS] = [alarm(WatchCause.TOOL_WEAR, 2600.0 + at, 0.05 + at, *others)]
    made[7][history.FINDINGS].append(alarm(WatchCause.TORQUE_DRIFT, 90.0, 0.1))
    history.add(tmp_path, made)
    said = alarms_of(history.load(tmp_path))
    assert [(remark.at, remark.subject) for remark in said] == [
        (5, "tool_wear"),
        (7, "torque_drift"),
    ]
    finding = Finding(WatchCause.TOOL_WEAR, True, 5.05, 0.505, others=(WatchCause.TORQUE_DRIFT,))
    assert f"2605 s: {finding.text}" in said[0].text
    assert "20 welds" in said[0].text and "W00024" in said[0].text


def test_an_alarm_of_a_later_version_is_shown(tmp_path: Path) -> None:
    made = rows(1)
    made[0][history.FINDINGS] = [alarm(200, 5.0, 1.5)]  # type: ignore[arg-type]
    history.add(tmp_path, made)
    assert [remark.subject for remark in alarms_of(history.load(tmp_path))] == ["unknown"]


def test_the_report_has_what_stands_out(tmp_path: Path) -> None:
    made = rows(40)
    made[25] |= {
        "swaps": 1,
        "controllers": "decentral, nmpc",
        "operators": "<Ada>",
        "operator_actions": 1,
    }
    made[30] |= {
        "alarm_kinds": "thermocouple_drift",
        "alarm_findings": [alarm(WatchCause.THERMOCOUPLE_DRIFT, 200.0, 0.05)],
        "alarms": 1,
        "verdict": "review",
    }
    history.add(tmp_path, made)
    said = history_report.write(history.load(tmp_path), tmp_path / "report.html", "History")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    shown = {(remark.at, remark.kind, remark.subject) for remark in said}
    assert {
        (25, Kind.SWAP, ""),
        (25, Kind.OPERATOR, "<Ada>"),
        (30, Kind.VERDICT, "review"),
    } <= shown
    assert any(remark.kind is Kind.CHART and remark.subject == "torque_nm" for remark in said)
    assert (
        Finding(WatchCause.THERMOCOUPLE_DRIFT, True, 0.05, 0.005).text in text
        and "operator acted: &lt;Ada&gt;" in text
        and "worn (50 N·m more) after" in text
        and "data:image/png;base64" in text
    )
    page = all_loaded("fsw.pages")["history"]
    shown = page(tmp_path)  # where no style of its own is permitted
    assert "&lt;Ada&gt;" in shown and "<style" not in shown and "../page/report.css" in shown
    with pytest.raises(InputError):
        page(tmp_path / "none")
