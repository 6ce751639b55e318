"""Pages of the reference, made from the packages' own data.

Parameters, messages, files, command line, JSON Schemas.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import fsw
from fsw.demo import parser as demo_parser
from fsw.main import parser as operator_parser
from fsw.schema_command import GROUP, kinds, schema_text
from fsw_analysis import report
from fsw_analysis.procedure import Procedure
from fsw_control.parameters import NodeParameters, ParameterSpec, describe
from fsw_control.schema.extensions import extensions, loaded
from fsw_control.schema.models import Model, descriptions, json_schema
from fsw_control.schema.ranges import Range
from fsw_hmi.main import parser as hmi_parser
from fsw_model import nominal
from fsw_nmpc.tuning import ApproachTuning, EstimatorTuning, Tuning
from fsw_quality.attestation import Attestation
from fsw_recorder.findings import Code, Unchecked
from fsw_recorder.manifest import Manifest
from fsw_recorder.signature import PREDICATE_TYPE, KeyList, Purpose
from fsw_scenario import scenario_file
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import CANISTER_DIAMETER_MM, LIMITS

WORKSPACE = Path(__file__).resolve().parent.parent
#: page of what is public in Python, by package
API_PAGES = {
    "fsw": "fsw",
    "fsw_analysis": "fsw",
    "fsw_control": "contract",
    "fsw_scenario": "contract",
    "fsw_lab": "more",
    "fsw_quality": "more",
}


def python_api() -> dict[str, str]:
    """Pages on `import fsw` whose text mkdocstrings makes from the docstrings, one per module."""
    places = dict(fsw.MODULE_OF)
    places |= {name: entry.module for name, entry in extensions("fsw.api").items()}
    modules: dict[str, list[str]] = {}
    for name, module in sorted(places.items()):
        modules.setdefault(API_PAGES[module.partition(".")[0]], []).append(f"{module}.{name}")
    return {
        f"python-{key}": page(title, *(f"::: {name}\n" for name in modules[key]))
        for key, title in (
            ("fsw", "Python: weld, compare, model"),
            ("contract", "Python: contracts of controllers and plants"),
            ("more", "Python: identify, tune, export, record"),
        )
    }


def parameter_table(specs: dict[str, ParameterSpec]) -> list[str]:
    """A table of parameters."""
    rows = []
    for spec in specs.values():
        default = (
            ", ".join(map(str, spec.default))
            if isinstance(spec.default, list)
            else str(spec.default)
        )
        allowed = (
            ", ".join(spec.options)
            if spec.range is None
            else f"{spec.range[0]:g} … {spec.range[1]:g}"
        )
        text = spec.description + (" (at start only)" if spec.read_only else "")
        rows.append((f"`{spec.name}`", spec.type, default, allowed, spec.unit, text))
    return table(("parameter", "type", "default", "range", "unit", "meaning"), rows)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Lines of a table of words."""
    return report.table([header, *rows], words=None).splitlines()


def page(title: str, *lines: str) -> str:
    """A page of the reference."""
    return "\n".join([f"# {title}", "", *lines, ""])


def node_parameters() -> dict[str, type[NodeParameters]]:
    """Models of the nodes' parameters, by the name of their schema and page."""
    models = {name: loaded(GROUP, name) for name in kinds()}
    return {name: model for name, model in models.items() if issubclass(model, NodeParameters)}


def parameters() -> dict[str, str]:
    """Pages for each node's parameters and the NMPC's tuning file, and a list of them."""
    pages, rows = {"parameters-tuning": tuning_file()}, []
    for name, model in node_parameters().items():
        specs, about = describe(model), " ".join((model.__doc__ or "").split()).replace("``", "`")
        heading, package = about.partition(".")[0], model.__module__.partition(".")[0]
        schema = f"JSON Schema: [{name}.schema.json]({name}.schema.json)."
        pages[name] = page(heading, about, "", schema, "", *parameter_table(specs))
        rows.append((f"[{heading}]({name}.md)", f"`{package}`", len(specs)))
    pages["parameters"] = page(
        "Parameters",
        "One model per node has type, default, range, unit and meaning; "
        "`ros2 param describe` shows the same.",
        "Every controller node has the parameters of [every controller "
        "node](parameters-controller.md) and its own. The file that the NMPC's parameter "
        "`tuning_file` names has [fields of its own](parameters-tuning.md).",
        "",
        *table(("of", "package", "parameters"), rows),
    )
    return pages


def tuning_file() -> str:
    """Fields of the NMPC's tuning file.

    Trajectories, cost, estimator and what is used of its estimates.
    """
    presets = [Tuning.preset(name, nominal()) for name in ("default", "paper")]

    def rows(model: type[Model], place: str = "") -> Iterator[tuple[object, ...]]:
        for name, text in meanings(model).items():
            values = [attrgetter(place + name)(preset) for preset in presets]
            if not isinstance(values[0], Model):
                shown = (f"{v:.6g}" if isinstance(v, float) else v for v in values)
                yield f"`{place}{name}`", *shown, text

    parts = (Tuning, ""), (ApproachTuning, "approach."), (EstimatorTuning, "estimator.")
    fields = [row for model, place in parts for row in rows(model, place)]
    intro = "Fields of the file that the parameter `tuning_file` names."
    lines = table(("field", "`default`", "`paper`", "meaning"), fields)
    return page("Tuning file of the NMPC", intro, "", *lines)


def meanings(model: type[Model]) -> dict[str, str]:
    """What a model says of each field; its own description where it says nothing."""
    summary = (model.__doc__ or "").split("\n")[0]
    return {
        name: descriptions(model).get(name, summary).replace("``", "`")
        for name in model.model_fields
    }


def messages() -> dict[str, str]:
    """Pages of the definitions of messages, services and actions."""
    pages = {}
    for kind, heading in (("msg", "Messages"), ("srv", "Services"), ("action", "Actions")):
        lines = ["Definitions in `fsw_msgs`, with their comments. Units are SI."]
        for path in sorted((WORKSPACE / "src/fsw_msgs" / kind).glob("*")):
            lines += ["", f"## {path.stem}", "", "```", path.read_text("utf-8").strip(), "```"]
        pages[heading.lower()] = page(heading, *lines)
    return pages


def model_tables(model: type[Model], heading: str = "##") -> list[str]:
    """A table of the keys of a model, and one of each model inside it."""
    schema = json_schema(model)
    lines = []
    for name, definition in [("", schema), *schema.get("$defs", {}).items()]:
        required = definition.get("required", [])
        rows = []
        if "enum" in definition:
            lines += [
                "",
                f"{heading} {title(name)}",
                "",
                definition.get("description", ""),
                "",
                allowed(definition),
            ]
            continue
        for key, value in definition["properties"].items():
            default = (
                f"`{json.dumps(value['default'])}`"
                if "default" in value
                else "needed"
                if key in required
                else ""
            )
            rows.append(
                (
                    f"`{key}`",
                    allowed(value),
                    default,
                    value.get("description", "").replace("\n", " "),
                )
            )
        lines += ["", f"{heading} {title(name) if name else 'Keys'}", ""]
        lines += [definition["description"], ""] if name else []
        lines += table(("key", "value", "default", "meaning"), rows)
    return lines


def title(name: str) -> str:
    """Name of a model in words: ``PhaseEntry`` is a phase."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", name.removesuffix("Entry")).capitalize()


def allowed(value: dict[str, Any]) -> str:
    """What a JSON Schema allows, in words."""
    if "$ref" in value:
        name = title(value["$ref"].rpartition("/")[2])
        return f"[{name.lower()}](#{name.lower().replace(' ', '-')})"
    if "anyOf" in value:
        return " or ".join(map(allowed, value["anyOf"]))
    if value.get("type") == "array":
        return f"list: {allowed(value['items'])}"
    if "enum" in value or "const" in value:
        return ", ".join(f"`{choice}`" for choice in value.get("enum", [value.get("const")]))
    if "minimum" in value:
        return str(Range(value["minimum"], value["maximum"], value.get("unit", "")))
    words = {"object": "mapping", "boolean": "`true`, `false`", "string": "text"}
    return (
        "letters, digits, `_`" if "pattern" in value else words.get(value["type"], value["type"])
    )


def scenarios() -> dict[str, str]:
    """A page of the keys and ranges of scenario files, and of the shipped scenarios."""
    loaded = [scenario_file.load(name) for name in scenario_file.shipped()]
    shipped = [
        (f"`{scenario.name}`", f"{scenario.duration_s:g}", " ".join(scenario.description.split()))
        for scenario in loaded
    ]
    changes = "; ".join(
        f"`{name}` by {step:g} {unit} at once, {rate:g} {unit}/s as a ramp"
        for name, (unit, step, rate) in LIMITS.items()
    )
    lines = [
        "How to write one, with an example: [Write a scenario](../how-to/scenarios.md). "
        "The same as a JSON Schema, for editors: [scenario.schema.json](scenario.schema.json).",
        *model_tables(Scenario),
        "",
        f"Largest change of a set-point in a phase: {changes}. "
        f"The arc of a path is on a diameter of {CANISTER_DIAMETER_MM:g} mm.",
        "",
        "## Shipped scenarios",
        "",
        "They are in `src/fsw_scenario/fsw_scenario/scenarios`; commands take them by name.",
        "",
        *table(("name", "duration [s]", "what it shows"), shipped),
    ]
    return {"scenarios": page("Scenario files", *lines)}


def procedures() -> dict[str, str]:
    """A page of the keys of procedure files."""
    lines = [
        "What a weld must keep, as data; how it is used: [The record of a "
        "weld](../how-to/record.md). The same as a JSON Schema, "
        "for editors: [procedure.schema.json](procedure.schema.json).",
        *model_tables(Procedure),
    ]
    return {"procedures": page("Procedure files", *lines)}


def evidence() -> dict[str, str]:
    """A page of the keys of manifests and attestations."""
    lines = [
        "What they are for: [Evidence](../how-to/evidence.md). "
        "The same as JSON Schemas: [manifest.schema.json](manifest.schema.json), "
        "[attestation.schema.json](attestation.schema.json).",
        "",
        "## manifest.json",
        *model_tables(Manifest, "###"),
        "",
        "## Signatures",
        "",
        "`attestation.json` and each `FILE.sig` is a [DSSE "
        "envelope](https://github.com/secure-systems-lab/dsse) "
        "around an [in-toto "
        "Statement](https://github.com/in-toto/attestation/blob/main/spec/v1/statement.md). "
        "Its subjects are the SHA-256 of the signed files; "
        f"its predicate type is `{PREDICATE_TYPE}` and a purpose, "
        f"{', '.join(f'`{purpose}`' for purpose in Purpose)}; its predicate has `signed_at`. "
        "The key id is the public key as OpenSSH writes it.",
        "",
        "## attestation.json: predicate",
        *model_tables(Attestation, "###"),
        "",
        "## List of trusted keys",
        *model_tables(KeyList, "###"),
        "",
        "## Codes of findings",
        "",
        *table(("code", "words"), [(f"`{code}`", code.words) for code in (*Code, *Unchecked)]),
    ]
    return {"evidence": page("Evidence files", *lines)}


def command_line() -> str:
    """A page of all commands with their arguments."""
    verbs = next(
        action
        for action in operator_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    ).choices
    lines = [
        "`scripts/fsw.py` has a verb for everything; "
        "installed as a package, the command is `fsw`.",
        "",
        "Exit codes: 0 done, 1 not possible or a wrong value (one line says why), 2 an unknown or "
        "missing command or option, 130 interrupted; others are with their command. "
        "`--out` is where results are written, and results that exist are replaced only with "
        "`--force`; `--set` replaces a value of a scenario, "
        "`--parameter` one of a node that computes.",
        "",
        "Nodes (`scripts/run_*.py`) take `--ros-args` with `-p`, `-r`, "
        "`--params-file` and `--log-level`; `--help` lists their parameters.",
        "",
        *(line for verb in verbs.values() for line in command(verb)),
    ]
    for parser, script in ((demo_parser(), "demo.py"), (hmi_parser(), "run_hmi.py")):
        lines += ["", f"## scripts/{script}", "", sentence(parser), *arguments(parser)]
    return page("Command line", *lines)


def sentence(parser: argparse.ArgumentParser) -> str:
    """What a command does, beginning with a capital letter."""
    text = (parser.description or "").removeprefix(f"{parser.prog.split()[-1]}: ")
    return text[:1].upper() + text[1:]


def command(parser: argparse.ArgumentParser) -> list[str]:
    """A command and its subcommands."""
    lines = [
        f"## {' '.join(parser.prog.split()[1:])}",
        "",
        sentence(parser),
        *arguments(parser),
        "",
    ]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            lines += [
                line for subcommand in action.choices.values() for line in command(subcommand)
            ]
    return lines


def arguments(parser: argparse.ArgumentParser) -> list[str]:
    """Table of a command's arguments."""
    rows = []
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            chosen = f"one of {', '.join(map(str, action.choices))}" if action.choices else ""
            text = argparse.HelpFormatter("")._expand_help(action) if action.help else ""
            rows.append(
                (f"`{argument(action)}`", "; ".join(part for part in (chosen, text) if part))
            )
    return ["", *table(("argument", "meaning"), rows)] if rows else []


def argument(action: argparse.Action) -> str:
    """An argument as it is written, in brackets when it may be left out."""
    value = action.metavar if isinstance(action.metavar, str) else None
    if not action.option_strings:
        value = value or action.dest
        return {"?": f"[{value}]", "*": f"[{value} ...]", "+": f"{value} [{value} ...]"}.get(
            str(action.nargs), value
        )
    name = action.option_strings[-1]
    text = name if action.nargs == 0 else f"{name} {value or action.dest.upper()}"
    return text if action.required else f"[{text}]"


def reference() -> dict[str, str]:
    """All files, by name."""
    pages = {
        **python_api(),
        **parameters(),
        **messages(),
        **scenarios(),
        **procedures(),
        **evidence(),
        "command-line": command_line(),
    }
    schemas = {f"{name}.schema.json": schema_text(name) for name in kinds()}
    return {f"{name}.md": text for name, text in pages.items()} | schemas
