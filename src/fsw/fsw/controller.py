"""Base class for user-defined controllers."""

from __future__ import annotations

from fsw_control.contract import Command, Limits, Measurement, Proposal, Reference
from fsw_control.reason import Reason, ReasonCode


class Controller:
    """Derive your controller from this: give it a ``name`` and a :meth:`command`.

    The command is limited to bounds and rates, and a tick with an invalid required sensor is
    answered by an unhealthy proposal. A class with its own ``step`` and ``reset``
    (:class:`fsw_control.contract.Controller`) needs no base.

    Attributes
    ----------
    name : str
    tolerated_sensors : tuple of str
        Sensors (``depth``, ``torque``, ``thermocouple``) that may be invalid for a while.
    limits : Limits

    Examples
    --------
    >>> import fsw
    >>> class DepthOnly(fsw.Controller):
    ...     name = "depth_only"
    ...     tolerated_sensors = ("torque", "thermocouple")
    ...
    ...     def command(self, measurement, reference, applied):
    ...         error_mm = reference.depth_mm - measurement.depth_mm
    ...         return fsw.Command(78.4 + 50.0 * error_mm, applied.speed_rpm)
    >>> weld = fsw.simulate("quick", controller=DepthOnly())
    >>> weld.kpi["iae_depth_mm_s"] < 2.0
    True
    >>> weld.controller
    <DepthOnly depth_only>
    """

    name = "own"
    tolerated_sensors: tuple[str, ...] = ()
    limits = Limits()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    def command(self, measurement: Measurement, reference: Reference, applied: Command) -> Command:
        """Force and speed for this tick; ``applied`` was in force during the last one."""
        raise NotImplementedError(f"{type(self).__name__} needs a method 'command'")

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        """The proposal of this tick, see :class:`fsw_control.contract.Controller`."""
        invalid = [
            name for name in measurement.invalid_sensors() if name not in self.tolerated_sensors
        ]
        if invalid:
            return Proposal(
                applied, healthy=False, reason=Reason(ReasonCode.INVALID_SENSOR, tuple(invalid))
            )
        command = self.command(measurement, reference, applied)
        if not isinstance(command, Command):
            kind = type(command).__name__
            raise TypeError(f"command() returned a {kind}: return Command(force_kn, speed_rpm)")
        return Proposal(self.limits.clip(command, applied))

    def reset(self, applied: Command) -> None:
        """Forget the past; nothing to do for a controller without memory."""
