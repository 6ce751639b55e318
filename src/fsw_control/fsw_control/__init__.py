"""Contract between plant, controllers and supervisor, and the node that hosts any controller."""

from fsw_control.contract import (
    SENSORS,
    Command,
    Controller,
    Diagnosis,
    Limits,
    Measurement,
    Plan,
    Proposal,
    Reference,
)

__all__ = ["SENSORS", "Command", "Controller", "Diagnosis", "Limits", "Measurement", "Plan", "Proposal", "Reference"]
