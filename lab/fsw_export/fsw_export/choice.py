"""What is exported: a unit with its model, tuning and parameters; and how its texts are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any

from fsw_analysis.report import templates
from fsw_control.schema.models import InputError, content_of, read_text
from fsw_model import ModelParameters, ProcessModel, nominal


@dataclass(frozen=True)
class Choice:
    """A unit with its model, tuning and parameters."""

    unit: str  #: ``nmpc``, ``decentral`` or ``plant``
    #: the paper's model and the default tuning where they are not given
    model_file: Path | None = None
    tuning_file: Path | None = None
    values: Mapping[str, Any] = field(
        default_factory=dict
    )  #: parameters of the controller's node or of the plant

    @cached_property
    def model(self) -> ModelParameters:
        """Parameters of the process."""
        return nominal() if self.model_file is None else ModelParameters.from_file(self.model_file)

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """All parameters that differ from the defaults of the controller's node or of the plant.

        Raises
        ------
        InputError
            If the unit takes no tuning, or the file of the tuning cannot be used.
        """
        if self.unit == "decentral":
            return self._of_spindle() | self._gains() | dict(self.values)
        if self.unit == "plant" and self.tuning_file is not None:
            raise InputError("the plant has no tuning; leave out --tuning")
        files = {"model_file": self.model_file, "tuning_file": self.tuning_file}
        return dict(self.values) | {
            name: str(path) for name, path in files.items() if path is not None
        }

    @property
    def origin(self) -> str:
        """Model and tuning in words."""
        model = f"model `{self.model_file.name}`" if self.model_file else "the paper's model"
        default = "default tuning" + " but for" * bool(self.values)
        tuning = f"tuning `{self.tuning_file.name}`" if self.tuning_file else default
        return ", ".join(
            [model, tuning, *(f"`{name}={value}`" for name, value in self.values.items())]
        )

    def _of_spindle(self) -> dict[str, Any]:
        """Process data of the decentralized controller, as parameters of its node."""
        return {
            "friction.constant": self.model.friction_constant_nm,
            "friction.linear": self.model.friction_linear_nm_per_rpm,
            "friction.quadratic": self.model.friction_quadratic_nm_per_rpm2,
            "spindle_inertia": self.model.spindle_inertia_kgm2,
            "nominal_torque": ProcessModel(self.model).equilibrium().outputs.process_torque_nm,
        }

    def _gains(self) -> dict[str, Any]:
        """Parameters of the decentralized controller's node from the tuning file."""
        if self.tuning_file is None:
            return {}
        content = content_of(read_text(self.tuning_file, "tuning"), str(self.tuning_file))
        if not isinstance(content, dict):
            raise InputError(
                f"{self.tuning_file}: must map names of parameters to values, "
                "e.g. depth_gain: 120.0"
            )
        return content


def _c(value: Any) -> str:
    """A number, an array of numbers or a struct of those as a C constant, exactly."""
    if isinstance(value, dict):
        return "{" + ", ".join(f".{name} = {_c(member)}" for name, member in value.items()) + "}"
    if hasattr(value, "__len__"):
        return "{" + ", ".join(map(_c, value)) + "}"
    return {inf: "INFINITY", -inf: "-INFINITY"}.get(value) or repr(value)


_ENVIRONMENT = templates("fsw_export")
_ENVIRONMENT.filters["c"] = _c


def render(template: str, **values: Any) -> str:
    """Text of ``templates/<template>.j2``."""
    return _ENVIRONMENT.get_template(f"{template}.j2").render(values)
