"""Plant emulator: the weld as controllers and operators see it."""

from fsw_plant.config import PlantConfig
from fsw_plant.emulator import FIRST_TICK, BeyondDrivesError, PlantEmulator, Reading, Truth
from fsw_plant.events import PlantEvent
from fsw_plant.process import prepare
from fsw_plant.schedule import PlantSchedule

__all__ = [
    "FIRST_TICK",
    "BeyondDrivesError",
    "PlantConfig",
    "PlantEmulator",
    "PlantEvent",
    "PlantSchedule",
    "Reading",
    "Truth",
    "prepare",
]
