"""Heat over the path of a type of weld, learned from earlier welds; beside the model file."""

from __future__ import annotations

from hashlib import sha256
from itertools import pairwise
from typing import Annotated

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from fsw_control.schema.models import Many, Model, Name, content_of, problem, read_text, validate
from fsw_model.parameters import ModelParameters

Vector = NDArray[np.float64]

#: correlation length of the profile's error along the path, and the time that the
#: paper's traverse takes for it; chosen
CORRELATION_MM, CORRELATION_S = 86.0, 60.0


class HeatSource(Model):
    """A weld that the profile was learned from."""

    weld: str
    """name of the bag"""
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """of the bag's data"""
    left_out_kw: NonNegativeFloat | None = None
    """RMS of this weld's changes of heat that the other welds' profile lacks; of one weld: none"""
    computed: bool = False
    """simulated from the drawing, before the first weld of the type, which replaces it"""


class ThermalModel(Model):
    """The model (16) with which the heat was found: with another one it is another heat."""

    thermal_gain_c_per_kw: PositiveFloat
    copper_lag_s: PositiveFloat
    tool_lag_s: PositiveFloat
    dead_time_s: PositiveFloat

    @classmethod
    def of(cls, parameters: ModelParameters) -> ThermalModel:
        """That of a process model."""
        return cls(**{name: getattr(parameters, name) for name in cls.model_fields})


class HeatProfile(Model):
    """Heat into the copper beyond the spindle's power, by the path that the tool has travelled.

    Only its changes are used; the controller's estimator finds a constant offset.
    """

    type: Name
    """of weld: canister and lid, tool, path"""
    model: ThermalModel
    welds: Annotated[Many[HeatSource], Field(min_length=1)]
    travel_mm: Annotated[Many[NonNegativeFloat], Field(min_length=2)]
    """places along the weld, in order"""
    heat_kw: Many[float]
    """at each place"""
    deviation_kw: Many[NonNegativeFloat]
    """standard deviation there of the profile's error in a weld of the type"""

    @model_validator(mode="after")
    def _check(self) -> HeatProfile:
        for name in ("heat_kw", "deviation_kw"):
            if len(getattr(self, name)) != len(self.travel_mm):
                raise problem(f"must have {len(self.travel_mm)} values, as travel_mm has", name)
        for i, (place, following) in enumerate(pairwise(self.travel_mm)):
            if following <= place:
                raise problem("is not beyond the place before it", "travel_mm", i + 1)
        return self

    @classmethod
    def from_file(cls, path: object) -> HeatProfile:
        """Read a YAML file; InputError if it cannot be read or something in it is wrong."""
        return validate(
            cls, content_of(read_text(str(path), "heat profile"), str(path)), str(path)
        )

    @property
    def sha256(self) -> str:
        """Digest of :attr:`text`, that is of the file as written."""
        return sha256(self.text.encode()).hexdigest()

    @property
    def text(self) -> str:
        """YAML that :meth:`from_file` reads."""
        title = "# Heat over the path of a weld, by 'fsw.py learn'.\n"
        content = self.model_dump(mode="json", exclude_none=True)
        return title + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=99)
