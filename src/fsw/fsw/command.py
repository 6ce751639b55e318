"""Declaration of commands by ``@command`` above their function, with uniform options."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from fsw.errors import CommandError, program
from fsw_control.schema.extensions import Extra
from fsw_control.schema.ranges import Range
from fsw_control.schema.yaml_text import load_yaml

if TYPE_CHECKING:
    from securesystemslib.signer import CryptoSigner  # from the extra signing

    from fsw_recorder.signature import TrustedKey

Run = Callable[[argparse.Namespace], int]
#: adds itself to a parser
Option = Callable[[argparse.ArgumentParser], object]


@dataclass(frozen=True, slots=True)
class Command:
    """A command, or a group without ``run``; ``main`` builds the parser from all of a module."""

    name: str  #: all words, e.g. ``bag kpi``
    text: str  #: description in the list of commands
    description: str
    options: Sequence[Option] = ()
    run: Run | None = None
    usage: str | None = None
    needs: Extra | None = None  #: installed at first use in a clone of the repository

    def __call__(self, arguments: argparse.Namespace) -> int:
        """Run it; MissingExtraError if its extra is not installed."""
        if self.needs is not None:
            self.needs.need(self.name.split()[0])
        return self.run(arguments) if self.run else 2


def command(
    name: str,
    text: str,
    *options: Option,
    description: str = "",
    usage: str | None = None,
    needs: Extra | None = None,
) -> Callable[[Run], Command]:
    """Turn a function that returns the exit code into a command; texts say ``fsw.py``."""
    return lambda run: Command(
        name, text, description or _sentence(name, text), options, run, usage, needs
    )


def group(name: str, text: str, description: str = "") -> Command:
    """Commands whose names begin with this command's."""
    return Command(name, text, description or _sentence(name, text))


def _sentence(name: str, text: str) -> str:
    return f"{name.split()[-1]}: {text}."


def as_typed(text: str) -> str:
    """A text with the program name as typed by the user."""
    return text.replace("fsw.py ", f"{program()} ")


def option(*flags: str, **settings: Any) -> Option:
    """An option or argument, as for :meth:`argparse.ArgumentParser.add_argument`."""

    def add(parser: argparse.ArgumentParser) -> None:
        parser.add_argument(*flags, **settings | {"help": as_typed(settings.get("help", ""))})

    return add


def switch(flag: str, text: str) -> Option:
    """An option without a value."""
    return option(flag, action="store_true", help=text)


def file(flag: str, text: str, metavar: str = "FILE", **more: Any) -> Option:
    """An option that takes a path."""
    return option(flag, type=Path, metavar=metavar, help=text, **more)


#: formats of figures, by the ending of their file's name
PICTURES = (".png", ".svg", ".pdf")
_FORMATS = [ending[1:] for ending in PICTURES]


#: of commands that write several figures into a folder
FORMAT = option(
    "--format",
    choices=_FORMATS,
    help="of the figures in the folder (default png)",
)

#: of reports, whose figures are in the page
FORMAT_BESIDE = option(
    "--format",
    choices=_FORMATS,
    help="also write the figures as files beside the page, in this format",
)


def picture_file(text: str) -> Path:
    """Name of a figure's file."""
    if Path(text).suffix.lower() not in PICTURES:
        raise argparse.ArgumentTypeError(
            f"{text}: the name must end in {', '.join(PICTURES[:-1])} or {PICTURES[-1]}"
        )
    return Path(text)


def picture(flag: str, text: str, **more: Any) -> Option:
    """An option that takes the name of a figure's file."""
    return option(
        flag, type=picture_file, metavar="FILE.png", help=f"{text}; .png, .svg or .pdf", **more
    )


def repeated(flag: str, metavar: str, text: str, **more: Any) -> Option:
    """An option that may be given several times; a list, empty by default."""
    return option(
        flag, action="append", default=[], metavar=metavar, help=f"{text}; may be repeated", **more
    )


def number(
    flag: str,
    metavar: str,
    allowed: Range,
    text: str,
    default: float | None = None,
    kind: type[float] = float,
) -> Option:
    """An option with a number in a range, given in errors; ``kind`` is int for whole numbers."""

    def read(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number ({allowed})") from None
        if complaint := allowed.complaint(value):
            raise argparse.ArgumentTypeError(complaint)
        return value

    return option(flag, metavar=metavar, type=read, default=default, help=text)


def assignment(option: str, text: str) -> tuple[str, Any]:
    """Name and value (YAML) of an argument NAME=VALUE."""
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise CommandError(f"{option} {text}: write NAME=VALUE")
    try:
        return name.strip(), load_yaml(value)
    except yaml.YAMLError:
        return name.strip(), value


def assigned(option: str, texts: Sequence[str], form: str = "NAME=VALUE") -> dict[str, str]:
    """Texts by name of an option's arguments NAME=TEXT; ``form`` says how to write them."""
    values: dict[str, str] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if not (name and value):
            raise CommandError(f"{option} {text}: write {form}")
        if values.setdefault(name, value) != value:
            raise CommandError(f"{option}: {name} is given twice")
    return values


def parameter(text: str) -> Option:
    """``--parameter``, of a node that computes in a command; see :func:`parameters_by_node`."""
    return repeated("--parameter", "[NODE.]NAME=VALUE", text)


def parameters_by_node(
    texts: Sequence[str], nodes: Sequence[str], known: Container[str] = ()
) -> dict[str, dict[str, Any]]:
    """Values of ``--parameter`` by node, e.g. ``nmpc.preset=paper``.

    The node may be left out where only one computes; one of ``known`` that does not is named, too.
    """
    parameters: dict[str, dict[str, Any]] = {}
    for text in texts:
        key, value = assignment("--parameter", text)
        node, _, name = key.partition(".")
        if node not in nodes and node not in known:
            if len(nodes) != 1:
                nodes_here = ", ".join(nodes) or "none"
                raise CommandError(
                    f"--parameter {text}: write NODE.NAME=VALUE; nodes are {nodes_here}"
                )
            node, name = nodes[0], key
        parameters.setdefault(node, {})[name] = value
    return parameters


FORCE = switch("--force", "replace files that exist; keep an earlier folder as FOLDER_1, ...")
#: options of all commands that use the graph
GRAPH = (
    number(
        "--timeout",
        "S",
        Range(0.1, 600.0, "s"),
        "maximum time to wait for an answer, 0.1 to 600 s (default 5)",
        5.0,
    ),
    option(
        "--namespace", metavar="NS", default="", help="of the weld, e.g. cell1 (default: none)"
    ),
)


# ---------------------------------------------------------------- signatures

PRIVATE_KEY = file("--key", "private key that signs (default: ~/.config/fsw-control/evidence_key)")
TRUSTED = repeated(
    "--trusted",
    "FILE",
    "public key of a trusted signer, or a list of them with purposes and validity (YAML)",
    type=Path,
)
REQUIRE_SIGNED = switch("--require-signed", "refuse a procedure and a manifest that nobody signed")
REQUIRE_SIGNED_PROCEDURE = switch("--require-signed", "refuse a procedure that nobody signed")


def private_key(arguments: argparse.Namespace) -> CryptoSigner:
    """The signing key of a command that signs."""
    from fsw_recorder import signature  # most commands neither sign nor verify

    return signature.load_private(arguments.key or signature.default_key())


def trusted_keys(arguments: argparse.Namespace, own: bool = False) -> tuple[TrustedKey, ...]:
    """The trusted keys, with that of the signing key if the user's ``own`` counts.

    An entry of a list prevails over it.
    """
    from fsw_recorder import signature

    key = getattr(arguments, "key", None) or signature.default_key()
    own_keys = [signature.public_path(key)] if own else []
    return signature.load_trusted([*own_keys, *arguments.trusted])
