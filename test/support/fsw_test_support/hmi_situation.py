"""What the page's server knows at a moment, as it gets it from a graph.

By default of a good weld.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fsw_analysis.rule_book import RuleBook, default
from fsw_control.cause import Cause
from fsw_control.stop import StopCause
from fsw_hmi.alarm_rules import Part, Situation
from fsw_hmi.limits import limits, outside_now
from fsw_scenario.procedure import ProcedureWatch
from fsw_test_support.judged_weld import short_procedure

GOOD = {
    "depth_mm": 2.66,
    "reference_depth_mm": 2.66,
    "temperature_c": 850.0,
    "reference_temperature_c": 850.0,
}
GOOD |= {
    "force_kn": 80.0,
    "command_force_kn": 80.0,
    "speed_rpm": 400.0,
    "command_speed_rpm": 400.0,
}


def controller(
    name: str = "nmpc",
    ready: bool = True,
    inhibited: bool = False,
    why: str = "",
    missing_sensors: Sequence[str] = (),
) -> dict[str, Any]:
    """A controller, as the supervisor reports it."""
    return {
        "name": name,
        "ready": ready,
        "inhibited": inhibited,
        "why": why,
        "lack": 0,
        "missing_sensors": missing_sensors,
    }


def lock(name: str, level: str) -> dict[str, str]:
    """An interlock."""
    return {"name": name, "level": level}


def state(**changed: Any) -> dict[str, Any]:
    """What the supervisor reports."""
    usual: dict[str, Any] = {
        "target_controller": "nmpc",
        "actual_controller": "nmpc",
        "target_mode": "auto",
        "actual_mode": "auto",
    }
    usual |= {
        "reason": "so",
        "cause": Cause.SWAP_REQUESTED,
        "stop_cause": StopCause.NONE,
        "interlocks": [],
        "tripped": [],
        "acknowledgement_blocked_by": [],
        "known": True,
        "by": "Anna (1)",
        "acknowledged": False,
    }
    usual |= {"controllers": [controller()]}
    return usual | changed


def situation(
    values: Mapping[str, float] | None = None,
    phase: str = "",
    book: RuleBook | None = None,
    interlocks: Mapping[str, float] | None = None,
    **changed: Any,
) -> Situation:
    """What the rules look at.

    Values are judged by ``book``, else by the default rules, and by interlocks.
    """
    usual: dict[str, Any] = {
        "state": state(),
        "state_age_s": 0.1,
        "tick_age_s": 0.05,
        "command_age_s": 0.05,
    }
    usual |= {"sample_age_s": {"depth": 0.0, "torque": 0.0, "thermocouple": 0.0}}
    now, book = changed.setdefault("values", GOOD | dict(values or {})), book or default()
    own = limits(interlocks or {}, book)
    changed["outside"] = outside_now(now, {"phase": phase}, book, own)
    return Situation(**usual | changed)


def gateway(
    connection: str = "ok", machine: str = "ok", permissive: bool = True, writes: str = "ok"
) -> dict[str, dict[str, Part]]:
    """Reports of a gateway."""
    gate = {
        "connection": Part(connection, "link lost"),
        "machine": Part(machine, "counter stands", permissive),
    }
    return {"fsw_machine": gate | {"writes": Part(writes, "3 not taken")}}


def procedure_left(depth_mm: float = 2.66, temperature_c: float = 850.0) -> dict[str, Any]:
    """Report of the node that watches the procedure, with these set-points in force."""
    watch = ProcedureWatch(short_procedure())
    watch.set_points(depth_mm, temperature_c)
    fact = watch.fact
    part = Part("error", fact.words, code=fact.code, names=", ".join(fact.data["names"]))
    return {"fsw_procedure": {"deviations": part}}
