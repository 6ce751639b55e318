"""Model file of an estimate: deviations from the nominal model, commented with their errors."""

from __future__ import annotations

from fsw_identification.estimation import Fit
from fsw_identification.noise import WHITE_S
from fsw_identification.simulation import OUTPUTS
from fsw_identification.statistics import CORRELATED
from fsw_model import ModelParameters

#: a mean disturbance of more standard deviations is included in the operating point
_SIGNIFICANT = 3.0


def estimates(fit: Fit, air: dict[str, float] | None = None) -> dict[str, tuple[float, float]]:
    """Estimated parameters with standard deviations, by name.

    Includes the resting force and power if they differ from the nominal ones, and the friction's
    coefficients with the standard deviations ``air`` if they were estimated.
    """
    known = {
        name: (getattr(fit.parameters, name), std) for name, std in (fit.std | (air or {})).items()
    }
    for name, offset, std in zip(
        ("operating_force_kn", "operating_power_kw"),
        fit.offset.tolist(),
        fit.offset_std.tolist(),
        strict=True,
    ):
        if abs(offset) > _SIGNIFICANT * std:
            known[name] = (getattr(fit.parameters, name) - offset, std)
    return known


def of_sensors(fit: Fit) -> list[str]:
    """Coloured noise and thermocouple lag, one line each."""
    lines = [
        f"noise of {name}: standard deviation {noise:.2g}, correlated over {correlation_s:.2g} s"
        for name, noise, correlation_s in zip(OUTPUTS, fit.noise, fit.correlation_s, strict=True)
        if correlation_s > WHITE_S
    ]
    if fit.lag_s is not None:
        (lag_s, deviation_s), shown = fit.lag_s, fit.shown
        lines.append(
            f"the thermocouple lags the tool by {lag_s:.3g} s (std {deviation_s:.1g}), "
            "as the depth tells; for what it "
            f"shows, in the model file, tool_lag_s is {shown.tool_lag_s:.3g} s and dead_time_s "
            f"{shown.dead_time_s:.3g} s"
        )
        lines += [
            f"lag of the thermocouple and {name}: correlation {correlation:+.2f}"
            for name, correlation in zip(fit.free, fit.lag_correlation, strict=True)
            if abs(correlation) > CORRELATED
        ]
    return lines


def text(fit: Fit, sources: str, air: dict[str, float] | None = None) -> str:
    """YAML for :meth:`fsw_model.ModelParameters.from_yaml`; ``sources`` are the data's origins."""
    nominal, known, shown = dict(ModelParameters()), estimates(fit, air), fit.shown
    lines = [f"# Model parameters identified from {sources}; standard deviations behind +-."]
    for name, (value, std) in known.items():
        of_tool = ""
        if (as_seen := getattr(shown, name)) != getattr(fit.parameters, name):
            of_tool, value = f"as the thermocouple shows it; of the tool {value:.6g} ", as_seen
        # YAML 1.1 accepts 1.5e+06 as a number only with a point
        lines.append(
            f"{name}: {float(f'{value:.6g}')!r}  "
            f"# {of_tool}+- {std:.2g}; nominal {nominal[name]:g}"
        )
    for name, value in dict(shown).items():
        if name not in known and value != nominal[name]:
            lines.append(f"{name}: {value!r}  # as given; nominal {nominal[name]:g}")
    lines += [f"# {line}" for line in of_sensors(fit)]
    lines += ["# Not identifiable from the data, kept nominal:"] * bool(fit.kept)
    lines += [f"#   {name}: {why}" for name, why in fit.kept.items()]
    return "\n".join(lines) + "\n"
