"""Services that disturb and reset a running plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from fsw_control import units
from fsw_control.schema.models import InputError
from fsw_model import OperatingPointError
from fsw_msgs.srv import ResetPlant, SetDisturbance, SetFault
from fsw_plant.emulator import PlantEmulator
from fsw_plant.event_schema import amplitude_unit, disturbance, fault, magnitude_unit


class PlantServices:
    """Disturbances, sensor faults and reset; ``on_reset`` is called after a reset."""

    def __init__(self, node: Node, plant: PlantEmulator, on_reset: Callable[[], None]) -> None:
        self._logger, self._plant, self._after_reset = node.get_logger(), plant, on_reset
        node.create_service(SetDisturbance, "fsw/plant/set_disturbance", self._on_set_disturbance)
        node.create_service(SetFault, "fsw/plant/set_fault", self._on_set_fault)
        node.create_service(ResetPlant, "fsw/plant/reset", self._on_reset)

    def _answer(self, response: Any, what: str, act: Callable[[], str]) -> None:
        """Fill in a response: ``act`` returns a description, or raises the reason of a failure."""
        try:
            response.message, response.ok = act(), True
            self._logger.info(f"{what}: {response.message}")
        except (InputError, OperatingPointError) as error:
            response.message, response.ok = f"{error}", False

    def _on_set_disturbance(
        self, request: SetDisturbance.Request, response: SetDisturbance.Response
    ) -> SetDisturbance.Response:
        def act() -> str:
            amplitude = units.from_si(request.amplitude, amplitude_unit(request.channel))
            wanted = disturbance(
                request.channel, request.shape, amplitude, request.duration, request.period
            )
            self._plant.begin(wanted)
            return f"{request.channel}: {request.shape} from the next tick on"

        self._answer(response, f"disturbance, amplitude {request.amplitude:g}", act)
        return response

    def _on_set_fault(
        self, request: SetFault.Request, response: SetFault.Response
    ) -> SetFault.Response:
        def act() -> str:
            magnitude = units.from_si(
                request.magnitude, magnitude_unit(request.sensor, request.kind)
            )
            self._plant.begin(fault(request.sensor, request.kind, magnitude, request.duration))
            return f"{request.sensor}: {request.kind} from the next tick on"

        self._answer(response, f"fault, magnitude {request.magnitude:g}", act)
        return response

    def _on_reset(
        self, request: ResetPlant.Request, response: ResetPlant.Response
    ) -> ResetPlant.Response:
        def act() -> str:
            self._plant.reset(
                seed=None if request.seed < 0 else request.seed,
                depth_mm=units.mm_from_m(request.depth) if request.depth != 0.0 else None,
                temperature_c=request.temperature if request.temperature != 0.0 else None,
            )
            self._after_reset()
            truth = self._plant.truth()
            return f"at equilibrium: {truth.depth_mm:.3f} mm, {truth.temperature_c:.1f} degC"

        self._answer(response, "reset", act)
        return response
