"""Variables of an FMU.

One table, from which modelDescription.xml and the declarations of its C sources are written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

from fsw_control.parameters import ParameterSpec
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_control.weld import TICK_S
from fsw_export.choice import render

#: unit: exponents of the base units of SI, and ``value in SI = factor * value + offset``
UNITS: dict[str, dict[str, float]] = {
    "mm": {"m": 1, "factor": 1e-3},
    "mm/min": {"m": 1, "s": -1, "factor": 1e-3 / 60.0},
    "degC": {"K": 1, "offset": 273.15},
    "K": {"K": 1},
    "s": {"s": 1},
    "kN": {"kg": 1, "m": 1, "s": -2, "factor": 1e3},
    "kN/s": {"kg": 1, "m": 1, "s": -3, "factor": 1e3},
    "rpm": {"rad": 1, "s": -1, "factor": RAD_PER_S_PER_RPM},
    "rpm/s": {"rad": 1, "s": -2, "factor": RAD_PER_S_PER_RPM},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "N m/rpm": {"kg": 1, "m": 2, "s": -1, "rad": -1, "factor": 1.0 / RAD_PER_S_PER_RPM},
    "N m/rpm2": {"kg": 1, "m": 2, "rad": -2, "factor": RAD_PER_S_PER_RPM**-2},
    "kW": {"kg": 1, "m": 2, "s": -3, "factor": 1e3},
    "kN/mm": {"kg": 1, "s": -2, "factor": 1e6},
    "kW/degC": {"kg": 1, "m": 2, "s": -3, "K": -1, "factor": 1e3},
    "rpm/kW": {"kg": -1, "m": -2, "s": 2, "rad": 1, "factor": 1e-3 * RAD_PER_S_PER_RPM},
    "N m/kN": {"m": 1, "factor": 1e-3},
    "degC/kW": {"kg": -1, "m": -2, "s": 3, "K": 1, "factor": 1e-3},
    "kg m2": {"kg": 1, "m": 2},
}
#: type in C by type
TYPES = {"Real": "double", "Integer": "int", "Boolean": "int"}
_FOLDER = Path(__file__).parent / "fmi"


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable."""

    name: str  #: also of the member of its C struct, with ``_`` for dots
    causality: str  #: ``input``, ``output`` or ``parameter``
    description: str
    unit: str = ""  #: one of ``UNITS``; empty: none
    start: float | None = (
        None  #: its type is that of the variable; None (an output): Real, or what ``type`` says
    )
    type: str = "Real"  #: one of ``TYPES``
    allowed: tuple[float, float] = (-inf, inf)  #: range of a parameter
    fixed: bool = False  #: whether a parameter cannot be changed after the initialization

    @property
    def member(self) -> str:
        """Name in C."""
        return self.name.replace(".", "_")

    @property
    def variability(self) -> str:
        """As FMI names it."""
        if self.causality == "parameter":
            return "fixed" if self.fixed else "tunable"
        return "continuous" if self.type == "Real" else "discrete"

    @property
    def start_text(self) -> str:
        """Start value in XML; empty: none."""
        if self.start is None:
            return ""
        return str(bool(self.start)).lower() if self.type == "Boolean" else repr(self.start)

    @property
    def attributes(self) -> dict[str, str]:
        """Those that its type has in XML."""
        low, high = (
            (int(x) for x in self.allowed)
            if self.type == "Integer" and self.allowed[1] < inf
            else self.allowed
        )
        attributes = {
            "unit": self.unit,
            "min": repr(low) if low > -inf else "",
            "max": repr(high) if high < inf else "",
            "start": self.start_text,
        }
        return {name: text for name, text in attributes.items() if text}


def real(name: str, description: str, unit: str, start: float) -> Variable:
    """A Real input."""
    return Variable(name, "input", description, unit, float(start))


def boolean(name: str, description: str, start: bool) -> Variable:
    """A Boolean input."""
    return Variable(name, "input", description, start=start, type="Boolean")


def output(name: str, description: str, unit: str = "", type: str = "Real") -> Variable:
    """An output."""
    return Variable(name, "output", description, unit, type=type)


def parameter(spec: ParameterSpec, start: float, fixed: bool = False) -> Variable:
    """A parameter of a node as one of the FMU."""
    return Variable(
        name=spec.name,
        causality="parameter",
        description=spec.description,
        unit=spec.unit,
        start=start,
        type="Integer" if spec.type == "int" else "Real",
        allowed=spec.range or (-inf, inf),
        fixed=fixed,
    )


@dataclass(frozen=True, slots=True)
class Content:
    """Content of an FMU."""

    identifier: str  #: model identifier of FMI
    description: str
    variables: tuple[Variable, ...]
    #: C files of the unit by name, without those that all FMUs share; ``fmu_unit.h`` declares its
    #: memory
    sources: Mapping[str, str] = field(repr=False)

    def of_type(self, type: str) -> list[Variable]:
        """Variables of a type, in the order of their value references."""
        return [variable for variable in self.variables if variable.type == type]


def declarations(content: Content, guid: str) -> dict[str, str]:
    """The generated C files.

    ``variables.h``, for the unit, and ``tables.h``, for the FMI functions.
    """
    types = [
        {"name": type, "in_c": in_c, "variables": content.of_type(type)}
        for type, in_c in TYPES.items()
    ]
    return {
        "variables.h": render("variables.h", types=types, step_s=TICK_S),
        "tables.h": render("variables_tables.h", types=types, guid=guid),
    }


def model_description(content: Content, sources: Sequence[str], guid: str) -> str:
    """modelDescription.xml of FMI 2.0; ``sources`` are the C files to compile."""
    return render(
        "modelDescription.xml",
        identifier=content.identifier,
        description=content.description,
        variables=content.variables,
        references={
            v.name: number for type in TYPES for number, v in enumerate(content.of_type(type))
        },
        sources=sources,
        units=UNITS,
        step_s=TICK_S,
        guid=guid,
    )


def source(name: str) -> str:
    """Text of a C file that is the same in every export."""
    return (_FOLDER / name).read_text(encoding="utf-8")
