"""A fit in words and tables, for the terminal and the report, and as a model file."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fsw_identification.estimation import Fit
from fsw_identification.problem import HEAT, WALKS
from fsw_identification.simulation import OUTPUTS
from fsw_identification.statistics import CORRELATED, SLOW, WHITE_S, Judgement, judge
from fsw_model import ModelParameters

NAMES = ("depth [mm]", "temperature [°C]", "torque [N·m]")
_95 = 1.96
#: slow disturbances worth reporting, in the order of WALKS
_REMARKABLE = (0.1, 0.2, 0.002, 0.2, 4.0)
#: correlation time [s] above which noise is as slow as the process, and more likely a disturbance
_SLOW_S = 10.0
#: share of lags beyond the 99 % bounds above which residuals are not called white
_WHITE = 0.07

#: a weld that moves a parameter from its prior by more standard deviations is not like the earlier
STRANGE = 4.0
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
        # A mean force or heat of all data is no disturbance but another operating point.
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


def model_text(fit: Fit, sources: str, air: dict[str, float] | None = None) -> str:
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


@dataclass(frozen=True)
class Summary:
    """A fit and its statistics."""

    sources: str
    fit: Fit
    validation: Fit | None = None  #: of the validation weld, with the same parameters
    notes: tuple[str, ...] = ()  #: data that were excluded
    #: standard deviations of the friction's coefficients, if they were estimated
    air: dict[str, float] = field(default_factory=dict)

    @cached_property
    def judgement(self) -> Judgement:
        """Statistics of the residuals."""
        return judge(self.fit.segments, self.fit.residuals, self.fit.whitened)

    @property
    def coloured(self) -> list[int]:
        """Outputs whose residuals are not white."""
        of = self.judgement
        return [
            i for i in range(len(NAMES)) if max(of.outside(i)) > _WHITE or of.together(i) > SLOW
        ]

    @cached_property
    def checked(self) -> Judgement | None:
        """Statistics of the residuals of the validation weld."""
        other = self.validation
        return None if other is None else judge(other.segments, other.residuals, other.whitened)


def parameter_rows(result: Summary) -> list[list[str]]:
    """Header, and a row per parameter: value, standard deviation, 95 % interval, nominal value."""
    nominal = ModelParameters()
    rows = [["parameter", "estimate", "std", "std [%]", "95 % interval", "nominal"]]
    for name, (value, std) in estimates(result.fit, result.air).items():
        interval = f"{value - _95 * std:.4g} to {value + _95 * std:.4g}"
        share = f"{100.0 * std / abs(value):.2f}" if value else ""
        rows.append(
            [name, f"{value:.5g}", f"{std:.2g}", share, interval, f"{getattr(nominal, name):.5g}"]
        )
    return rows


def output_rows(result: Summary) -> list[list[str]]:
    """Header and a row per output: fit, noise, and how white the whitened residuals are."""
    rows = [
        [
            "output",
            "fit [%]",
            "validation [%]",
            "noise",
            "correlated over",
            "lags outside 99 %",
            "with inputs",
        ]
    ]
    for i, name in enumerate(NAMES):
        auto, cross = result.judgement.outside(i)
        checked = f"{result.checked.fit_percent[i]:.1f}" if result.checked is not None else "-"
        fit, noise = f"{result.judgement.fit_percent[i]:.1f}", f"{result.fit.noise[i]:.3g}"
        correlation_s = float(result.fit.correlation_s[i])
        over = f"{correlation_s:.2g} s" if correlation_s > WHITE_S else "white"
        rows.append(
            [name, fit, checked, noise, over, f"{100 * auto:.0f} %", f"{100 * cross:.0f} %"]
        )
    return rows


def disturbances(fit: Fit) -> list[str]:
    """Disturbances and sensor faults in the data, one line each."""
    lines = []
    for shift, size, std in fit.shifts:
        at_s = fit.segments[shift.segment].time_s[shift.tick]
        if shift.output == HEAT:
            lines.append(
                f"torque_nm: its shift at {at_s:.1f} s heats like one larger by {size:+.3g} "
                f"(std {std:.1g}); if "
                "nothing of it heats, the sensor was wrong"
            )
        else:
            lines.append(
                f"{OUTPUTS[shift.output]}: disturbed at {at_s:.1f} s, "
                f"shifts by {size:+.3g} (std {std:.1g}; a "
                "disturbance or a sensor fault); estimated along"
            )
    lines += fit.notes
    for name, over_s in zip(NAMES, fit.correlation_s, strict=True):
        if over_s > _SLOW_S:
            lines.append(
                f"what is left of {name} is correlated over {over_s:.2g} s and counts as noise, "
                "but is as slow as the "
                "process: more likely a disturbance; do not rely on parameters that depend on it"
            )
    for which, name in enumerate(WALKS):
        largest = max(float(np.ptp(series[:, which])) for series in fit.disturbances)
        if largest > _REMARKABLE[which]:
            lines.append(
                f"a slow disturbance of {name}, {largest:.2g} from lowest to highest, "
                "was estimated along"
            )
    if any(
        float(np.ptp(series[:, which])) > _REMARKABLE[which]
        for series in fit.disturbances
        for which in (1, 3)
    ):
        lines.append(
            f"heat and offset of the temperature: correlation {fit.heat_and_offset:+.2f}; "
            "of their sum the depth takes "
            f"{fit.share[0]:.2f} (std {fit.share[1]:.2g}) for the tool's, 0: all is the sensor's"
        )
    return lines


def remarks(result: Summary) -> list[str]:
    """All remarks in addition to the tables."""
    fit = result.fit
    reasons: dict[str, list[str]] = {}
    for name, why in fit.kept.items():
        reasons.setdefault(why, []).append(name)
    lines = [
        f"{', '.join(names)}: not identifiable, kept nominal: {why}"
        for why, names in reasons.items()
    ]
    lines += [*result.notes, *disturbances(fit)]
    lines += [
        f"{name}: {size:.1f} standard deviations from that of the earlier welds; of another type? "
        "--other-type; of another machine or tool? identify it without --prior"
        for name, size in fit.moved.items()
        if size > STRANGE
    ]
    correlation = fit.correlation
    for i, j in np.argwhere(np.tril(np.abs(correlation) > CORRELATED, -1)):
        lines.append(f"{fit.free[j]} and {fit.free[i]}: correlation {correlation[i, j]:+.2f}")
    lines += of_sensors(fit)
    lines += [
        f"residuals of {NAMES[i]} are not white: the model does not explain all of it, "
        "or its noise is of another "
        f"colour; standard deviations are enlarged (× {fit.colour[i] ** 0.5:.1f})"
        for i in result.coloured
    ]
    return lines
