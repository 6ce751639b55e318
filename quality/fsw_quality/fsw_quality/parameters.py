"""Parameters of the monitor."""

from __future__ import annotations

from typing import Annotated, Literal

from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.ranges import Range


class MonitorParameters(NodeParameters):
    """Parameters of the monitor, which watches a weld and names what is wrong and why.

    It commands nothing.
    """

    process: Annotated[Literal["paper", "canister"], AT_START] = "paper"
    """What the model knows: paper, also the power that holds a temperature; canister, where that
    depends on the canister, as on a machine, so that gain of heat and dead time are not judged."""
    model_file: Annotated[str, AT_START] = ""
    """YAML file with parameters of the process model; empty: the nominal ones."""
    covariance_file: Annotated[str, AT_START] = ""
    """YAML file with the covariance of the model's parameters, as `identify --covariance` writes
    it; empty: wide enough for a model within 10 %."""
    patience_s: Annotated[float, Range(0.01, 10.0, "s")] = 0.25
    """Time after the first sample of a tick at which it is evaluated with those that have
    arrived."""
