"""The benchmark behind the safety case's reaction times gives the figures that are published."""

import json
import sys
from pathlib import Path

import pytest

WORKSPACE = Path(__file__).resolve().parent.parent
PUBLISHED = json.loads(
    (WORKSPACE / "docs" / "results" / "reaction_times.json").read_text(encoding="utf-8")
)


@pytest.fixture(scope="module")
def benchmark():
    sys.path.insert(0, str(WORKSPACE / "benchmarks"))
    try:
        import reaction_times
    finally:
        sys.path.pop(0)
    return reaction_times


def test_published_faults_are_those_of_the_benchmark(benchmark):
    assert [row["fault"] for row in PUBLISHED["rows"]] == [case.name for case in benchmark.FAULTS]
    assert (PUBLISHED["horizon_s"], PUBLISHED["seeds"]) == (
        benchmark.HORIZON_S,
        len(benchmark.SEEDS),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["no command arrives", "no controller is usable", "the torque shows 500 N·m too much"]
)
def test_reaction_is_the_published_one(benchmark, monkeypatch, name):
    monkeypatch.setattr(benchmark, "HORIZON_S", 15.0)
    case = next(fault for fault in benchmark.FAULTS if fault.name == name)
    (published,) = (row for row in PUBLISHED["rows"] if row["fault"] == name)
    assert benchmark.measured(case)["reaction_s"] == pytest.approx(
        published["reaction_s"], abs=0.2
    )
