"""``bag verify`` with a controller of one's own, and what it refuses."""

import sys
from pathlib import Path
from types import ModuleType

import pytest

from fsw.main import main
from fsw_control.contract import Command, Measurement, Proposal, Reference
from fsw_scenario.controllers import KNOWN


class Holder:
    """Proposes what was applied, as the made-up weld's controllers do not."""

    name = "nmpc"
    tolerated_sensors: tuple[str, ...] = ()

    def reset(self, applied: Command) -> None:
        """Nothing to forget."""

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        return Proposal(applied)


def test_verify(
    weld_bag: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    genuine: Path,
) -> None:
    module = ModuleType("own_controller")
    module.Holder = Holder  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "own_controller", module)
    monkeypatch.setitem(KNOWN, "nmpc", "own_controller:Holder")
    assert main(["bag", "verify", str(weld_bag), "--controller", "nmpc"]) == 1
    captured = capsys.readouterr()
    assert (
        "at tick 1" in captured.out and "no parameters" in captured.err and "nmpc" in captured.err
    )
    assert main(["bag", "verify", str(weld_bag), "--controller", "nobody"]) == 1
    error = capsys.readouterr().err
    assert "nobody is" in error and "available" in error
    assert main(["bag", "verify", str(weld_bag), "--controller", "own_controller:Nothing"]) == 1
    error = capsys.readouterr().err
    assert "own_controller:Nothing" in error and "not available" in error
    assert main(["bag", "verify", str(genuine / "mcap_default")]) == 1
    assert "no proposals" in capsys.readouterr().err
