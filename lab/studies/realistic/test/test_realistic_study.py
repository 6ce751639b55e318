"""Statistics of groups, the scenario beside its fit, and the page beside its numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from realistic import fit, report, welds
from realistic.earlier import ByHand, OftenByHand, SingleLoop

from fsw_control import Command, Measurement, Reference

RESULTS = Path(__file__).resolve().parents[4] / "docs" / "results"


@pytest.fixture(scope="module")
def numbers() -> dict:
    return json.loads((RESULTS / "realistic_tables.json").read_text(encoding="utf-8"))


def test_group_has_the_statistics_of_its_welds_joined() -> None:
    errors = np.random.default_rng(1).normal(0.5, 2.0, (8, 500))
    figures = np.stack(
        [errors.mean(1), np.square(errors).mean(1), errors.min(1), errors.max(1)], 1
    )
    expected = [errors.mean(), errors.std(), errors.min(), errors.max()]
    assert welds.pooled(figures) == pytest.approx(expected)


def test_scenario_has_the_fitted_values(numbers: dict) -> None:
    shipped = welds.shipped_values()
    assert numbers["values"] == pytest.approx(shipped)
    assert numbers["fit"]["converged"]
    for name, value in numbers["fit"]["values"].items():
        assert shipped[name] == pytest.approx(value, rel=0.02)
    for path in (welds.FALL, welds.HEAT):
        assert welds.at(welds.campaign().scenario, path) == welds.law_of(path).mean


def emulated_trace(task: welds.Task, power: float = 1.1) -> welds.Figures:
    """An error that falls and heat change as in a weld, but not quite linearly."""
    factors, drawn = dict(task.changes), welds.campaign().parameters(task.index)
    fall, heat = (drawn[path] / welds.law_of(path).mean for path in (welds.FALL, welds.HEAT))
    size = factors[welds.HEAT] * heat
    noise = np.random.default_rng(task.index).laplace(0.0, 0.9, 3000)
    return 0.5 * (factors[welds.FALL] * fall) ** power + size**power * (noise - noise.mean())


def test_fit_converges_to_the_published_statistics() -> None:
    fitted = fit.fit(lambda tasks: [emulated_trace(task) for task in tasks])
    wanted, (*_, last) = fitted["wanted"], fitted["rounds"]
    assert fitted["converged"] and len(fitted["rounds"]) > 1
    assert last["at_start"] == pytest.approx(last["expected"], abs=0.2)  # linear there
    assert last["expected"][:2] == pytest.approx(wanted[:2], abs=0.05)
    deviations = np.subtract(last["expected"], wanted) / last["scale"]
    assert np.abs(deviations).max() < 1.0


def test_welds_of_the_result_are_not_those_of_the_fit() -> None:
    tasks = report.tasks()
    assert len({task.key for task in tasks}) == len(tasks)
    assert not {task.index for task in tasks} & set(fit.WELDS)
    assert sum(task.controller == "decentral" and not task.changes for task in tasks) == 200


def test_page_follows_from_its_numbers(numbers: dict) -> None:
    assert report.page(numbers) == (RESULTS / "realistic.md").read_text(encoding="utf-8")


def test_tasks_change_only_what_they_name() -> None:
    plain = welds.scenario_of(welds.Task("decentral", 3))
    varied = welds.scenario_of(
        welds.Task("decentral", 3, ((welds.HEAT_SCATTER, 0.0), (welds.HEAT, 0.5)))
    )
    pairs = zip(plain.events, varied.events, strict=True)
    ((before, after),) = [pair for pair in pairs if pair[0] != pair[1]]
    assert before.disturbance and after.disturbance and before.disturbance.shape == "random"
    assert after.disturbance.amplitude_c == 0.5 * welds.law_of(welds.HEAT).mean
    assert plain.phases[-1].name == welds.PHASE


def measurement(time_s: float, depth_mm: float, temperature_c: float) -> Measurement:
    return Measurement(time_s, depth_mm, 1050.0, temperature_c)


@pytest.mark.parametrize(
    "kind, looks", [(ByHand, {0, 600}), (OftenByHand, {0, 200, 400, 600, 800})]
)
def test_operator_corrects_large_errors_when_looking(kind: type, looks: set[int]) -> None:
    controller, start = kind(), Command(78.0, 400.0)
    controller.reset(start)
    wanted, applied, speeds, forces = Reference(2.66, 816.4), start, [], []
    for tick in range(900):
        proposal = controller.step(measurement(tick / 10, 2.65, 786.4), wanted, applied, 0.1)
        applied = proposal.command
        speeds.append(applied.speed_rpm)
        forces.append(applied.force_kn)
    moving = np.diff([start.speed_rpm, *speeds]) > 0.1
    begins = np.flatnonzero(moving & ~np.append(False, moving[:-1]))
    assert set(begins.tolist()) == looks
    assert np.ptp(forces) == 0.0  # 0.01 mm is too little for a hand


def test_single_loop_raises_the_speed_until_the_error_is_gone() -> None:
    controller, applied = SingleLoop(), Command(78.0, 400.0)
    controller.reset(applied)
    wanted, speeds = Reference(2.66, 816.4), []
    for tick in range(1, 100):
        error_c = 10.0 if tick < 50 else 0.0
        sample = measurement(tick / 10, 2.66, 816.4 - error_c)
        applied = controller.step(sample, wanted, applied, 0.1).command
        speeds.append(applied.speed_rpm)
    assert 400.0 < speeds[10] < speeds[48] and speeds[60] == pytest.approx(speeds[-1])
