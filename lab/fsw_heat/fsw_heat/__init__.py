"""Heat in the canister's end by finite elements, reduced.

For a plant (``fsw_plant.canister``) and for its field.
"""

from fsw_heat.compaction import load_or_compact
from fsw_heat.reduced import ReducedCanister, load_or_reduce

__all__ = ["ReducedCanister", "load_or_compact", "load_or_reduce"]
