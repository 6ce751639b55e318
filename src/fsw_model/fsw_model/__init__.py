"""Process model of friction stir welding of copper canisters."""

from fsw_model.parameters import ModelParameters, ParameterError, nominal
from fsw_model.process import (
    STEP_S,
    Equilibrium,
    Linearisation,
    OperatingPointError,
    Outputs,
    ProcessModel,
    ProcessState,
    delay_steps,
)

__all__ = [
    "STEP_S",
    "Equilibrium",
    "Linearisation",
    "ModelParameters",
    "OperatingPointError",
    "Outputs",
    "ParameterError",
    "ProcessModel",
    "ProcessState",
    "delay_steps",
    "nominal",
]
