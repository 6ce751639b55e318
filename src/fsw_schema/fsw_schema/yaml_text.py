"""Reads YAML as people write it: ``1e300`` is a number, no key is given twice, and all errors are of one kind."""

from __future__ import annotations

import re
from typing import Any

import yaml

#: longer texts could be nested so deep that libyaml crashes
_SHORT = 20_000


class _AsWritten(yaml.constructor.SafeConstructor, yaml.resolver.Resolver):
    """``1e5`` is a number, as in YAML 1.2 and ROS, and a key given twice is refused."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str | int | float | bool | None):
                raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is not a name", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


_AsWritten.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


class _Loader(_AsWritten, yaml.SafeLoader):
    """Reads any text, and says what is wrong with it."""


class _FastLoader(_AsWritten, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Reads by libyaml, in an eighth of the time: a node reads some files when it starts."""


def load_yaml(text: str) -> Any:
    """Content of YAML text.

    Raises
    ------
    yaml.YAMLError
        It is not valid, also where a date is none or lists are nested too deep.
    """
    if len(text) < _SHORT:
        try:
            return yaml.load(text, Loader=_FastLoader)
        except (yaml.YAMLError, ValueError, RecursionError):
            pass  # the other one says more clearly what is wrong
    try:
        return yaml.load(text, Loader=_Loader)
    except (ValueError, RecursionError) as error:
        raise yaml.YAMLError(str(error) or "nested too deep") from None
