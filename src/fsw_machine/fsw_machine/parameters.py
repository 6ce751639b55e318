"""Parameters of the gateway to a machine.

Chosen means: not in the paper, chosen for this project.
"""

from __future__ import annotations

from typing import Annotated, Literal

from fsw_control.common_parameters import Commands, DriveLimits
from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import Model
from fsw_control.schema.ranges import Range


class Clock(Model):
    """Parameters ``clock.*``."""

    stamps: Annotated[Literal["source", "received"], AT_START] = "source"
    """Stamps of the measurements: source timestamps of the server, or these shifted so that the
    first is the time at which it was received."""
    warn_s: Annotated[float, Range(0.01, 86400.0, "s")] = 0.5
    """Difference between the server's clock and the local one that causes a warning (chosen)."""
    error_s: Annotated[float, Range(0.01, 86400.0, "s")] = 60.0
    """Difference between the server's clock and the local one that causes an error; with stamps
    'received' a warning (chosen)."""


class Reconnect(Model):
    """Parameters ``reconnect.*``."""

    first_s: Annotated[float, Range(0.05, 60.0, "s")] = 0.5
    """Time before the first attempt to reconnect; doubled after each failure (chosen)."""
    max_s: Annotated[float, Range(0.05, 600.0, "s")] = 10.0
    """Maximum time between two attempts to connect (chosen)."""


class GatewayParameters(NodeParameters):
    """Parameters of the gateway to a machine."""

    autostart: Annotated[bool, AT_START] = True
    """Configure and activate on start-up; if false, wait for lifecycle transitions."""
    machine_file: Annotated[str, AT_START] = ""
    """Machine file: endpoint, security, and node and unit of each quantity; empty: that of
    scripts/run_machine_server.py."""
    limits: DriveLimits = DriveLimits()
    commands: Commands = Commands()
    clock: Clock = Clock()
    request_timeout_s: Annotated[float, Range(0.05, 10.0, "s")] = 0.4
    """Time without an answer from the server after which the connection counts as lost
    (chosen)."""
    cycle_timeout_s: Annotated[float, Range(0.2, 60.0, "s")] = 0.5
    """Time without a change of the cycle counter after which the machine counts as stalled
    (chosen)."""
    reconnect: Reconnect = Reconnect()
    discovery_s: Annotated[float, Range(0.0, 10.0, "s"), AT_START] = 0.5
    """Time for which the gateway looks for a plant or another gateway in the same domain before it
    starts."""
