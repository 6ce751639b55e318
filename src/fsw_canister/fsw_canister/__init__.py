"""Transient heat conduction in the canister's end as a plant steps it; ``fsw_heat`` makes the model."""

from fsw_canister.compact import CompactCanister
from fsw_canister.parameters import CanisterParameters
from fsw_canister.stepped import CanisterState, HeatModel

__all__ = ["CanisterParameters", "CanisterState", "CompactCanister", "HeatModel"]
