"""Variables of an FMU: one table, from which modelDescription.xml and the declarations of its C sources are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from xml.etree import ElementTree

from fsw_control.parameters import ParameterSpec
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_control.weld import TICK_S

#: unit: exponents of the base units of SI, and ``value in SI = factor * value + offset``
UNITS: dict[str, dict[str, float]] = {
    "mm": {"m": 1, "factor": 1e-3},
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
    "kg m2": {"kg": 1, "m": 2},
}
TYPES = ("Real", "Integer", "Boolean")
#: of the C sources that are the same in every export
FOLDER = Path(__file__).parent / "fmi"


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable.

    Attributes
    ----------
    name : str
        Also of the member of its C struct, with ``_`` for dots.
    causality : str
        ``input``, ``output`` or ``parameter``.
    description : str
    unit : str
        One of ``UNITS``; empty: none.
    start : float, int, bool or None
        Its type is that of the variable; None (an output): Real, or what ``type`` says.
    type : str
        One of ``TYPES``.
    allowed : (float, float)
        Range of a parameter.
    fixed : bool
        Whether a parameter cannot be changed after the initialization.
    """

    name: str
    causality: str
    description: str
    unit: str = ""
    start: float | None = None
    type: str = "Real"
    allowed: tuple[float, float] = (-inf, inf)
    fixed: bool = False

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


def given(name: str, description: str, unit: str, start: float) -> Variable:
    """A Real input."""
    return Variable(name, "input", description, unit, float(start))


def flag(name: str, description: str, start: bool) -> Variable:
    """A Boolean input."""
    return Variable(name, "input", description, start=start, type="Boolean")


def shown(name: str, description: str, unit: str = "", type: str = "Real") -> Variable:
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
    """What an FMU is made of.

    Attributes
    ----------
    identifier : str
        Model identifier of FMI.
    description : str
    variables : tuple of Variable
    header : str
        Which of the sources declares the unit's memory.
    sources : mapping of str to str
        C files of the unit by name, without those that all FMUs share.
    """

    identifier: str
    description: str
    variables: tuple[Variable, ...]
    header: str
    sources: Mapping[str, str] = field(repr=False)

    def of_type(self, type: str) -> list[Variable]:
        """Variables of a type, in the order of their value references."""
        return [variable for variable in self.variables if variable.type == type]


def declarations(content: Content, guid: str) -> dict[str, str]:
    """The generated C files: ``variables.h``, for the unit, and ``tables.h``, for the FMI functions."""
    structs, tables = [], []
    for type, c_type in zip(TYPES, ("double", "int", "int"), strict=True):
        variables = content.of_type(type)
        members = [f"  {c_type} {v.member};{f' /* {v.unit} */' if v.unit else ''}" for v in variables]
        structs += ["typedef struct {", *(members or [f"  {c_type} none;"]), f"}} fmu_{type.lower()}s;", ""]
        rows = [
            f'  {{"{v.name}", {v.causality.upper() if v.causality != "parameter" else v.variability.upper()}, '
            f"{_c(v.allowed[0])}, {_c(v.allowed[1])}}},"
            for v in variables
        ]
        initial = ", ".join(
            _c(float(v.start or 0.0)) if c_type == "double" else str(int(v.start or 0)) for v in variables
        )
        tables += [
            f"enum {{ N_{type.upper()}S = {len(variables)} }};",
            f"static const variable_info {type.upper()}_INFO[] = {{",
            *(rows or ['  {"", OUTPUT, 0.0, 0.0},']),
            "};",
            f"static const fmu_{type.lower()}s {type.upper()}_START = {{{initial or '0'}}};",
            "",
        ]
    head = "/* Generated from the table of variables of fsw_export. */\n"
    parameters = [v for v in content.of_type("Real") if v.causality == "parameter"]
    starts = "".join(f"#define START_{v.member.upper()} {v.start!r}\n" for v in parameters)
    return {
        "variables.h": f'{head}#define FMU_STEP_S {TICK_S!r}\n{starts}\n#include "{content.header}"\n\n'
        + "\n".join(structs),
        "tables.h": f'{head}#define FMU_GUID "{guid}"\n\n' + "\n".join(tables),
    }


def _c(value: float) -> str:
    return repr(value) if abs(value) < inf else "INFINITY" if value > 0.0 else "-INFINITY"


def model_description(content: Content, sources: Sequence[str], guid: str) -> str:
    """modelDescription.xml of FMI 2.0; ``sources`` are the C files to compile."""
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=content.identifier,
        guid=guid,
        description=content.description,
        license="Apache-2.0",
        generationTool="fsw-control",
        variableNamingConvention="structured",
    )
    unit = ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=content.identifier,
        canHandleVariableCommunicationStepSize="false",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    files = ElementTree.SubElement(unit, "SourceFiles")
    for name in sources:
        ElementTree.SubElement(files, "File", name=name)
    used = {v.unit for v in content.variables if v.unit}
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name in (name for name in UNITS if name in used):
        base = {key: repr(value) for key, value in UNITS[name].items()}
        ElementTree.SubElement(ElementTree.SubElement(definitions, "Unit", name=name), "BaseUnit", base)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="logStatusError", description="Why a call was refused")
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime="240", stepSize=repr(TICK_S))
    variables = ElementTree.SubElement(root, "ModelVariables")
    for v in content.variables:
        entry = {
            "name": v.name,
            "valueReference": str(content.of_type(v.type).index(v)),
            "causality": v.causality,
            "variability": v.variability,
            "description": v.description,
        }
        element = ElementTree.SubElement(variables, "ScalarVariable", entry)
        low, high = (int(bound) for bound in v.allowed) if v.type == "Integer" and v.allowed[1] < inf else v.allowed
        attributes = {
            "unit": v.unit,
            "min": repr(low) if low > -inf else "",
            "max": repr(high) if high < inf else "",
            "start": v.start_text,
        }
        kept = {key: value for key, value in attributes.items() if value}
        ElementTree.SubElement(element, v.type, kept)
    structure = ElementTree.SubElement(root, "ModelStructure")
    indices = [i for i, v in enumerate(content.variables, 1) if v.causality == "output"]
    outputs = ElementTree.SubElement(structure, "Outputs")
    for i in indices:  # a step shows in the outputs at its end: nothing set between two steps does
        ElementTree.SubElement(outputs, "Unknown", index=str(i), dependencies="")
    unknowns = ElementTree.SubElement(structure, "InitialUnknowns")
    for i in indices:
        ElementTree.SubElement(unknowns, "Unknown", index=str(i))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def table(content: Content) -> str:
    """All variables as text: one line each."""
    rows = [(v.name, v.causality, v.unit or v.type, v.start_text, v.description) for v in content.variables]
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    return "\n".join("  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[4]]) for row in rows)


def sources(*names: str) -> dict[str, str]:
    """Texts of files in ``FOLDER``."""
    return {name: (FOLDER / name).read_text(encoding="utf-8") for name in names}
