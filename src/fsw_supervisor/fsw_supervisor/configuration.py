"""From the parameters of ``supervisor.yaml`` to the arbiter's parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from fsw_control.contract import Limits
from fsw_control.validity import sensor_limits
from fsw_supervisor.interlocks import DEFAULT_INTERLOCKS, Interlock
from fsw_supervisor.settings import ArbiterSettings


def settings(values: Mapping[str, Any]) -> ArbiterSettings:
    """Settings of the arbiter.

    Raises
    ------
    ValueError
        When the parameters contradict each other; the message says which.
    """
    limits = Limits(**{item.name: values[f"limits.{item.name}"] for item in fields(Limits)})
    own = {item.name: values[item.name] for item in fields(ArbiterSettings) if item.name in values}
    return ArbiterSettings(**(own | {"limits": limits, "fallbacks": tuple(values["fallbacks"])}))


def interlocks(values: Mapping[str, Any]) -> tuple[Interlock, ...]:
    """Table of the interlocks; errors as :func:`settings`."""
    return tuple(
        Interlock(
            item.name,
            item.quantity,
            values[f"interlocks.{item.name}.warn"],
            values[f"interlocks.{item.name}.trip"],
            values[f"interlocks.{item.name}.hysteresis"],
        )
        for item in DEFAULT_INTERLOCKS
    )


def problem(values: Mapping[str, Any]) -> str | None:
    """Why the parameters do not go together, or None."""
    try:
        settings(values)
        interlocks(values)
        sensor_limits(values)
    except ValueError as error:
        return str(error)
    return None
