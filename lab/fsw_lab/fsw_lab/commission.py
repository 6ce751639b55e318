"""``fsw.py commission``.

Leads through the commissioning of a running graph, from a check to an acceptance test.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import yaml

import fsw
from fsw import __version__
from fsw.bags import data_sha256, read_weld
from fsw.command import GRAPH, command, file, number, option, switch
from fsw.console import ProgressBar, new_folder, write_text
from fsw.errors import SHOWN, CommandError, program
from fsw.welds import Weld
from fsw_analysis.changes import changes, part
from fsw_analysis.kpi import compute
from fsw_analysis.weld_signals import WeldSignals
from fsw_control import weld
from fsw_control.schema.models import InputError, content_of, read_text, validate
from fsw_control.schema.ranges import Range
from fsw_identification import report, summary
from fsw_lab.commissioning import (
    STEPS,
    Course,
    Guard,
    Outcome,
    Session,
    accept_rows,
    check_experiment,
    check_rows,
    identify_rows,
    margin_rows,
    outcome_of,
    tune_rows,
    write_report,
)
from fsw_lab.tune_command import EVALUATIONS, write_tunings
from fsw_model import ModelParameters
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, parse
from fsw_tuning.standard_cases import DEFAULT, TIGHT
from fsw_tuning.tune_decentral import BOUNDS, NAMES, robustness, start_of

#: the file by which commissioning is taken up again, and the report
_COURSE, _REPORT = "commission.yaml", "report.md"
#: ticks that the check listens to
_TICKS = 100
#: the experiment ends with a return to the operating point, which takes so long
_RETURN_S = 30.0
#: what to do when ticks were not commanded
_TOO_FAST = (
    "; where the graph cannot keep up with the emulator, "
    "start that with -p speed:=0.0, so that it waits"
)
_TUNINGS = ("conservative", "tight", "smith")


@command(
    "commission",
    "lead through the commissioning of a running graph: check, experiment, model, "
    "tuning, acceptance test",
    *GRAPH,
    file(
        "--out",
        "folder for bags, model, tunings and report; an earlier run in it is resumed",
        "DIR",
        required=True,
    ),
    option(
        "--controller",
        choices=("decentral", "nmpc"),
        default="decentral",
        help="to be accepted (default %(default)s)",
    ),
    option(
        "--tuning",
        choices=_TUNINGS,
        default=_TUNINGS[0],
        help="of decentral (default %(default)s)",
    ),
    option(
        "--experiment",
        metavar="SCENARIO",
        default="identify_closed_loop",
        help="steps of set-points, shipped or a YAML file, e.g. "
        "from fsw.py identify --design (default %(default)s)",
    ),
    option(
        "--acceptance",
        metavar="SCENARIO",
        default="acceptance",
        help="that of the last step (default %(default)s)",
    ),
    number(
        "--evaluations",
        "N",
        Range(1, 1_000_000, ""),
        "of the search, per tuning (default %(default)s: some minutes)",
        EVALUATIONS,
        int,
    ),
    number(
        "--drive-lag",
        "S",
        Range(0.0, 10.0, "s"),
        "time constant of the drives (default %(default)s s)",
        0.1,
    ),
    switch("--yes", "yes to every step, for scripts; leaves after one that fails"),
    description="Lead through "
    "commissioning: "
    f"{'; '.join(f'{name}: {step.text}' for name, step in STEPS.items())}. "
    "Every step is asked for: yes, no (refuse it and leave), quit, "
    "or the name of an earlier step to repeat. With the same --out it resumes where "
    "it was left. Nothing moves without a yes; Ctrl-C aborts a weld.",
)
def commission(arguments: argparse.Namespace) -> int:
    # errors in them are reported before anything is done
    for source in (arguments.experiment, arguments.acceptance):
        check_experiment(load(source))
    file: Path = arguments.out / _COURSE
    course = (
        validate(Course, content_of(read_text(file, "commission"), str(file)), str(file))
        if file.exists()
        else Course()
    )
    if not file.exists():
        new_folder(arguments, "commission")
    work = Work(arguments)
    session = Session(
        course,
        {name: getattr(work, name) for name in STEPS},
        (lambda question: "yes") if arguments.yes else _ask,
        partial(print, flush=True),
        work.save,
        SHOWN,
        work.warning,
    )
    work.save(course)
    done = session.run(once=arguments.yes)
    left = session.course.next
    print(
        f"\n{'commissioned' if done else f'left at {left}; the same command resumes there'}: "
        f"{arguments.out / _REPORT}"
    )
    return 0 if done else 1


def _ask(question: str) -> str:
    try:
        return input(question)
    except EOFError:
        print("", file=sys.stderr)
        return "quit"


class Work:
    """Carries the steps out; everything is in the folder ``--out``."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments = arguments
        self._folder: Path = arguments.out.resolve()
        self._model: Path = self._folder / "model.yaml"
        self._machine: Path = self._folder / "machine.yaml"
        self._tuned: Path = self._folder / "tuned"

    def save(self, course: Course) -> None:
        """Write the course and the report."""
        text = yaml.safe_dump(
            course.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=120
        )
        write_text(self._folder / _COURSE, text)
        words = (
            f"Of `{self._arguments.controller}` with fsw-control {__version__}, "
            f"by `{program()} commission`."
        )
        write_report(course, self._folder / _REPORT, words)

    def warning(self, step: str) -> str:
        """What a step is about to move."""
        if step == "apply":
            return (
                f"   {self._arguments.controller} gets another tuning: no jump, "
                "but it will control differently"
            )
        scenario = self.scenario(step)
        at = [
            (event.reference.depth_mm, event.reference.temperature_c)
            for event in scenario.events
            if event.reference
        ]
        depths, temperatures = (
            [value for value in column if value is not None] for column in zip(*at, strict=True)
        )
        span = ", ".join(
            f"{min(c):g} to {max(c):g} {u}"
            for c, u in ((depths, "mm"), (temperatures, "degC"))
            if c
        )
        return (
            f"   moves for {scenario.duration_s:g} s: set-points of {span}, "
            f"by {scenario.controller}; Ctrl-C aborts"
        )

    def check(self) -> Outcome:
        """Listen to the graph at rest."""
        from fsw_lab.commission_ros import listen

        needed = sorted({"decentral", self._arguments.controller})
        return outcome_of(check_rows(listen(self._arguments, _TICKS), needed), _now())

    def experiment(self) -> Outcome:
        """Weld the experiment."""
        from fsw_lab.commission_ros import weld as weld_it

        bag = self._new_bag("experiment")
        weld_it(self._arguments, self.scenario("experiment").text, bag, Guard())
        return outcome_of([], _now(), f"recorded to {bag.name}")

    def identify(self) -> Outcome:
        """Fit the model to the last experiment."""
        bag, lag_s = self._bag("experiment"), self._arguments.drive_lag
        with ProgressBar("identifying") as bar:
            fitted = fsw.identify(Weld(bag.name, read_weld(bag)), drive_lag_s=lag_s, progress=bar)
        write_text(self._model, self._origin(bag) + fitted.text)
        write_text(self._machine, self._origin(bag) + fitted.machine.text)
        (self._folder / "identification").mkdir(exist_ok=True)
        report.write(fitted, self._folder / "identification")
        notes = "; ".join(summary.remarks(fitted))
        return outcome_of(
            identify_rows(fitted.parameters, fitted.std),
            _now(),
            f"identification/report.html; {notes}",
        )

    def tune(self) -> Outcome:
        """Search for the tunings."""
        self._tuned.mkdir(exist_ok=True)
        model = ModelParameters.from_file(self._model)
        origin = self._origin(self._model)
        own = write_tunings(
            self._model,
            self._tuned,
            self._arguments.evaluations,
            origin,
            matched=True,
            machine_file=self._machine,
        )
        gains = {
            name: start_of(name, model).changed(**own.parameters[f"decentral:{name}"])
            for name in NAMES
        }
        robust = {name: robustness(own_gains, model) for name, own_gains in gains.items()}
        rows = tune_rows(robust, BOUNDS)
        if self._arguments.controller == "nmpc":
            rows += margin_rows(own.margins[DEFAULT], own.margins[TIGHT], model)
        return outcome_of(rows, _now(), "files in tuned")

    def apply(self) -> Outcome:
        """Set the gains of the decentralized controller.

        The NMPC must have been started with its file.
        """
        from fsw_lab.commission_ros import parameter, set_parameters

        if self._arguments.controller == "decentral":
            set_parameters(self._arguments, "fsw_decentral", self._parameters())
            note = f"in force until its restart; then give it --params-file {self._file()}"
        else:
            wanted = self._parameters()
            for name in ("model_file", "machine_file"):
                if parameter(self._arguments, "fsw_nmpc", name) != wanted[name]:
                    raise CommandError(
                        f"the NMPC was started with another {name}: start it with "
                        f"--params-file {self._file()}"
                    )
            note = f"it was started with {self._file()}"
        return outcome_of([], _now(), note)

    def accept(self) -> Outcome:
        """Weld the acceptance test, and compare it with the weld that the model predicts."""
        from fsw_lab.commission_ros import weld as weld_it

        scenario, bag, name = (
            self.scenario("accept"),
            self._new_bag("accept"),
            self._arguments.controller,
        )
        weld_it(self._arguments, scenario.text, bag, Guard())
        file = self._folder / "acceptance.yaml"
        write_text(file, scenario.text)
        plant = {"model_file": str(self._model)}
        predicted = fsw.simulate(file, name, plant=plant, parameters=self._parameters()).signals
        welded = cut(read_weld(bag), scenario)
        measured, usual = (compute(replace(part, truth=None)) for part in (welded, predicted))
        commands = list(zip(welded.command_source, welded.command_reason, strict=True))
        rows = accept_rows(measured, usual, commands, name)
        return outcome_of(
            rows, _now(), f"recorded to {bag.name}{'' if rows[0].good else _TOO_FAST}"
        )

    def scenario(self, step: str) -> Scenario:
        """The scenario of a step; the experiment returns to the operating point at its end."""
        if step == "accept":
            return load(self._arguments.acceptance, [f"controller={self._arguments.controller}"])
        made = load(self._arguments.experiment)
        content = content_of(made.text, made.name)
        rest = {"depth_mm": weld.DEPTH_MM, "temperature_c": weld.TEMPERATURE_C}
        content["events"].append({"at_s": made.duration_s, "reference": rest})
        return parse(
            yaml.safe_dump(content | {"duration_s": made.duration_s + _RETURN_S}), made.name
        )

    def _file(self) -> Path:
        """The parameter file of the controller."""
        by_name = {"nmpc": "nmpc.yaml", "decentral": f"decentral_{self._arguments.tuning}.yaml"}
        return self._tuned / by_name[self._arguments.controller]

    def _parameters(self) -> dict[str, Any]:
        content = content_of(read_text(self._file(), "tuning"), str(self._file()))
        return dict(content[f"fsw_{self._arguments.controller}"]["ros__parameters"])

    def _bags(self, step: str) -> list[Path]:
        return sorted(
            self._folder.glob(f"{step}_*"), key=lambda path: int(path.name.rpartition("_")[2])
        )

    def _bag(self, step: str) -> Path:
        if not (bags := self._bags(step)):
            raise CommandError(f"no bag of {step} in {self._folder}; repeat it")
        return bags[-1]

    def _new_bag(self, step: str) -> Path:
        return self._folder / f"{step}_{len(self._bags(step)) + 1}"

    def _origin(self, source: Path) -> str:
        """Comment that says where a file is from.

        What it was made of, its hash, when and by which software.
        """
        of = f"{source.name}, SHA-256 {data_sha256(source)}"
        return f"# Origin: {of}; {_now()}, fsw-control {__version__}, {program()} commission.\n"


def _now() -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S %Z")


def cut(signals: WeldSignals, scenario: Scenario) -> WeldSignals:
    """The ticks of a scenario, by its first change of a set-point.

    InputError when that is not in the bag.
    """
    first = [change.begin for change in changes(signals) if change.quantity.endswith("reference")]
    if not first:
        raise InputError(f"{signals.path}: the set-points do not change")
    begin = signals.time_s[first[0]] - scenario.events[0].at_s
    inside = (signals.time_s > begin - 1e-6) & (
        signals.time_s < begin + scenario.duration_s - 1e-6
    )
    ticks = inside.nonzero()[0]
    inner: WeldSignals = part(signals, slice(int(ticks[0]), int(ticks[-1]) + 1))
    return inner
