"""Reads YAML as people write it: ``1e300`` is a number, and whatever is wrong is one kind of error."""

from __future__ import annotations

import re
from typing import Any

import yaml


class NumberLoader(yaml.SafeLoader):
    """Safe loader for which ``1e5`` is a number, as in YAML 1.2 and ROS; YAML 1.1 takes it for text."""


NumberLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def load_yaml(text: str, loader: type[yaml.SafeLoader] = NumberLoader) -> Any:
    """Content of YAML text.

    Raises
    ------
    yaml.YAMLError
        It is not valid, also where a date is none or lists are nested too deep.
    """
    try:
        return yaml.load(text, Loader=loader)
    except (ValueError, RecursionError) as error:
        raise yaml.YAMLError(str(error) or "nested too deep") from None
