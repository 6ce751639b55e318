"""Transient heat conduction in the canister's end, as the plant steps it; made by ``fsw_heat``."""

from fsw_plant.canister.compact import CompactCanister
from fsw_plant.canister.parameters import CanisterParameters
from fsw_plant.canister.stepped import CanisterState, HeatModel

__all__ = ["CanisterParameters", "CanisterState", "CompactCanister", "HeatModel"]
