"""Which process a weld has, from what its bag holds."""

from __future__ import annotations

import yaml

from fsw_analysis.weld_signals import WeldSignals
from fsw_schema.yaml_text import load_yaml


def process_of(signals: WeldSignals) -> str:
    """``canister`` if the scenario in the bag says so, or the bag is of a machine; else ``paper``."""
    text = signals.attachments.get("scenario.yaml")
    if text is None:
        return "paper" if signals.truth is not None else "canister"
    try:
        plant = load_yaml(text.decode("utf-8", "replace"))["plant"]
        return "canister" if plant["process"] == "canister" else "paper"
    except (yaml.YAMLError, KeyError, TypeError):
        return "paper"
