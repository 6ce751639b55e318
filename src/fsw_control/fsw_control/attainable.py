"""Set-points out of reach: what is asked, what is attainable, which bound stands in the way."""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.contract import Reference

#: what is nearer to the set-points is the noise of the estimates that decide it (chosen)
_NEAR_MM, _NEAR_C = 0.005, 0.5


def attainable_of(quantities: Mapping[str, float]) -> Reference | None:
    """The attainable set-points among what a controller reports; None where it reports none."""
    found = [quantities.get(name) for name in ("attainable_depth_mm", "attainable_temperature_c")]
    return None if found[0] is None or found[1] is None else Reference(found[0], found[1])


def out_of_reach(asked: Reference, attainable: Reference, share: float = 1.0) -> str:
    """Why set-points are replaced by the attainable ones, in words; empty where they are not.

    Parameters
    ----------
    asked, attainable : Reference
        The set-points in force, and those that a controller goes for.
    share : float, optional
        Of the difference that is told; below 1 for one that has been told already.
    """
    depth_mm, temperature_c = (
        attainable.depth_mm - asked.depth_mm,
        attainable.temperature_c - asked.temperature_c,
    )
    texts = []
    if abs(temperature_c) > share * _NEAR_C:
        texts.append(
            f"{asked.temperature_c:.0f} degC asked, {attainable.temperature_c:.0f} degC attainable"
        )
    if abs(depth_mm) > share * _NEAR_MM:
        texts.append(f"{asked.depth_mm:.2f} mm asked, {attainable.depth_mm:.2f} mm attainable")
    if not texts:
        return ""
    return f"{'; '.join(texts)}: speed at its {'upper' if wants_heat(asked, attainable) else 'lower'} bound"


def wants_heat(asked: Reference, attainable: Reference) -> bool:
    """Whether the set-points need more heat than the fastest spindle gives, not less than the slowest."""
    return attainable.temperature_c < asked.temperature_c or attainable.depth_mm > asked.depth_mm
