"""Transient heat conduction in the canister's end, as the plant steps it; made by ``fsw_heat``."""

from fsw_plant.canister.parameters import CanisterParameters

__all__ = ["CanisterParameters"]
