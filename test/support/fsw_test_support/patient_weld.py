"""A weld that neither stops nor shuts anybody out where a busy machine stands still for some time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fsw_scenario.graph import STANDBY, WeldGraph

#: of a supervisor: it holds, readmits at once who was late, and goes back to whom it was asked for
PATIENT: dict[str, Any] = {
    **dict.fromkeys(("hold_timeout_s", "operator_hold_timeout_s", "start_timeout_s"), 3600.0),
    **{"storm_swaps": 0, "readmit_ticks": 1, "return_to_target": True},
}
#: the same as ROS arguments
PATIENT_ARGUMENTS = [
    word for name, value in PATIENT.items() for word in ("-p", f"{name}:={str(value).lower()}")
]


class PatientWeld(WeldGraph):
    """A weld's graph whose supervisors are patient."""

    def parameter_file(self, scenario_file: Path) -> dict[str, Any]:
        """Content of the parameter file."""
        nodes = super().parameter_file(scenario_file)
        for name in {"fsw_supervisor", STANDBY} & nodes.keys():
            nodes[name]["ros__parameters"] |= PATIENT
        return nodes
