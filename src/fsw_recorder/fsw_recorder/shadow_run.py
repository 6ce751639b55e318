"""Shows a recorded weld to a controller that runs as a process of its own, and records what it proposes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.weld_signals import REFERENCE_TOPICS, WeldSignals

_SENSORS = ("/fsw/depth", "/fsw/spindle_torque", "/fsw/thermocouple")
#: only kept with the proposals, so that the bag of the shadow can be drawn like any other
_KEPT = ("/fsw/plant/truth", "/fsw/supervisor/state", "/clock")
#: parameters of a node that are not the controller's business
_FOREIGN = ("use_sim_time", "start_type_description_service")
#: the controller's last diagnostics come after a second, the recorder's last chunk after half of one
_LAST_WORDS_S = 2.0
_TICK_S = 0.1


def _reference_of(weld: WeldSignals) -> str:
    return next((name for name in REFERENCE_TOPICS if weld.counts.get(name)), REFERENCE_TOPICS[0])


@dataclass(frozen=True, slots=True)
class ShadowRun:
    """A replay with one controller in shadow.

    Attributes
    ----------
    bag : Path
        The recorded weld.
    folder : Path
        Gets ``bag/`` and ``log/``; must not exist.
    controller : str
        Name of the controller.
    module : str
        Python module that runs it as a node.
    rate : float
        Weld time per wall time.
    duration_s : float
        How much of the weld; 0 for all of it.
    parameters : mapping
        Of the controller, on top of those it was recorded with.
    """

    bag: Path
    folder: Path
    controller: str
    module: str
    rate: float = 5.0
    duration_s: float = 0.0
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def recorded(self) -> Path:
        """Bag of what was shown and proposed."""
        return self.folder / "bag"

    def run(self, weld: WeldSignals, progress: Callable[[float], None] | None = None) -> None:
        """Start recorder, controller and replay in a ROS domain of their own, and end them when the bag is played.

        Parameters
        ----------
        weld : WeldSignals
            The recorded weld, already read.
        progress : callable, optional
            Called with the fraction done, 0 to 1, as estimated from the time passed.

        Raises
        ------
        BagError
            The bag lacks what a controller needs, the folder exists, or a process fails.
        """
        from fsw_control.free_domain import NoFreeDomainError, free_domain
        from fsw_experiment.launcher import Launcher, LaunchError

        missing = [name for name in (*_SENSORS, _reference_of(weld)) if not weld.counts.get(name)]
        if missing:
            raise BagError(f"{self.bag}: cannot be shown to a controller, it has no {', '.join(missing)}")
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError:
            raise BagError(f"{self.folder}: exists already; give another folder with --out") from None
        except OSError as error:
            raise BagError(f"{self.folder}: cannot be made: {error.strerror}") from None
        parameter_file = self.folder / "parameters.yaml"
        parameter_file.write_text(yaml.safe_dump(self._parameter_file(weld), sort_keys=False), encoding="utf-8")
        ros_args = ["--ros-args", "--params-file", str(parameter_file)]
        length_s = weld.duration_s if self.duration_s <= 0.0 else min(self.duration_s, weld.duration_s)
        try:
            with free_domain() as domain, Launcher(self.folder / "log", domain) as launcher:
                launcher.start("recorder", "fsw_recorder.recorder_node", ros_args)
                launcher.start("controller", self.module, ros_args)
                launcher.wait_for_text("recorder", f"subscribed to /fsw/{self.controller}/proposal")
                replay = launcher.start("replay", "fsw_recorder.replay_node", ros_args)
                launcher.wait_for_text("replay", "playing ", 60.0)
                begin = time.monotonic()

                def played() -> bool:
                    if progress is not None and length_s > 0.0:
                        progress(min((time.monotonic() - begin) * self.rate / length_s, 0.99))
                    return not replay.running

                others = ["recorder", "controller"]
                launcher.wait_until(played, 60.0 + 5.0 * length_s / self.rate, "the end of the replay", others)
                if replay.process.returncode != 0:
                    raise BagError(f"{self.bag}: replay failed: {replay.last_words()}")
                over = time.monotonic() + _LAST_WORDS_S
                launcher.wait_until(lambda: time.monotonic() > over, 60.0, "the last proposal", others)
        except (LaunchError, NoFreeDomainError) as error:
            raise BagError(f"{self.bag}: shadow replay failed: {error}") from None
        if progress is not None:
            progress(1.0)

    def _parameter_file(self, weld: WeldSignals) -> dict[str, Any]:
        with BagReader(self.bag) as reader:
            present = reader.topics()
        wanted = (*_SENSORS, _reference_of(weld), "/fsw/command")
        shown = [name for name in wanted if name in present and present[name].count]
        kept = [name for name in _KEPT if name in present and present[name].count]
        nodes: dict[str, dict[str, Any]] = {
            "fsw_replay": {
                "bag": str(self.bag.resolve()),
                "topics": shown + kept,
                "rate": float(self.rate),
                # ends between two ticks, so that the last one is whole
                "duration": max(self.duration_s - 0.5 * _TICK_S, 0.0),
                "wait_for": [*shown, *shown],  # the controller and the recorder
            },
            "fsw_recorder": {
                "output": str(self.recorded.resolve()),
                "topics": [*shown, *kept, "/diagnostics"],
                "regex": f"/fsw/{self.controller}/.*",
                "custom_data": [f"shadow_of={self.bag.name}", f"shadow_rate={self.rate:g}"],
            },
            f"fsw_{self.controller}": {**self._recorded_parameters(weld), **self.parameters, "use_sim_time": True},
        }
        scenario = weld.attachments.get("scenario.yaml")
        if scenario is not None:
            path = self.folder / "scenario.yaml"
            path.write_bytes(scenario)
            nodes["fsw_recorder"]["scenario"] = str(path.resolve())
        return {name: {"ros__parameters": values} for name, values in nodes.items()}

    def _recorded_parameters(self, weld: WeldSignals) -> dict[str, Any]:
        """Parameters that the controller was recorded with; else where it has to begin."""
        name = f"fsw_{self.controller}"
        data = weld.attachments.get(f"parameters/{name}.yaml")
        if data is not None:
            try:
                values = yaml.safe_load(data)[f"/{name}"]["ros__parameters"]
                return {str(key): value for key, value in values.items() if key not in _FOREIGN}
            except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError):
                pass  # as if the controller was not in the bag
        for force, speed in zip(weld.force_kn.tolist(), weld.speed_rpm.tolist(), strict=True):
            if math.isfinite(force) and math.isfinite(speed):
                return {"initial_force": force, "initial_speed": speed}
        return {}
