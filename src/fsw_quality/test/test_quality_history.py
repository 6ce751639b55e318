"""The history of welds: rows are kept, what is unlike is found, and a tool's life has an interval."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow")

from fsw_quality import control_charts, history, history_report
from fsw_schema.models import InputError
from fsw_test_support.made_history import rows


def test_welds_are_added_and_read_in_order_also_once_files_are_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "_MOST_FILES", 5)
    made = rows(9)
    for i, one in enumerate(made):
        assert history.add(tmp_path, [one]) == i + 1
    table = history.load(tmp_path)
    assert table["weld"].to_pylist() == [one["weld"] for one in made]
    assert len(list(tmp_path.glob("*.parquet"))) == 4
    assert table.to_pylist()[7] == made[7]


def test_a_weld_twice_is_refused_and_nothing_is_added(tmp_path: Path) -> None:
    made = rows(6)
    history.add(tmp_path, made[:5])
    with pytest.raises(InputError, match="W00003 would be in the history twice"):
        history.add(tmp_path, [made[5], made[3]])
    assert history.load(tmp_path).num_rows == 5


def test_a_weld_under_another_name_is_refused_and_nothing_is_added(tmp_path: Path) -> None:
    made = rows(6)
    made[1]["files_sha256"] += ",a1"
    history.add(tmp_path, made[:5])
    with pytest.raises(InputError, match="two records of one weld: again has the files of W00001"):
        history.add(tmp_path, [made[5], made[0] | {"weld": "again", "files_sha256": "a1"}])
    with pytest.raises(InputError, match="two records of one weld: B has the files of A"):
        history.add(tmp_path, [made[5] | {"weld": "A"}, made[5] | {"weld": "B"}])
    assert history.load(tmp_path).num_rows == 5
    # of a weld whose files are not known, as in a history that was begun before they were noted, the name counts
    assert history.add(tmp_path, [made[5] | {"files_sha256": ""}, made[5] | {"weld": "C", "files_sha256": ""}]) == 7


def test_a_history_that_was_begun_without_hashes_is_continued(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    made = rows(3)
    pq.write_table(pa.Table.from_pylist(made[:1]).drop_columns(["files_sha256"]), tmp_path / "000000.parquet")
    assert history.add(tmp_path, made[1:]) == 3
    assert history.load(tmp_path)["files_sha256"].to_pylist()[0] is None


def test_a_weld_in_two_files_counts_once(tmp_path: Path) -> None:
    made = rows(6)
    history.add(tmp_path, made)
    (tmp_path / "000001.parquet").write_bytes((tmp_path / "000000.parquet").read_bytes())
    assert history.load(tmp_path).num_rows == 6


def test_no_history_and_a_damaged_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no history"):
        history.load(tmp_path)
    history.add(tmp_path, rows(2))
    (tmp_path / "000000.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(InputError, match=r"000000.parquet: cannot be read"):
        history.load(tmp_path)


def test_what_changed_between_two_welds_is_told_and_what_did_not_is_not(tmp_path: Path) -> None:
    made = rows(30, wear_nm=0.0)
    made[20] |= {"tool": "T2", "torque_nm": 1060.0, "swaps": 1}
    history.add(tmp_path, made)
    found = history.difference(history.load(tmp_path), "W00010", "W00020")
    assert [one[0] for one in found] == ["tool", "swaps", history.NUMBERS["torque_nm"]]
    assert found[-1][3] > 10.0
    assert history.difference(history.load(tmp_path), "W00010", "W00010") == []
    with pytest.raises(InputError, match=r"weld W99999 is not in the history; it has .* and others before"):
        history.difference(history.load(tmp_path), "W00010", "W99999")


def test_the_charts_are_silent_on_equal_welds_and_signal_a_shift_and_an_outlier() -> None:
    values = np.random.default_rng(2).normal(5.0, 0.1, 60)
    quiet = control_charts.chart(values)
    assert quiet is not None and not quiet.signals["cusum"]
    assert quiet.centre == pytest.approx(5.0, abs=0.1) and quiet.sigma == pytest.approx(0.1, rel=0.5)
    values[40:] += 0.2
    shifted = control_charts.chart(values)
    assert shifted is not None and 40 <= shifted.signals["cusum"][0] < 50 and shifted.signals["ewma"]
    values[40:] -= 0.2
    values[30] = 7.0
    outlier = control_charts.chart(values)
    assert outlier is not None and 30 in outlier.signals["shewhart"]


def test_wear_is_no_signal_of_the_welds_that_say_what_is_normal() -> None:
    values = np.random.default_rng(2).normal(5.0, 0.1, 60) + 0.1 * np.arange(60)
    wearing = control_charts.chart(values)
    assert wearing is not None
    first = {name: at[0] for name, at in wearing.signals.items() if name != "shewhart"}
    assert first == dict.fromkeys(("ewma", "cusum"), control_charts.BASELINE)
    assert sum(at < control_charts.BASELINE for at in wearing.signals["shewhart"]) <= 1


def test_no_chart_without_values_or_spread() -> None:
    assert control_charts.chart(np.array([1.0, np.nan, 2.0])) is None
    assert control_charts.chart(np.ones(20)) is None
    assert control_charts.chart(np.ones(20), least_sigma=0.1) is not None


def test_a_tool_that_wears_has_a_life_whose_interval_holds_the_true_one() -> None:
    torque = 1000.0 + 0.8 * np.arange(30) + np.random.default_rng(3).normal(0.0, 2.0, 30)
    found = control_charts.trend(torque, 50.0)
    assert found is not None and found.significant
    soonest, expected, latest = found.life
    assert soonest < 50.0 / 0.8 < latest and expected == pytest.approx(50.0 / 0.8, rel=0.3)
    steady = control_charts.trend(np.random.default_rng(4).normal(1000.0, 2.0, 30), 50.0)
    assert steady is not None and not steady.significant and steady.life[2] == float("inf")
    assert control_charts.trend(torque[:4], 50.0) is None


def test_an_alarm_that_many_welds_have_is_one_line(tmp_path: Path) -> None:
    made = rows(30)
    for at in range(5, 25):
        made[at] |= {"alarm_kinds": "lag_force", "alarm_texts": f"{2600 + at} s: 1.{at} s late", "alarms": 1}
    made[7]["alarm_texts"] += "\n90 s: the torque sensor drifts"
    history.add(tmp_path, made)
    table = history.load(tmp_path)
    said = [one for one in history_report.remarks(table, {}) if "alarm" in one[1]]
    assert said == [
        ("W00005", "alarm in 20 welds, the last is W00024; here at 2605 s: 1.5 s late"),
        ("W00007", "alarm at 90 s: the torque sensor drifts"),
    ]


def test_the_report_has_what_stands_out(tmp_path: Path) -> None:
    made = rows(40)
    made[25] |= {"swaps": 1, "controllers": "decentral, nmpc", "operators": "Ada", "operator_actions": 1}
    made[30] |= {"alarm_kinds": "thermocouple", "alarm_texts": "200 s: <it> drifts", "alarms": 1, "verdict": "review"}
    history.add(tmp_path, made)
    said = history_report.write(history.load(tmp_path), tmp_path / "report.html", "History")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for weld, words in (("W00025", "1 swap"), ("W00025", "operator acted: Ada"), ("W00030", "verdict review")):
        assert any(one == weld and words in what for one, what in said)
    assert any("CUSUM chart of torque at equal conditions" in what for _, what in said)
    assert "&lt;it&gt; drifts" in text and "worn (50 N·m more) after" in text and "data:image/png;base64" in text
