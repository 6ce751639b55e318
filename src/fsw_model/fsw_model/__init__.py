"""Process model of friction stir welding of copper canisters, the paper's (5)-(27)."""

from fsw_model.equations import STEP_S
from fsw_model.parameters import MachineData, ModelParameters, ParameterCovariance, nominal
from fsw_model.process import (
    Equilibrium,
    Linearisation,
    OperatingPointError,
    Outputs,
    OutsideModelError,
    ProcessModel,
    ProcessState,
)

__all__ = [
    "STEP_S",
    "Equilibrium",
    "Linearisation",
    "MachineData",
    "ModelParameters",
    "OperatingPointError",
    "Outputs",
    "OutsideModelError",
    "ParameterCovariance",
    "ProcessModel",
    "ProcessState",
    "nominal",
]
