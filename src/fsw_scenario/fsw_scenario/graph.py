"""The processes of a weld graph for a scenario, and their execution to its end."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from signal import Signals
from typing import Any

import yaml

from fsw_control.parameters import validate
from fsw_control.schema.files import write_whole
from fsw_plant.parameters import PlantParameters
from fsw_scenario.controllers import program
from fsw_scenario.launcher import Child, Launcher, LaunchError
from fsw_scenario.plants import plant_of
from fsw_scenario.scenario import Scenario
from fsw_scenario.timeline import OpenLoopController

#: node name of the standby supervisor
STANDBY = "fsw_supervisor_standby"
#: processes that cannot be restarted during a weld, so that their end is its end
ONCE = ("plant", "scenario")
#: time limit for the first tick, and for the end after the scenario's duration
_PATIENCE_S = 240.0
#: time for which lockstep waits for controllers, so that a stalled machine gives the same weld
_LOCKSTEP_S = 30.0
_SUPERVISOR_SECTION = re.compile(
    r"^(\s*[\"']?(?:[^#\s:\"']*/)?)fsw_supervisor([\"']?\s*:)", re.MULTILINE
)


def for_standby(parameter_file: str) -> str:
    """Parameter file whose supervisor entries, in any namespace, apply to the standby instead."""
    return _SUPERVISOR_SECTION.sub(rf"\g<1>{STANDBY}\g<2>", parameter_file)


@dataclass(frozen=True, slots=True)
class Process:
    """A process of a weld graph."""

    name: str
    node: str  #: entry point in ``fsw.nodes``
    words: tuple[str, ...] = ()  #: its first arguments


@dataclass(slots=True)
class WeldGraph:
    """All processes of a weld and their parameters, for the launcher and for the launch file."""

    scenario: Scenario | None  #: None: control by hand
    #: for ``scenario.yaml``, ``parameters.yaml``, ``log/`` and, with ``record``, ``bag/``; created
    #: if necessary
    folder: Path
    controllers: Sequence[str] = ()  #: running controllers by name; the scenario's are added
    realtime: bool = False  #: 10 Hz on the wall clock instead of simulated time
    record: bool = True  #: whether a recorder runs
    standby: bool = False  #: whether a second supervisor stands by
    #: parameters of the controllers' nodes, by name of the controller; others have their default
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    #: further nodes; the first tick does not wait for them
    companions: Sequence[str] = ()
    #: further parameters by node: of companions, or derived from a welding procedure
    derived: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    machine: bool = False  #: whether the gateway to a machine runs instead of the emulated plant
    speed: float = 0.0  #: pace of simulated time against the wall clock; 0: lockstep
    heat: Path | None = None  #: heat profile of the type of weld, for the player to publish

    @property
    def bag(self) -> Path:
        """Folder of the bag."""
        return self.folder / "bag"

    @property
    def all_controllers(self) -> list[str]:
        """Names of the running controllers, the initially selected one first."""
        if self.scenario is None:
            return list(self.controllers)
        if self.scenario.open_loop:
            return [OpenLoopController.name]
        return list(dict.fromkeys([*self.scenario.controllers, *self.controllers]))

    @property
    def processes(self) -> list[Process]:
        """All processes in the order of their start, the player last.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a controller is not known.
        """
        plant = "machine" if self.machine else "plant"
        return [
            *([Process("recorder", "recorder")] if self.record else []),
            Process(plant, plant),
            *(Process(name, *program(name)) for name in self.all_controllers),
            Process("supervisor", "supervisor"),
            *([Process("standby", "supervisor")] if self.standby else []),
            *(Process(name, name) for name in self.companions),
            Process("scenario", "scenario"),
        ]

    def start(self, launcher: Launcher) -> Child:
        """Start all processes; the plant's first tick waits for the others. Returns the player.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a controller is not known.
        """
        processes = self.processes
        self.folder.mkdir(parents=True, exist_ok=True)
        scenario_file = self.folder / "scenario.yaml"
        if self.scenario is not None:
            write_whole(scenario_file, self.scenario.text)
        parameter_file = self.folder / "parameters.yaml"
        write_whole(
            parameter_file, yaml.safe_dump(self.parameter_file(scenario_file), sort_keys=False)
        )
        for process in processes:
            words = [*process.words, "--ros-args", "--params-file", str(parameter_file)]
            if process.name == "standby":
                words += ["-r", f"__node:={STANDBY}"]
            player = launcher.start(process.name, process.node, words)
        return player

    def parameter_file(self, scenario_file: Path) -> dict[str, Any]:
        """Content of the parameter file with the parameters of each node."""
        names, plays = self.all_controllers, self.scenario is not None
        listeners = len(names) + 1 + plays + self.record + self.standby  # 1: the supervisor
        nodes: dict[str, dict[str, Any]] = {
            "fsw_plant": {"wait_for_subscribers": listeners},
            "fsw_supervisor": {"controller": names[0]},
            "fsw_scenario": {
                "scenario": str(scenario_file) if plays else "",
                "wait_for_controllers": len(names),
                **({} if self.heat is None else {"heat_file": str(self.heat.absolute())}),
            },
            "fsw_recorder": {},
            **{f"fsw_{name}": {} for name in names},
        }
        if self.scenario is not None:
            self._add_scenario(nodes, self.scenario, scenario_file)
        if not self.realtime:
            nodes["fsw_plant"] |= {"clock": "simulated", "speed": self.speed}
        further = {f"fsw_{name}": self.parameters.get(name, {}) for name in names}
        for parameters in (further, self.derived):
            for name, values in parameters.items():
                nodes[name] = nodes.get(name, {}) | dict(values)
        if self.standby:
            nodes[STANDBY] = nodes["fsw_supervisor"] | {"standby": True}
        if not self.realtime:
            for name, values in nodes.items():
                if name != "fsw_plant":
                    values["use_sim_time"] = True
                if plays and name in ("fsw_supervisor", STANDBY):
                    values |= dict.fromkeys(
                        ("lockstep_deadline_s", "lockstep_shadow_wait_s"), _LOCKSTEP_S
                    )
        return {name: {"ros__parameters": values} for name, values in nodes.items()}

    def _add_scenario(
        self, nodes: dict[str, dict[str, Any]], scenario: Scenario, scenario_file: Path
    ) -> None:
        """Add the parameters that follow from a scenario."""
        start, names = plant_of(scenario).applied, self.all_controllers
        plant = validate(PlantParameters, scenario.plant)
        nodes["fsw_plant"] = {
            **{name: plant[name] for name in scenario.plant},
            "scenario": str(scenario_file),
            **nodes["fsw_plant"],
        }
        nodes["fsw_recorder"] |= {"output": str(self.bag), "scenario": str(scenario_file)}
        if self.realtime:  # a recorder that died continues beside its bag
            nodes["fsw_recorder"]["number_if_taken"] = True
        else:
            answers = [f"fsw/{name}/{topic}" for name in names for topic in ("proposal", "status")]
            topics = ["fsw/command", "fsw/supervisor/state", *answers]
            nodes["fsw_recorder"]["wait_for_topics"] = topics
        for name in names:
            nodes[f"fsw_{name}"] |= {
                "initial_force": start.force_kn,
                "initial_speed": start.speed_rpm,
            }
        if scenario.open_loop:
            nodes["fsw_open_loop"] |= {
                "scenario": str(scenario_file),
                "from_first_tick": self.realtime,
            }

    def run(self, launcher: Launcher, progress: Callable[[float], None] | None = None) -> float:
        """Start all processes, wait for the scenario's end, end all.

        Returns the wall time from the first tick to the last [s], as measured by the player.
        ``progress`` is called with the completed share, 0 to 1.

        Raises
        ------
        LaunchError
            If a process ends too early or there is no progress.
        """
        scenario = self.scenario
        assert scenario is not None
        player = self.start(launcher)
        others = [name for name in launcher.children if name != "scenario"]
        launcher.wait_until(player.status, _PATIENCE_S, "the first tick", others)

        def over() -> bool:
            if progress is not None:
                progress(player.status()["tick"] / scenario.n_ticks)
            return not player.running

        launcher.wait_until(
            over, _PATIENCE_S + 3.0 * scenario.duration_s, "the scenario's end", others
        )
        if not player.status()["finished"]:
            raise LaunchError(
                f"the scenario player failed: {player.last_lines()} (see {player.log})"
            )
        codes = launcher.stop("plant")  # first, so that the bag does not show the others leaving
        codes |= launcher.stop() | {"scenario": player.process.returncode}
        if codes.get("recorder", 0) > 0:  # the bag could not be written
            raise LaunchError(
                f"recorder has ended with exit code {codes['recorder']}; see {launcher.log_folder}"
            )
        # most often a process was slow, and has been ended by a signal
        for name, code in codes.items():
            if code:
                how = (
                    f"was ended by {Signals(-code).name}"
                    if code < 0
                    else f"has ended with exit code {code}"
                )
                print(
                    f"note: the weld is complete; {name} {how}; see {launcher.log_folder}",
                    file=sys.stderr,
                )
        return float(player.status()["wall_s"])
