"""Uncertainty of a model's parameters: a file beside the model file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from fsw_control.schema.models import Parameters, problem
from fsw_model.parameters import ModelParameters


class ParameterCovariance(Parameters):
    """Covariance of the relative errors of identified parameters."""

    what = "covariance"
    example = "parameters: [dead_time_s], covariance: [[0.0001]]"

    parameters: list[str] = Field(default=[], description="names of the identified parameters")
    covariance: list[list[float]] = Field(
        default=[], description="of their relative errors, row by row"
    )

    @model_validator(mode="after")
    def _check(self) -> ParameterCovariance:
        n = len(self.parameters)
        if unknown := [
            name for name in self.parameters if name not in ModelParameters.model_fields
        ]:
            raise problem(f"the model has no {', '.join(unknown)}", "parameters")
        if len(self.covariance) != n or any(len(row) != n for row in self.covariance):
            raise problem(
                f"must have {n} rows of {n} numbers, as there are parameters", "covariance"
            )
        matrix = self.matrix
        if n and not (np.allclose(matrix, matrix.T) and np.linalg.eigvalsh(matrix).min() > 0.0):
            raise problem("is no covariance: not symmetric and positive", "covariance")
        return self

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The covariance, shape (n, n)."""
        return np.array(self.covariance, dtype=np.float64).reshape(len(self.parameters), -1)

    @property
    def text(self) -> str:
        """YAML that :meth:`from_file` reads."""
        rows = "".join(
            f"  - [{', '.join(f'{float(value):.9e}' for value in row)}]\n"
            for row in self.covariance
        )
        names = ", ".join(self.parameters)
        title = "# Covariance of the relative errors of identified parameters."
        return f"{title}\nparameters: [{names}]\ncovariance:\n{rows}"
