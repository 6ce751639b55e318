"""Set-points out of reach: the request, the attainable values, and the bound that limits them."""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.contract import Reference

#: differences below these values are within the noise of the estimates (chosen)
_NEAR_MM, _NEAR_C = 0.005, 0.5


def attainable_of(quantities: Mapping[str, float]) -> Reference | None:
    """Attainable set-points among a controller's quantities; None if it reports none."""
    found = [quantities.get(name) for name in ("attainable_depth_mm", "attainable_temperature_c")]
    return None if found[0] is None or found[1] is None else Reference(found[0], found[1])


def out_of_reach(asked: Reference, attainable: Reference, share: float = 1.0) -> str:
    """Describe how attainable set-points differ from the requested ones; empty if they do not.

    Parameters
    ----------
    asked, attainable : Reference
        The set-points in force, and those that the controller tracks instead.
    share : float, optional
        Scale of the reporting threshold; below 1 (hysteresis) if a difference is already reported.
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
    bound = "upper" if wants_heat(asked, attainable) else "lower"
    return f"{'; '.join(texts)}: speed at its {bound} bound"


def wants_heat(asked: Reference, attainable: Reference) -> bool:
    """Whether the set-points need more heat than the highest spindle speed can give."""
    return attainable.temperature_c < asked.temperature_c or attainable.depth_mm > asked.depth_mm
