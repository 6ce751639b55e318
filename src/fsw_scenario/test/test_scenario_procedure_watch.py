"""What follows from a procedure while a weld runs: limits of other nodes, and deviations."""

from __future__ import annotations

import shlex
from typing import Any

import pytest

from fsw_analysis.procedure import Procedure, tuning_sha256
from fsw_control.cause import Cause
from fsw_control.coded import Fact
from fsw_control.parameters import defaults
from fsw_control.schema.models import InputError
from fsw_scenario import procedure
from fsw_scenario.procedure import Deviation, ProcedureWatch, graph_parameters, node_parameters
from fsw_supervisor.parameters import SupervisorParameters
from fsw_test_support.judged_weld import short_procedure

SHIPPED = procedure.load("copper_lid")
SUPERVISOR = defaults(SupervisorParameters)


def essential(variable: str, **limits: Any) -> dict[str, Any]:
    return {"variable": variable, "source": "test", **limits}


def with_limits(*limits: dict[str, Any], **more: Any) -> Procedure:
    return short_procedure(essential=list(limits), **more)


def test_the_shipped_procedure_changes_no_default() -> None:
    """So the reference weld has its limits from one place, and nothing else is new."""
    parameters = node_parameters(SHIPPED)
    assert parameters == {
        "fsw_supervisor": {name: SUPERVISOR[name] for name in parameters["fsw_supervisor"]}
    }
    assert len(parameters["fsw_supervisor"]) == 7 * 2 + 4


def test_limits_follow_the_procedure() -> None:
    asked = with_limits(
        essential("temperature_c", min=795.0, max=905.0), essential("torque_nm", max=1500.0)
    )
    parameters = node_parameters(asked)
    supervisor = parameters["fsw_supervisor"]
    assert (
        supervisor["interlocks.temperature_low.trip"] == 795.0
        and supervisor["interlocks.torque_high.trip"] == 1500.0
    )
    assert supervisor["interlocks.torque_high.warn"] == 1300.0  # 200 below the trip, as by default
    assert supervisor["interlocks.temperature_high.warn"] == SHIPPED.set_points.temperature_c.max
    assert not any("depth" in name for name in supervisor)


@pytest.mark.parametrize("hooked", [True, False])
def test_a_weld_by_a_procedure_has_its_limits_and_runs_the_hooks(
    monkeypatch: pytest.MonkeyPatch, hooked: bool
) -> None:
    hooks = {"judge": lambda bag, file: ["judge", bag, "a file", file]} if hooked else {}
    monkeypatch.setattr(procedure, "all_loaded", {"fsw.record_hooks": hooks}.__getitem__)
    parameters = graph_parameters("copper_lid")
    assert parameters["fsw_supervisor"]["interlocks.depth_high.trip"] == 3.7
    assert parameters["fsw_recorder"]["attach"] == [parameters["fsw_procedure"]["procedure"]]
    assert parameters["fsw_hmi"] == parameters["fsw_procedure"], (
        "it has its limits from the file itself"
    )
    file = parameters["fsw_procedure"]["procedure"]
    commands = parameters["fsw_recorder"].get(
        "on_finished", []
    )  # an empty list would have no type in ROS
    assert [shlex.split(command) for command in commands] == (
        [["judge", "{bag}", "a file", file]] if hooked else []
    )
    assert ("on_finished" in parameters["fsw_recorder"]) is hooked


def test_commands_are_narrowed_never_widened() -> None:
    asked = with_limits(
        essential("force_kn", min=70.0, max=150.0), essential("speed_rpm", min=100.0, max=450.0)
    )
    parameters = node_parameters(asked)["fsw_supervisor"]
    default = SUPERVISOR
    assert (
        parameters["limits.force_min_kn"] == 70.0
        and parameters["limits.force_max_kn"] == default["limits.force_max_kn"]
    )
    assert (
        parameters["limits.speed_min_rpm"] == default["limits.speed_min_rpm"]
        and parameters["limits.speed_max_rpm"] == 450.0
    )


@pytest.mark.parametrize(
    ("variable", "limits"), [("force_kn", {"max": 20.0}), ("speed_rpm", {"min": 600.0})]
)
def test_limits_outside_of_the_drives_are_refused(variable: str, limits: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{variable} leave nothing"):
        node_parameters(with_limits(essential(variable, **limits)))


def test_limit_of_some_phases_sets_no_parameter() -> None:
    asked = with_limits(essential("torque_nm", max=1500.0, phases=["joint_line"]))
    assert node_parameters(asked)["fsw_supervisor"] == {}


def figures(fact: Fact) -> list[float]:
    """Value and limits of a set-point."""
    return [fact.data[key] for key in ("value", "low", "high")]


@pytest.fixture
def watch() -> ProcedureWatch:
    procedure_watch = ProcedureWatch(short_procedure())
    procedure_watch.set_points(2.66, 816.4)
    procedure_watch.state("decentral", "hold", Cause.READY)
    procedure_watch.state("decentral", "auto", Cause.READY)
    assert procedure_watch.deviations == {}
    return procedure_watch


def test_set_points_outside_deviate_until_they_return(watch: ProcedureWatch) -> None:
    watch.set_points(3.45, 905.0)
    assert set(watch.deviations) == {"set_point_depth_mm", "set_point_temperature_c"}
    assert figures(watch.deviations["set_point_depth_mm"]) == [3.45, 1.7, 3.4]
    assert figures(watch.deviations["set_point_temperature_c"]) == [905.0, 800.0, 900.0]
    watch.set_points(3.4, 800.0)
    assert watch.deviations == {}


def test_all_deviations_are_one_fact_with_the_name_of_each(watch: ProcedureWatch) -> None:
    assert watch.fact.code is Deviation.KEEPS
    watch.state("decentral", "manual", Cause.OPERATOR_MANUAL)
    watch.set_points(2.66, 905.0)
    temperature = watch.fact
    assert temperature.code is Deviation.LEAVES
    assert temperature.data["names"] == ("mode", "set_point_temperature_c")
    assert temperature.words == "; ".join(
        deviation.words for deviation in watch.deviations.values()
    )
    watch.set_points(3.45, 850.0)
    assert watch.fact.data["names"] == ("mode", "set_point_depth_mm")


def test_foreign_controller_and_other_mode_deviate(watch: ProcedureWatch) -> None:
    watch.state("mine", "auto", Cause.SWAP_REQUESTED)
    assert list(watch.deviations) == ["controller"]
    foreign = {"controller": "mine", "permitted": ("decentral", "nmpc")}
    assert watch.deviations["controller"].data == foreign
    watch.state("decentral", "hold", Cause.INTERLOCK_TRIP)
    assert list(watch.deviations) == ["mode"]
    assert watch.deviations["mode"].data == {"mode": "hold", "cause": Cause.INTERLOCK_TRIP}
    watch.state("decentral", "auto", Cause.SWAP_REQUESTED)
    assert watch.deviations == {}


@pytest.mark.parametrize(
    ("allowed", "cause", "is_deviation"),
    [
        (True, Cause.SWAP_REQUESTED, False),
        (True, Cause.SWAP_FAILED, True),
        (True, Cause.UNKNOWN, True),
        (False, Cause.SWAP_REQUESTED, True),
    ],
)
def test_unpermitted_swap_deviates_until_the_end(
    allowed: bool, cause: Cause, is_deviation: bool
) -> None:
    acceptance = {"tolerated_s": 0.3, "swaps_allowed": allowed, "source": "test"}
    watch = ProcedureWatch(short_procedure(acceptance=acceptance))
    watch.state("decentral", "auto", Cause.READY)
    watch.state("nmpc", "auto", cause)
    assert ("swap" in watch.deviations) is is_deviation
    watch.state("decentral", "auto", Cause.SWAP_REQUESTED)
    assert ("swap" in watch.deviations) is is_deviation  # not undone


def test_other_tuning_deviates() -> None:
    good = {"gain": 2.0, "use_sim_time": False}
    controllers = [
        {"name": "decentral", "parameters_sha256": tuning_sha256(good)},
        {"name": "nmpc"},
    ]
    watch = ProcedureWatch(short_procedure(controllers=controllers))
    watch.tuning("decentral", good | {"use_sim_time": True})
    watch.tuning("nmpc", {"anything": 1})
    assert watch.deviations == {}
    watch.tuning("decentral", good | {"gain": 2.1})
    assert list(watch.deviations) == ["tuning_decentral"]
    watch.tuning("decentral", good)
    assert watch.deviations == {}
