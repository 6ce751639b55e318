"""Transient heat conduction in the canister's end, reduced to a model for a plant."""

from fsw_canister.parameters import CanisterParameters
from fsw_canister.reduced import CanisterState, ReducedCanister, load_or_reduce

__all__ = ["CanisterParameters", "CanisterState", "ReducedCanister", "load_or_reduce"]
