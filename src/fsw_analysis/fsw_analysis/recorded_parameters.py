"""Parameters of nodes as a bag has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from fsw_control.schema.yaml_text import load_yaml
from fsw_recorder.errors import BagError


def recorded_parameters(
    attachments: Mapping[str, bytes], namespace: str, controller: str
) -> dict[str, Any]:
    """Parameters that a controller's node was recorded with, among the attachments of a bag.

    Raises
    ------
    BagError
        The bag does not have them, or they cannot be read.
    """
    node = f"{namespace}/fsw_{controller}"
    data = attachments.get(f"parameters/{node.strip('/').replace('/', '.')}.yaml")
    if data is None:
        raise BagError(f"the bag has no parameters of {controller}")
    try:
        values = load_yaml(data.decode())[node]["ros__parameters"]
        return {str(key): value for key, value in values.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
        raise BagError(f"the parameters of {controller} in the bag cannot be read") from None
