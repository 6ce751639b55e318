"""Options of a weld in the graph, as arguments of the launch file, and the graph they describe."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import Field, model_validator

from fsw_control.schema.models import (
    InputError,
    Model,
    Whole,
    content_of,
    descriptions,
    problem,
    validate,
)
from fsw_control.schema.ranges import Range
from fsw_scenario import procedure
from fsw_scenario.controllers import variants_of
from fsw_scenario.graph import WeldGraph
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, shipped, with_controller

_FLAG = ("true", "True", "false", "False")
#: programs that are managed nodes
_MANAGED = ("fsw_plant", "fsw_machine", "fsw_recorder")


class WeldOptions(Model):
    """Options of a weld; by default plant, controllers and supervisors run, controlled by hand."""

    controllers: str = "decentral,nmpc"
    """Controllers that run, separated by commas; the first is applied at the start unless the
    scenario swaps them; your own: MODULE:CLASS or FILE.py:CLASS"""
    machine: str = ""
    """Machine file: the gateway to this machine runs instead of the emulated plant; empty: the
    plant"""
    scenario: str = Field(
        "",
        description=f"Scenario to play: path of a YAML file, or one of {', '.join(shipped())}; "
        "empty: control by hand",
    )
    record: bool = False
    """Whether a recorder runs"""
    bag_dir: str = ""
    """Folder of the bag, must not exist; empty: out/weld_<date>-<time>. A restarted recorder
    continues beside it, in <folder>_1"""
    procedure: str = Field(
        "",
        description="Welding procedure: YAML file, or one of "
        f"{', '.join(procedure.shipped())}. Interlocks, limits of commands and the page's bands "
        "follow from it, deviations are reported on /diagnostics, and the weld's record is "
        "written into the bag's folder; empty: none",
    )
    require_signed: bool = False
    """Whether an unsigned procedure is refused"""
    trusted: str = ""
    """Keys whose signatures of a procedure count: public key or list of them (YAML); empty: any"""
    standby: bool | None = None
    """Whether a second supervisor runs on standby and takes over when the first dies; empty: in
    real time"""
    heat: str = ""
    """Heat profile of the type of weld, from fsw.py learn (YAML); the player publishes it; empty:
    none"""
    monitor: bool = False
    """Whether the monitor watches the weld and names causes and advice"""
    model_file: str = ""
    """Model of this machine (YAML), for the monitor; empty: the paper's"""
    covariance_file: str = ""
    """Covariance of that model, as `identify --covariance` writes it; empty: wide enough for a
    model within 10 %"""
    hmi: bool = False
    """Whether the operator's page is served; its address and a token are printed"""
    hmi_port: Annotated[Whole, Range(0, 65535, "")] = 8080
    """Port of the operator's page; 0: any free one"""
    realtime: bool = True
    """true: 10 Hz on the wall clock; false: simulated time"""
    speed: Annotated[float, Range(0.0, 1000.0, "")] | None = None
    """Pace of simulated time against the wall clock, 0: lockstep; empty: lockstep unless
    realtime"""
    namespace: str = ""
    """Namespace of all nodes and topics but /clock and /diagnostics"""
    params_file: str = ""
    """Parameter file that overrides config/weld.yaml and the scenario"""
    autostart: bool = True
    """Whether the managed nodes (plant, gateway, recorder) configure and activate themselves;
    false: they wait for `ros2 lifecycle set`"""
    log_level: Literal[
        "debug", "info", "warn", "error", "fatal", "DEBUG", "INFO", "WARN", "ERROR", "FATAL"
    ] = "info"
    """Log level of all nodes"""

    @classmethod
    def arguments(cls) -> Iterator[tuple[str, str, str, list[str] | None]]:
        """Name, default, description and choices (None: any) of each option, as texts."""
        for name, field in cls.model_fields.items():
            kind, default = field.annotation, field.default
            default = str(default).lower() if isinstance(default, bool) else str(default or "")
            choices = get_args(kind) if get_origin(kind) is Literal else ()
            if bool in (kind, *get_args(kind)):
                choices = _FLAG if default else ("", *_FLAG)
            yield name, default, " ".join(descriptions(cls)[name].split()), [*choices] or None

    @classmethod
    def from_texts(cls, texts: Mapping[str, str]) -> Self:
        """Options from their texts; an empty one stands for the default.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a value is invalid, or values contradict each other.
        """
        content = {
            name: text
            if isinstance(cls.model_fields[name].default, str)
            else content_of(text, name)
            for name, text in texts.items()
        }
        return validate(cls, content, "weld")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.machine and not self.in_real_time:
            raise problem("runs in real time; leave realtime and speed as they are", "machine")
        if self.machine and self.scenario:
            raise problem("excludes a scenario, which needs the emulated plant", "machine")
        if self.require_signed and not self.procedure:
            raise problem("needs a procedure", "require_signed")
        return self

    @property
    def pace(self) -> float:
        """Pace of simulated time against the wall clock; 0: lockstep."""
        return float(self.realtime) if self.speed is None else self.speed

    @property
    def in_real_time(self) -> bool:
        """Whether the wall clock is the weld's."""
        return self.realtime and self.pace == 1.0

    def graph(self, folder: Path) -> WeldGraph:
        """The graph, with its files in a folder.

        Raises
        ------
        fsw_control.schema.models.InputError
            If a controller, a file or the procedure cannot be used, or the bag exists.
        """
        # launch_ros only warns of a parameter file that is missing, and welds without it
        for name in ("machine", "params_file"):
            if (file := getattr(self, name)) and not _path(file).is_file():
                raise InputError(f"{name}: there is no file {file}")
        labels = (label.strip() for label in self.controllers.split(","))
        variants = variants_of(filter(None, labels))
        if not variants:
            raise InputError("controllers: at least one is needed, e.g. controllers:=decentral")
        scenario = None
        if self.scenario:
            scenario = with_controller(load(_path(self.scenario)), next(iter(variants)))
        companions = {"monitor": self.monitor, "hmi": self.hmi, "procedure": bool(self.procedure)}
        return WeldGraph(
            scenario,
            folder,
            list(variants),
            realtime=self.in_real_time,
            record=self.record,
            standby=self.in_real_time if self.standby is None else self.standby,
            parameters=variants,
            companions=[name for name, runs in companions.items() if runs],
            derived=self._derived(scenario),
            machine=bool(self.machine),
            speed=self.pace,
            heat=_path(self.heat) if self.heat else None,
        )

    def _derived(self, scenario: Scenario | None) -> dict[str, dict[str, Any]]:
        """Parameters by node that follow from the options."""
        nodes = defaultdict[str, dict[str, Any]](dict)
        if self.procedure:
            trusted = [Path(self.trusted)] if self.trusted else []
            procedure.check_signed(self.procedure, trusted, self.require_signed)
            nodes |= procedure.graph_parameters(self.procedure)
        nodes["fsw_recorder"]["output"] = ""
        if self.bag_dir:
            bag = _path(self.bag_dir)
            if self.record and bag.exists():
                raise InputError(f"bag_dir: {bag} exists already; choose another or remove it")
            nodes["fsw_recorder"] |= {"number_if_taken": True, "output": str(bag)}
        nodes["fsw_hmi"]["port"] = self.hmi_port
        on_canister = self.machine or (scenario is not None and scenario.on_canister)
        nodes["fsw_monitor"]["process"] = "canister" if on_canister else "paper"
        for name in ("model_file", "covariance_file"):
            if file := getattr(self, name):
                nodes["fsw_monitor"][name] = str(_path(file).absolute())
        if self.machine:
            nodes["fsw_machine"]["machine_file"] = str(_path(self.machine).resolve())
        if not self.autostart:
            for name in _MANAGED:
                nodes[name]["autostart"] = False
        return nodes


def _path(text: str) -> Path:
    return Path(text).expanduser()
