"""A made-up weld of a few seconds that keeps a procedure of its own, to be spoilt by tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.procedure import Procedure
from fsw_analysis.weld_signals import DriveSignals, WeldEvent, WeldSignals
from fsw_control.weld import DEPTH_MM, FORCE_KN, SPEED_RPM, TEMPERATURE_C
from fsw_scenario import procedure

#: ticks of the dwell and of the whole weld; the tool then travels 0.2 mm in a tick, of 0.02 deg
DWELL, TICKS = 10, 60


def short_procedure(**changes: Any) -> Procedure:
    """The shipped procedure with a dwell of 1 s and a joint line of 1 deg, and its fields changed."""
    source = "test"
    values = procedure.load("copper_lid").model_dump(mode="json", exclude_none=True)
    values["phases"] = [
        {"name": "dwell", "duration_s": 1.0, "source": source},
        {"name": "joint_line", "to_deg": 1.0, "source": source},
    ]
    values["acceptance"]["tolerated_share"] = 0.1  # of few ticks
    return Procedure.model_validate(values | changes)


def good_weld() -> WeldSignals:
    """All samples at the operating point, in 6 s of simulated time."""
    ticks = np.arange(1, TICKS + 1)
    travelled = np.maximum(ticks - DWELL, 0)

    def constant(value: float) -> Any:
        return np.full(TICKS, value)

    return WeldSignals(
        path=Path("made_up"),
        stamp_ns=ticks * 100_000_000,
        time_s=ticks.astype(np.float64) * 0.1,
        depth_mm=constant(DEPTH_MM),
        torque_nm=constant(1050.0),
        temperature_c=constant(TEMPERATURE_C),
        reference_depth_mm=constant(DEPTH_MM),
        reference_temperature_c=constant(TEMPERATURE_C),
        force_kn=constant(FORCE_KN),
        speed_rpm=constant(SPEED_RPM),
        command_source=np.full(TICKS, "decentral", object),
        command_reason=np.full(TICKS, "", object),
        command_latency_s=constant(0.01),
        actual_controller=np.full(TICKS, "decentral", object),
        actual_mode=np.full(TICKS, "auto", object),
        drives=DriveSignals(constant(FORCE_KN), constant(SPEED_RPM)),
        counts={"/fsw/supervisor/state": 6},
        phases=[("dwell", 0.1), ("joint_line", 0.1 * DWELL)],
        events=[
            WeldEvent(0.1 * DWELL, "phase", "joint_line"),
            WeldEvent(0.1 * TICKS, "weld", "done"),
        ],
        angle_deg=0.02 * travelled,
        travel_mm=0.2 * travelled,
    )
