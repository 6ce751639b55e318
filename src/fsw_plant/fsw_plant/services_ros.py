"""Services that disturb and reset a running plant, and the requests for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from fsw_control import units
from fsw_control.coded import Fact, Worded
from fsw_control.schema.models import InputError
from fsw_model import OperatingPointError
from fsw_msgs.srv import ResetPlant, SetDisturbance, SetFault
from fsw_plant.emulator import PlantEmulator
from fsw_plant.event_schema import amplitude_unit, disturbance, fault, magnitude_unit
from fsw_plant.events import Disturbance, PlantEvent

#: service by whether the event is a disturbance (else a fault)
SERVICES: dict[bool, tuple[Any, str]] = {
    True: (SetDisturbance, "fsw/plant/set_disturbance"),
    False: (SetFault, "fsw/plant/set_fault"),
}


class Done(Worded):
    """Answers of the plant's services."""

    BEGINS = "{target}: {kind} from the next tick on"
    RESET = "at equilibrium: {depth_mm:.3f} mm, {temperature_c:.1f} degC"
    INVALID = "{error}"
    NO_EQUILIBRIUM = "{error}"


class PlantServices:
    """Disturbances, sensor faults and reset; ``on_reset`` is called after a reset."""

    def __init__(self, node: Node, plant: PlantEmulator, on_reset: Callable[[], None]) -> None:
        self._logger, self._plant, self._after_reset = node.get_logger(), plant, on_reset
        for service in SERVICES.values():
            node.create_service(*service, self._on_event)
        node.create_service(ResetPlant, "fsw/plant/reset", self._on_reset)

    def _answer(self, response: Any, what: str, act: Callable[[], Fact]) -> None:
        """Fill in a response: ``act`` returns what is done, or raises the reason of a failure."""
        try:
            fact, response.ok = act(), True
            self._logger.info(f"{what}: {fact.words}")
        except OperatingPointError as error:
            fact, response.ok = Fact.of(Done.NO_EQUILIBRIUM, error=error), False
        except InputError as error:
            fact, response.ok = Fact.of(Done.INVALID, error=error), False
        response.code, response.message = str(fact.code), fact.words

    def _on_event(self, request: Any, response: Any) -> Any:
        def act() -> Fact:
            event = event_of(request)
            self._plant.begin(event)
            return Fact.of(Done.BEGINS, target=event.target, kind=event.kind)

        self._answer(response, type(request).__name__.removesuffix("_Request"), act)
        return response

    def _on_reset(
        self, request: ResetPlant.Request, response: ResetPlant.Response
    ) -> ResetPlant.Response:
        def act() -> Fact:
            self._plant.reset(
                seed=None if request.seed < 0 else request.seed,
                depth_mm=units.mm_from_m(request.depth) if request.depth != 0.0 else None,
                temperature_c=request.temperature if request.temperature != 0.0 else None,
            )
            self._after_reset()
            truth = self._plant.truth()
            depth_mm, temperature_c = truth.depth_mm, truth.temperature_c
            return Fact.of(Done.RESET, depth_mm=depth_mm, temperature_c=temperature_c)

        self._answer(response, "reset", act)
        return response


def event_of(request: Any) -> PlantEvent:
    """The event of a request.

    Raises
    ------
    fsw_control.schema.models.InputError
        If a scenario could not contain it.
    """
    if isinstance(request, SetDisturbance.Request):
        channel, shape = request.channel, request.shape
        amplitude = units.from_si(request.amplitude, amplitude_unit(channel))
        return disturbance(channel, shape, amplitude, request.duration, request.period)
    sensor, kind = request.sensor, request.kind
    magnitude = units.from_si(request.magnitude, magnitude_unit(sensor, kind))
    return fault(sensor, kind, magnitude, request.duration)


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
