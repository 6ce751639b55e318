"""Reads YAML and JSON written by people, with bounded time and memory.

``1e300`` is a number, no key may be given twice, and every error is one line. The length of the
text, the number of values and the depth of nesting are limited. An alias (``*name``) counts as
all the values that it stands for: a few nested ones would otherwise exceed the memory ("billion
laughs"). :mod:`fsw_control.schema.files` limits what is read from a path.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import yaml
from pydantic_core import from_json

from fsw_control.schema.errors import InputError

#: limits of a YAML text: the largest file of the project has 400 lines in 7 levels
LONGEST_TEXT = 2_000_000
MOST_VALUES = 100_000
DEEPEST = 50
_LONGEST_NUMBER = 1_000
_LONGEST_PROBLEM = 200
_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
#: exceptions that PyYAML passes on for a value that does not fit its tag, e.g. ``!!bool 3`` or the
#: 31st of June
_OF_A_VALUE = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError)


class _Bounded(yaml.composer.Composer):
    """Composes a document during parsing, and stops at the first value beyond a limit.

    An alias counts as its full content, so the size of the result is limited for everyone who
    traverses it.
    """

    peek_event: Callable[[], yaml.Event]  # the parser's

    def begin(self) -> None:
        """Restart the count before anything is composed."""
        self.anchors: dict[str, yaml.Node] = {}
        self.values, self.depth, self.deepest = 0, 0, 0
        self._sizes: dict[str, tuple[int, int]] = {}  # by anchor: values and levels

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event, values_before, deepest_before = self.peek_event(), self.values, self.deepest
        anchor, is_alias = getattr(event, "anchor", None), isinstance(event, yaml.AliasEvent)
        values, levels = self._sizes.get(str(anchor), (1, 1)) if is_alias else (1, 1)
        self.values += values
        self.depth += 1
        self.deepest = self.depth + levels - 1
        problem = ""
        if self.values > MOST_VALUES:
            suffix = " with those of aliases" * is_alias
            problem = f"more than {MOST_VALUES} values{suffix}; write less into one file"
        elif self.deepest > DEEPEST:
            problem = f"nested deeper than {DEEPEST} levels; write it flatter"
        elif is_alias and anchor in self.anchors and anchor not in self._sizes:
            problem = f"alias *{anchor} is part of what it stands for; write the value out"
        if problem:
            mark = event.start_mark
            raise yaml.composer.ComposerError(None, None, problem, mark)  # type: ignore[arg-type]
        node = super().compose_node(parent, index)
        if anchor and not is_alias:
            self._sizes[anchor] = self.values - values_before, self.deepest - self.depth + 1
        self.depth -= 1
        self.deepest = max(self.deepest, deepest_before)
        return node


class _AsWritten(_Bounded, yaml.constructor.SafeConstructor, yaml.resolver.Resolver):
    """Accepts ``1e5`` as a number, as YAML 1.2 and ROS do, and rejects duplicate keys."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str | int | float | bool | None):
                problem = f"key {key!r:.60} is not a name"
                raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
            if key in seen:
                problem = f"key '{key!s:.60}' is given twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def _of_limited_length(construct: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Construct a number of limited length: base 60 takes quadratic time."""

    def checked(loader: Any, node: yaml.ScalarNode) -> Any:
        if len(node.value) > _LONGEST_NUMBER:
            problem = f"a number of more than {_LONGEST_NUMBER} characters"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return construct(loader, node)

    return checked


_AsWritten.add_implicit_resolver(
    _FLOAT,
    re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)
_AsWritten.add_constructor(_INT, _of_limited_length(_AsWritten.construct_yaml_int))
_AsWritten.add_constructor(_FLOAT, _of_limited_length(_AsWritten.construct_yaml_float))
#: libyaml's, where PyYAML has it, which takes a sixth of the time: nodes read files at start-up
_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_AsWritten, _Parser):  # type: ignore[misc]
    def __init__(self, stream: str) -> None:
        _Parser.__init__(self, stream)
        self.begin()


def load_yaml(text: str) -> Any:
    """Parse YAML text.

    Raises
    ------
    yaml.YAMLError
        If it is invalid, a value does not fit its type, or a limit is exceeded.
    """
    if len(text) > LONGEST_TEXT:
        raise yaml.YAMLError(f"longer than {LONGEST_TEXT} characters; write less into one file")
    try:
        return yaml.load(text, Loader=_Loader)
    except _OF_A_VALUE as error:
        raise yaml.YAMLError(str(error) or type(error).__name__) from None


def content_of(text: str, where: str) -> Any:
    """Parse YAML text of a user.

    Raises
    ------
    InputError
        If it is invalid, has a duplicate key or exceeds a limit; the message says where.
    """
    try:
        return load_yaml(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise InputError(
            f"{where}{line}: not valid YAML: {_one_line(error.problem or 'broken')}"
        ) from None
    except yaml.YAMLError as error:
        raise InputError(f"{where}: not valid YAML: {_one_line(str(error))}") from None


def json_content_of(text: str, where: str) -> Any:
    """Parse JSON text of a user.

    Raises
    ------
    InputError
        If it is invalid or nested too deep, 200 levels; the message says where.
    """
    try:
        return from_json(text)
    except (ValueError, TypeError) as error:  # TypeError: it cannot be encoded
        raise InputError(f"{where}: not valid JSON: {_one_line(str(error))}") from None


def _one_line(problem: str) -> str:
    return " ".join(problem.split())[:_LONGEST_PROBLEM]
