"""Noise of a machine's sensors and rates of its drives: a file beside the model file."""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat, PositiveFloat

from fsw_control.schema.models import Parameters

_NOISE = "standard deviation, resolution included"


class MachineData(Parameters):
    """Sensors and drives as identified from welds (``fsw.py identify``); None: not identified."""

    what = "machine data"
    example = "temperature_noise_c: 0.3"

    depth_noise_mm: NonNegativeFloat | None = Field(default=None, description=_NOISE)
    torque_noise_nm: NonNegativeFloat | None = Field(default=None, description=_NOISE)
    temperature_noise_c: NonNegativeFloat | None = Field(default=None, description=_NOISE)
    force_rate_kn_per_s: PositiveFloat | None = Field(
        default=None, description="of the drive of the axial force"
    )
    speed_rate_rpm_per_s: PositiveFloat | None = Field(
        default=None, description="of the drive of the spindle"
    )

    @property
    def text(self) -> str:
        """YAML that :meth:`from_file` reads."""
        seen = {name: value for name, value in self if value is not None}
        lines = [f"{name}: {float(f'{value:.4g}')!r}\n" for name, value in seen.items()]
        unseen = ", ".join(sorted(set(type(self).model_fields) - set(seen)))
        remark = f"# Not shown by the data: {unseen}\n" if unseen else ""
        return (
            "# Sensors and drives of a machine, by 'fsw.py identify'.\n" + "".join(lines) + remark
        )
