"""Transient heat conduction in the canister's end, reduced to a model for a plant."""

from fsw_canister.compact import CompactCanister, load_or_compact
from fsw_canister.parameters import CanisterParameters
from fsw_canister.reduced import ReducedCanister, load_or_reduce
from fsw_canister.stepped import CanisterState, HeatModel

__all__ = [
    "CanisterParameters",
    "CanisterState",
    "CompactCanister",
    "HeatModel",
    "ReducedCanister",
    "load_or_compact",
    "load_or_reduce",
]
