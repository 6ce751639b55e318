"""Rows of a history of welds: a tool that wears, and otherwise welds that are alike."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

NORMAL = {
    "duration_s": (600.0, 0.1),
    "temperature_error_mean_c": (0.0, 0.05),
    "temperature_error_sigma_c": (0.5, 0.03),
    "temperature_error_max_c": (2.0, 0.2),
    "depth_error_mean_mm": (0.0, 0.0005),
    "depth_error_sigma_mm": (0.004, 0.0002),
    "depth_error_max_mm": (0.02, 0.002),
    "power_kw": (50.0, 0.1),
    "gain_heat": (1.0, 0.01),
    "gain_depth": (1.0, 0.01),
    "drift_torque_nm": (2.0, 0.3),
    "drift_depth_um_per_min": (3.0, 0.5),
    "drift_heat_c": (5.0, 0.5),
}


def rows(n: int, wear_nm: float = 1.0, seed: int = 1) -> list[dict[str, Any]]:
    """Rows of ``n`` welds whose torque rises by ``wear_nm`` from one to the next, ± 1."""
    random = np.random.default_rng(seed)
    columns = {
        name: random.normal(mean, sigma, n).tolist() for name, (mean, sigma) in NORMAL.items()
    }
    columns["torque_nm"] = (1021.5 + wear_nm * np.arange(n) + random.normal(0.0, 1.0, n)).tolist()
    software = {"welded": {"numpy": "2.0"}, "judged": {"fsw-control": "1.0"}}
    settings = {
        "procedure": "lid A",
        "procedure_sha256": "a" * 64,
        "tuning": json.dumps({"decentral": {"tuning": "tight"}}),
        "software": json.dumps(software),
    }
    texts = {
        "canister": "",
        "lid": "",
        "tool": "T1",
        "machine": "M",
        "controllers": "decentral",
        "operators": "",
    }
    none = {
        "verdict": "accept",
        "alarm_kinds": "",
        "alarm_findings": [],
        "alarms": 0,
        "swaps": 0,
        "operator_actions": 0,
    }
    return [
        {
            "weld": f"W{i:05d}",
            "files_sha256": f"{i:064x}",
            **texts,
            **settings,
            **none,
            "start_ns": i,
            **{name: column[i] for name, column in columns.items()},
        }
        for i in range(n)
    ]
