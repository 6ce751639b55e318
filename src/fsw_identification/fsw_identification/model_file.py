"""The model file of an estimate: what differs from the nominal model, with standard deviations as comments."""

from __future__ import annotations

from fsw_identification.estimation import Fit
from fsw_model import ModelParameters

#: a mean disturbance that is larger than this many standard deviations goes into the point of linearisation
_SIGNIFICANT = 3.0
_DIGITS = 6


def operating_point(fit: Fit) -> dict[str, tuple[float, float]]:
    """Force and power at which the process rests, with standard deviations, where they are not the nominal ones."""
    moved = {}
    for which, name in enumerate(("operating_force_kn", "operating_power_kw")):
        offset, std = float(fit.offset[which]), float(fit.offset_std[which])
        if abs(offset) > _SIGNIFICANT * std:
            moved[name] = (getattr(fit.parameters, name) - offset, std)
    return moved


def text(fit: Fit, sources: str, air: dict[str, float] | None = None) -> str:
    """YAML that :meth:`fsw_model.ModelParameters.from_yaml` reads.

    Parameters
    ----------
    fit : Fit
    sources : str
        Where the data are from.
    air : dict of str to float, optional
        Standard deviations of the friction's coefficients, if they were estimated.
    """
    nominal = ModelParameters()
    lines = [f"# Model parameters identified from {sources}; standard deviations behind +-."]
    known = {name: (getattr(fit.parameters, name), std) for name, std in fit.std.items()} | operating_point(fit)
    known |= {name: (getattr(fit.parameters, name), std) for name, std in (air or {}).items()}
    for name, (value, std) in known.items():
        # YAML 1.1 takes 1.5e+06 for a number only with a point
        lines.append(f"{name}: {float(f'{value:.{_DIGITS}g}')!r}  # +- {std:.2g}; nominal {getattr(nominal, name):g}")
    given = [name for name in dict(nominal) if name not in known]
    for name in given:
        if (value := getattr(fit.parameters, name)) != getattr(nominal, name):
            lines.append(f"{name}: {value!r}  # as given; nominal {getattr(nominal, name):g}")
    lines += ["# Not told by the data, kept nominal:"] * bool(fit.unknown)
    lines += [f"#   {name}: {why}" for name, why in fit.unknown.items()]
    return "\n".join(lines) + "\n"
