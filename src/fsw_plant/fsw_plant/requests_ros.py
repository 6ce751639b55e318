"""Service requests for disturbances and faults of the emulated plant."""

from __future__ import annotations

from typing import Any

from fsw_control import units
from fsw_msgs.srv import SetDisturbance, SetFault
from fsw_plant.event_schema import amplitude_unit, magnitude_unit
from fsw_plant.events import Disturbance, PlantEvent

#: service by whether the event is a disturbance (else a fault)
SERVICES: dict[bool, tuple[Any, str]] = {
    True: (SetDisturbance, "fsw/plant/set_disturbance"),
    False: (SetFault, "fsw/plant/set_fault"),
}


def event_request(event: PlantEvent) -> Any:
    """The request for an event that starts with the next tick."""
    amount, kind = event.amount, event.kind
    if isinstance(event, Disturbance):
        return SetDisturbance.Request(
            channel=event.target,
            shape=kind,
            amplitude=units.to_si(amount, amplitude_unit(event.target)),
            duration=event.duration_s,
            period=event.period_s,
        )
    magnitude = units.to_si(amount, magnitude_unit(event.target, kind))
    return SetFault.Request(
        sensor=event.target, kind=kind, magnitude=magnitude, duration=event.duration_s
    )
