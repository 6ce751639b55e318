"""The structs of the C library for ctypes, read from ``kernel/fsw_controller.h`` itself."""

from __future__ import annotations

import ctypes

from fsw_control.c_structs import Header
from fsw_nmpc.kernel_build import FOLDER

HEADER = Header(FOLDER / "fsw_controller.h")


@HEADER.struct("fsw_model")
class Model(ctypes.Structure):
    """The process model as constant tables."""


@HEADER.struct("fsw_tuning")
class TuningStruct(ctypes.Structure):
    """Trajectories, cost, limits and estimator."""


@HEADER.struct("fsw_change")
class Change(ctypes.Structure):
    """A future set-point."""


@HEADER.struct("fsw_input")
class Input(ctypes.Structure):
    """What a tick is given."""


@HEADER.struct("fsw_output")
class Output(ctypes.Structure):
    """What a tick gives back."""


@HEADER.struct("fsw_start")
class Start(ctypes.Structure):
    """What a prediction starts from."""


@HEADER.struct("fsw_problem")
class ProblemStruct(ctypes.Structure):
    """The problem of one tick."""


@HEADER.struct("fsw_estimator")
class EstimatorStruct(ctypes.Structure):
    """Memory of the estimator."""


@HEADER.struct("fsw_plan")
class PlanStruct(ctypes.Structure):
    """The last plan."""


@HEADER.struct("fsw_controller")
class ControllerHead(ctypes.Structure):
    """Memory of the controller, without the solver's workspace."""


MAX_CHANGES, N_STATES = HEADER.size("FSW_MAX_CHANGES"), HEADER.size("FSW_STATES")
RETURN_SHARE = float(HEADER.defined["FSW_RETURN_SHARE"])
