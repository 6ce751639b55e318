"""A controller of a user's own, in a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from fsw_scenario import controllers

OWN = """
from fsw_control import Command, Diagnosis, Proposal

class Own:
    name = "own"
    tolerated_sensors = ()
    def step(self, measurement, reference, applied, dt_s):
        {step}
    def reset(self, applied):
        pass

class Idle(Own):
    name = "idle"
    variant = "pace"

nameless = Own()
broken_name = type("Broken", (Own,), {{"name": "two words"}})
"""


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test names by its class is forgotten after it."""
    monkeypatch.setattr(controllers, "KNOWN", dict(controllers.KNOWN))
    controllers.class_at.cache_clear()


def own(folder: Path, step: str = "return Proposal(applied)") -> str:
    """Write a controller with this step into a folder; returns its label."""
    (folder / "own.py").write_text(OWN.format(step=step))
    return f"{folder}/own.py:Own"
