"""ctypes binding of the controller library (``kernel/fsw_decentral.h``)."""

from __future__ import annotations

import ctypes
from ctypes import c_double
from enum import IntEnum
from functools import cache

from fsw_control.c_structs import Header
from fsw_decentral.kernel_build import LIBRARY

HEADER = Header(LIBRARY.folder / "fsw_decentral.h")


@HEADER.struct("fsw_decentral_tuning")
class TuningStruct(ctypes.Structure):
    """Gains, limits and what is known of the spindle."""


@HEADER.struct("fsw_decentral_input")
class Input(ctypes.Structure):
    """What a tick is given."""


@HEADER.struct("fsw_decentral_output")
class Output(ctypes.Structure):
    """What a tick gives back."""


@HEADER.struct("fsw_decentral_loop")
class LoopStruct(ctypes.Structure):
    """Memory of the depth loop or of the temperature loop."""


@HEADER.struct("fsw_decentral_power")
class PowerStruct(ctypes.Structure):
    """Memory of the power loop."""


@HEADER.struct("fsw_decentral")
class ControllerStruct(ctypes.Structure):
    """Memory of the controller."""


class Reason(IntEnum):
    """Why a proposal is not healthy."""

    PROPOSING = 0
    NO_DEPTH = 1
    NO_TORQUE = 2
    NO_TEMPERATURE = 3
    OVERFLOW = 4
    OUT_OF_BOUNDS = 5


#: limits that a proposal touches, in the order of their bits
LIMITS = ("force_min", "force_max", "speed_min", "speed_max", "force_rate", "speed_rate")
_UNUSABLE = "limits, friction, spindle_inertia, nominal_torque and blind_limit must be finite and in their ranges"


@cache
def load() -> ctypes.CDLL:
    """The library, built now if need be.

    Raises
    ------
    RuntimeError
        If there is none and none can be built.
    OSError
        If it cannot be loaded.
    """
    return ctypes.CDLL(str(LIBRARY.ensure()))


class Library:
    """One controller in the loaded library.

    Parameters
    ----------
    tuning : TuningStruct

    Attributes
    ----------
    input, output : Input, Output
        Arguments of :meth:`step`.
    state : ControllerStruct
        The controller's memory.

    Raises
    ------
    RuntimeError, OSError
        As :func:`load`.
    ValueError
        If the tuning is not usable.
    """

    def __init__(self, tuning: TuningStruct) -> None:
        lib = load()
        self.input, self.output = Input(), Output()
        self.state = ControllerStruct()
        self._controller = ctypes.byref(self.state)
        self._arguments = self._controller, ctypes.byref(self.input), ctypes.byref(self.output)
        self._lib, self._step = lib, lib.fsw_decentral_step
        if lib.fsw_decentral_init(self._controller, ctypes.byref(tuning)):
            raise ValueError(_UNUSABLE)

    def configure(self, tuning: TuningStruct) -> None:
        """Take another tuning; the proposals do not jump.

        Raises
        ------
        ValueError
            If the tuning is not usable; the controller goes on with the one before.
        """
        if self._lib.fsw_decentral_configure(self._controller, ctypes.byref(tuning)):
            raise ValueError(_UNUSABLE)

    def reset(self, force_kn: float, speed_rpm: float) -> None:
        """Forget the past."""
        self._lib.fsw_decentral_reset(self._controller, c_double(force_kn), c_double(speed_rpm))

    def step(self) -> None:
        """One tick: ``input`` to ``output``."""
        self._step(*self._arguments)


def check(tuning: TuningStruct) -> None:
    """Raise ValueError if the library does not take a tuning."""
    if not load().fsw_decentral_is_usable(ctypes.byref(tuning)):
        raise ValueError(_UNUSABLE)
