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
from fsw_plant.parameters import PlantParameters
from fsw_scenario.closed_loop import plant_of
from fsw_scenario.controllers import program
from fsw_scenario.launcher import Child, Launcher, LaunchError
from fsw_scenario.open_loop import OpenLoopController
from fsw_scenario.scenario import Scenario
from fsw_schema.files import write_whole

#: node name of the standby supervisor
STANDBY = "fsw_supervisor_standby"
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


@dataclass(slots=True)
class WeldGraph:
    """All processes of a scenario."""

    scenario: Scenario
    #: for ``scenario.yaml``, ``parameters.yaml``, ``log/`` and, with ``record``, ``bag/``; created
    #: if necessary
    folder: Path
    controllers: Sequence[str] = ()  #: running controllers by name; the scenario's are added
    realtime: bool = False  #: 10 Hz on the wall clock instead of lockstep
    record: bool = True  #: whether a recorder runs
    standby: bool = False  #: whether a second supervisor stands by
    #: parameters of the controllers' nodes, by name of the controller; others have their default
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    #: further processes, by name the module of their node; the first tick does not wait for them
    companions: Mapping[str, str] = field(default_factory=dict)
    #: further parameters by node: of companions, or derived from a welding procedure
    derived: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    heat: Path | None = None  #: heat profile of the type of weld, for the player to publish

    @property
    def bag(self) -> Path:
        """Folder of the bag."""
        return self.folder / "bag"

    @property
    def all_controllers(self) -> list[str]:
        """Names of the running controllers, the initially selected one first."""
        if self.scenario.open_loop:
            return [OpenLoopController.name]
        return list(dict.fromkeys([*self.scenario.controllers, *self.controllers]))

    def start(self, launcher: Launcher) -> Child:
        """Start all processes; the plant's first tick waits for the others. Returns the player.

        Raises
        ------
        fsw_schema.models.InputError
            If a controller is not known.
        """
        programs = {name: program(name) for name in self.all_controllers}
        self.folder.mkdir(parents=True, exist_ok=True)
        scenario_file = self.folder / "scenario.yaml"
        write_whole(scenario_file, self.scenario.text)
        parameter_file = self.folder / "parameters.yaml"
        write_whole(
            parameter_file, yaml.safe_dump(self.parameter_file(scenario_file), sort_keys=False)
        )
        ros_args = ["--ros-args", "--params-file", str(parameter_file)]
        if self.record:
            launcher.start("recorder", "fsw_recorder.recorder_node", ros_args)
        launcher.start("plant", "fsw_plant.plant_node", ros_args)
        for name, (package, executable, words) in programs.items():
            launcher.start(name, f"{package}.{executable}_node", [*words, *ros_args])
        launcher.start("supervisor", "fsw_supervisor.supervisor_node", ros_args)
        if self.standby:
            renamed = [*ros_args, "-r", f"__node:={STANDBY}"]
            launcher.start("standby", "fsw_supervisor.supervisor_node", renamed)
        for name, module in self.companions.items():
            launcher.start(name, module, ros_args)
        return launcher.start("scenario", "fsw_scenario.scenario_node", ros_args)

    def parameter_file(self, scenario_file: Path) -> dict[str, Any]:
        """Content of the parameter file with the parameters of each node."""
        start = plant_of(self.scenario).applied
        names = self.all_controllers
        plant = validate(PlantParameters, self.scenario.plant)
        nodes: dict[str, dict[str, Any]] = {
            "fsw_plant": {
                **{name: plant[name] for name in self.scenario.plant},
                "scenario": str(scenario_file),
                "wait_for_subscribers": len(names)
                + 2
                + self.record
                + self.standby,  # and supervisor and player
                **({} if self.realtime else {"clock": "simulated", "speed": 0.0}),
            },
            "fsw_supervisor": {"controller": names[0]},
            "fsw_scenario": {
                "scenario": str(scenario_file),
                "wait_for_controllers": len(names),
                **({} if self.heat is None else {"heat_file": str(self.heat.absolute())}),
            },
            "fsw_recorder": {
                "output": str(self.bag),
                "scenario": str(scenario_file),
                **(
                    {"number_if_taken": True} if self.realtime else {}
                ),  # one that died goes on beside its bag
            },
        }
        for name in names:
            nodes[f"fsw_{name}"] = {
                "initial_force": start.force_kn,
                "initial_speed": start.speed_rpm,
            }
            nodes[f"fsw_{name}"] |= self.parameters.get(name, {})
        for name, values in self.derived.items():
            nodes[name] = nodes.get(name, {}) | dict(values)
        if self.scenario.open_loop:
            nodes["fsw_open_loop"] |= {
                "scenario": str(scenario_file),
                "from_first_tick": self.realtime,
            }
        if self.standby:
            nodes[STANDBY] = nodes["fsw_supervisor"] | {"standby": True}
        if not self.realtime:
            answers = [f"fsw/{name}/{topic}" for name in names for topic in ("proposal", "status")]
            nodes["fsw_recorder"]["wait_for_topics"] = [
                "fsw/command",
                "fsw/supervisor/state",
                *answers,
            ]
            for name, values in nodes.items():
                if name != "fsw_plant":
                    values["use_sim_time"] = True
                if name in ("fsw_supervisor", STANDBY):
                    values |= dict.fromkeys(
                        ("lockstep_deadline_s", "lockstep_shadow_wait_s"), _LOCKSTEP_S
                    )
        return {name: {"ros__parameters": values} for name, values in nodes.items()}

    def run(self, launcher: Launcher, progress: Callable[[float], None] | None = None) -> float:
        """Start all processes, wait for the scenario's end, end all.

        Returns the wall time from the first tick to the last [s], as measured by the player.
        ``progress`` is called with the completed share, 0 to 1.

        Raises
        ------
        LaunchError
            If a process ends too early or there is no progress.
        """
        player = self.start(launcher)
        others = [name for name in launcher.children if name != "scenario"]
        launcher.wait_until(player.status, _PATIENCE_S, "the first tick", others)

        def over() -> bool:
            if progress is not None:
                progress(player.status()["tick"] / self.scenario.n_ticks)
            return not player.running

        launcher.wait_until(
            over, _PATIENCE_S + 3.0 * self.scenario.duration_s, "the scenario's end", others
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
        for (
            name,
            code,
        ) in codes.items():  # most often a process was slow, and has been ended by a signal
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
