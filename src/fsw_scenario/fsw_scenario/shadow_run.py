"""Shows a recorded weld to a controller that runs as a process of its own, and records what it proposes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fsw_analysis.messages import SENSOR_FIELDS, recorded_parameters
from fsw_analysis.set_points import HELD, SENT
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.free_domain import NoFreeDomainError, free_domain
from fsw_control.parameters import load, load_source, validate
from fsw_control.weld import TICK_S
from fsw_recorder.errors import BagError
from fsw_scenario.controllers import described_in, name_of, program, variant_of
from fsw_scenario.launcher import Launcher, LaunchError

_SENSORS = tuple(topic for topic, _ in SENSOR_FIELDS.values())
_DRIVES = "/fsw/drives"
#: shown to the controller where the bag has them
_SHOWN = (*_SENSORS, _DRIVES, SENT, HELD, "/fsw/command")
#: only kept with the proposals, so that the bag of the shadow can be drawn like any other
_KEPT = ("/fsw/plant/truth", "/fsw/supervisor/state", "/clock")
#: parameters of a node that are not the controller's business
_FOREIGN = ("use_sim_time", "start_type_description_service")
#: the controller's last diagnostics come after a second, the recorder's last chunk after half of one
_LAST_WORDS_S = 2.0
#: how long the processes may take to start, and to end
_PATIENCE_S = 60.0
#: a replay that takes so much longer than it should is stuck
_SLOWEST = 5.0


@dataclass(frozen=True, slots=True)
class ShadowRun:
    """A replay with one controller in shadow. A weld in a namespace is shown without it.

    Attributes
    ----------
    bag : Path
        The recorded weld.
    folder : Path
        Gets ``bag/`` and ``log/``; must not exist.
    controller : str
        Label of the controller, as of :func:`fsw_scenario.controllers.make`.
    rate : float
        Weld time per wall time.
    duration_s : float
        How much of the weld; 0 for all of it.
    parameters : mapping
        Of the controller, on top of those it was recorded with.

    Raises
    ------
    BagError
        The folder exists.
    """

    bag: Path
    folder: Path
    controller: str
    rate: float = 5.0
    duration_s: float = 0.0
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.folder.exists():
            raise self._taken()

    @property
    def name(self) -> str:
        """Name of the controller."""
        return name_of(self.controller)

    @property
    def recorded(self) -> Path:
        """Bag of what was shown and proposed."""
        return self.folder / "bag"

    def _taken(self) -> BagError:
        return BagError(f"{self.folder}: exists already; give another folder with --out")

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
        ParameterError
            A parameter of the controller is unknown or does not fit.
        """
        self._own_parameters()
        missing = [name for name in _SENSORS if not weld.counts.get(name)]
        missing += [] if weld.counts.get(SENT) or weld.counts.get(HELD) else [SENT]
        if missing:
            raise BagError(f"{self.bag}: cannot be replayed to a controller, it has no {', '.join(missing)}")
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError:
            raise self._taken() from None
        except OSError as error:
            raise BagError(f"{self.folder}: cannot be made: {error.strerror}") from None
        parameter_file = self.folder / "parameters.yaml"
        parameter_file.write_text(yaml.safe_dump(self.parameter_file(weld), sort_keys=False), encoding="utf-8")
        ros_args = ["--ros-args", "--params-file", str(parameter_file)]
        names = _played(weld)
        remaps = [
            word for name, recorded in names.items() if recorded != name for word in ("-r", f"{recorded}:={name}")
        ]
        length_s = weld.duration_s if self.duration_s <= 0.0 else min(self.duration_s, weld.duration_s)
        try:
            with free_domain() as domain, Launcher(self.folder / "log", domain) as launcher:
                launcher.start("recorder", "fsw_recorder.recorder_node", ros_args)
                package, executable, words = program(self.name)
                launcher.start("controller", f"{package}.{executable}_node", [*words, *ros_args])
                launcher.wait_for_text("recorder", f"subscribed to /fsw/{self.name}/proposal")
                replay = launcher.start("replay", "fsw_recorder.replay_node", [*ros_args, *remaps])
                launcher.wait_for_text("replay", "playing ", _PATIENCE_S)
                begin = time.monotonic()

                def played() -> bool:
                    if progress is not None and length_s > 0.0:
                        progress(min((time.monotonic() - begin) * self.rate / length_s, 0.99))
                    return not replay.running

                others, limit_s = ["recorder", "controller"], _PATIENCE_S + _SLOWEST * length_s / self.rate
                launcher.wait_until(played, limit_s, "the end of the replay", others)
                if replay.process.returncode != 0:
                    raise BagError(f"{self.bag}: replay failed: {replay.last_words()}")
                over = time.monotonic() + _LAST_WORDS_S
                launcher.wait_until(lambda: time.monotonic() > over, _PATIENCE_S, "the last proposal", others)
        except (LaunchError, NoFreeDomainError) as error:
            raise BagError(f"{self.bag}: shadow replay failed: {error}") from None

    def parameter_file(self, weld: WeldSignals) -> dict[str, Any]:
        """Content of the parameter file of the processes; writes the weld's scenario into the folder."""
        names = _played(weld)
        shown = [recorded for name, recorded in names.items() if name in _SHOWN]
        nodes: dict[str, dict[str, Any]] = {
            "fsw_replay": {
                "bag": str(self.bag.resolve()),
                "topics": list(names.values()),
                "rate": float(self.rate),
                # ends between two ticks, so that the last one is whole
                "duration": max(self.duration_s - 0.5 * TICK_S, 0.0),
                # by the recorder and, but for the drives, by every controller
                "wait_for": [*shown, *(name for name in shown if not name.endswith(_DRIVES))],
            },
            "fsw_recorder": {
                "output": str(self.recorded.resolve()),
                "topics": [*names, "/diagnostics"],
                "regex": f"/fsw/{self.name}/.*",
                "custom_data": [f"shadow_of={self.bag.name}", f"shadow_rate={self.rate:g}"],
            },
            f"fsw_{self.name}": {**self._recorded_parameters(weld), **self._own_parameters(), "use_sim_time": True},
        }
        scenario = weld.attachments.get("scenario.yaml")
        if scenario is not None and self.folder.is_dir():
            path = self.folder / "scenario.yaml"
            path.write_bytes(scenario)
            nodes["fsw_recorder"]["scenario"] = str(path.resolve())
        return {name: {"ros__parameters": values} for name, values in nodes.items()}

    def _own_parameters(self) -> dict[str, Any]:
        """Parameters of the controller that are given, checked."""
        own = {**variant_of(self.controller), **self.parameters}
        validate(load("fsw_control", "controller.yaml") | load_source(described_in(self.controller)), own)
        return own

    def _recorded_parameters(self, weld: WeldSignals) -> dict[str, Any]:
        """Parameters that the controller was recorded with; else where it has to begin."""
        try:
            values = recorded_parameters(weld.attachments, weld.namespace, self.name)
            return {key: value for key, value in values.items() if key not in _FOREIGN}
        except BagError:
            pass  # the controller was not in the bag
        known = np.flatnonzero(np.isfinite(weld.force_kn) & np.isfinite(weld.speed_rpm))
        if not known.size:
            return {}
        return {"initial_force": float(weld.force_kn[known[0]]), "initial_speed": float(weld.speed_rpm[known[0]])}


def _played(weld: WeldSignals) -> dict[str, str]:
    """Topics that are played to the controller or the recorder, with their names in the bag."""
    names = (name for name in (*_SHOWN, *_KEPT) if weld.counts.get(name))
    return {name: name if name == "/clock" else f"{weld.namespace}{name}" for name in names}
