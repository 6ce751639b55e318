"""Welding procedures in use: their files, what follows from them, differences, deviations."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from fsw_analysis.procedure import Procedure, tuning_sha256
from fsw_analysis.rule_book import Limit, Variable
from fsw_control.cause import Cause
from fsw_control.coded import Fact, Worded
from fsw_control.parameters import defaults
from fsw_control.schema.extensions import all_loaded
from fsw_control.schema.models import InputError, content_of, read_text, shipped_names, validate
from fsw_control.units import KW_PER_NM_RPM
from fsw_model import OperatingPointError, ProcessModel, nominal
from fsw_recorder import signature
from fsw_recorder.after_recording import BAG
from fsw_recorder.signature import Purpose, Signer, TrustedKey, load_trusted
from fsw_supervisor.parameters import SupervisorParameters

_SHIPPED = Path(__file__).parent / "procedures"


def shipped() -> list[str]:
    """Names of the shipped procedures."""
    return shipped_names(_SHIPPED)


def path_of(source: str | Path) -> Path:
    """The file that `load` reads."""
    path = Path(source).expanduser()
    return (
        _SHIPPED / f"{source}.yaml"
        if str(source) in shipped() and not path.is_file()
        else path.absolute()
    )


def load(source: str | Path) -> Procedure:
    """Read a procedure: a YAML file, or a shipped one by its name.

    Raises
    ------
    fsw_control.schema.models.InputError
        If it cannot be read, is invalid, or was changed after it was signed.
    """
    signer_of(source, None)
    return validate(
        Procedure, content_of(read_text(source, "procedure", _SHIPPED), str(source)), str(source)
    )


def signer_of(
    source: str | Path, trusted: Sequence[TrustedKey] | None, required: bool = False
) -> Signer | None:
    """Signer of a procedure, see :func:`fsw_recorder.signature.signer_of`."""
    return signature.signer_of(path_of(source), Purpose.PROCEDURE, trusted, required)


def check_signed(source: str | Path, trusted: Sequence[Path], required: bool) -> None:
    """Check a procedure's signature if required; ``trusted`` are key files, default: any key.

    Raises
    ------
    EvidenceError
        As in :func:`signer_of`.
    """
    signer_of(source, load_trusted(trusted) if trusted else None, required)


def differences(old: Procedure, new: Procedure) -> list[tuple[str, str, str]]:
    """Differences as path, old and new value; ``-`` for entries in only one of them."""
    before, after = (
        dict(_leaves("", side.model_dump(mode="json", exclude_none=True))) for side in (old, new)
    )
    keys = dict.fromkeys([*before, *after])
    return [
        (key, before.get(key, "-"), after.get(key, "-"))
        for key in keys
        if before.get(key) != after.get(key)
    ]


def _leaves(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Values by path; list entries by their name if they have one, so that paths are stable."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(f"{path}.{key}" if path else key, inner)
    elif isinstance(value, list):
        seen: Counter[str] = Counter()
        for row, inner in enumerate(value):
            keys = inner if isinstance(inner, dict) else {}
            name = str(keys.get("name") or keys.get("variable") or row)
            seen[name] += 1
            yield from _leaves(f"{path}[{name}{f' {seen[name]}' * (seen[name] > 1)}]", inner)
    else:
        yield path, f"{value:g}" if isinstance(value, float) else str(value)


#: limits of the supervisor's interlocks on a variable, e.g. ``interlocks.depth_low.trip``
_TRIP = re.compile(r"interlocks\.(\w+)_(low|high)\.trip")
#: variables by their quantity, e.g. ``depth``
_VARIABLES: dict[str, Variable] = {name.rpartition("_")[0]: name for name in get_args(Variable)}
#: limits of the supervisor's commands: the drives', which a procedure may narrow but not widen
_COMMANDS: dict[Variable, str] = {
    "force_kn": "limits.force_{}_kn",
    "speed_rpm": "limits.speed_{}_rpm",
}


def node_parameters(procedure: Procedure) -> dict[str, dict[str, Any]]:
    """Supervisor parameters derived from a procedure (the operator page reads the file itself).

    Only limits of all phases count, as the supervisor does not know the phase. Trips are the
    essential limits; warnings are the ends of the permitted set-points or, without any, at the
    same distance from the trip as in the supervisor's defaults. Parameters that do not follow
    from the procedure are omitted.

    Raises
    ------
    fsw_control.schema.models.InputError
        If its limits exclude the whole range of the drives.
    """
    parameters: dict[str, Any] = {}
    default = defaults(SupervisorParameters)
    for key in default:
        interlock = _TRIP.fullmatch(key)
        if interlock is None or (variable := _VARIABLES.get(interlock[1])) is None:
            continue
        end = interlock[2] == "high"
        trip = _narrowest(_always(procedure, variable))[end]
        if trip is None:
            continue
        warn_key = key.removesuffix("trip") + "warn"
        points = getattr(procedure.set_points, variable, None)
        warn = None if points is None else (points.min, points.max)[end]
        if warn is None or warn == trip:
            warn = trip - (default[key] - default[warn_key])
        parameters |= {warn_key: warn, key: trip}
    for variable, pattern in _COMMANDS.items():
        keys = pattern.format("min"), pattern.format("max")
        least, most = (default[key] for key in keys)
        low, high = _narrowest(_always(procedure, variable))
        if low is not None:
            parameters[keys[0]] = max(low, least)
        if high is not None:
            parameters[keys[1]] = min(high, most)
        if parameters.get(keys[0], least) >= parameters.get(keys[1], most):
            raise InputError(
                f"procedure {procedure.id}: essential limits of {variable} "
                f"leave nothing of what the drives can do, {least:g} to {most:g}"
            )
    return {"fsw_supervisor": parameters}


def graph_parameters(source: str) -> dict[str, dict[str, Any]]:
    """Node parameters of a weld by a procedure, including the recorder's hooks.

    ``source`` is a YAML file or the name of a shipped procedure.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the procedure cannot be used.
    """
    file = str(path_of(source))
    # a signed file may be anywhere: it is read in place, with its signature
    commands = [
        shlex.join(command_of(BAG, file)) for command_of in all_loaded("fsw.record_hooks").values()
    ]
    nodes = node_parameters(load(file))
    return nodes | {
        "fsw_hmi": {"procedure": file},
        "fsw_procedure": {"procedure": file},
        "fsw_recorder": {"attach": [file]} | ({"on_finished": commands} if commands else {}),
    }


def check_possible(procedure: Procedure) -> None:
    """Compare the essential limits with the model's needs at the procedure's set-points.

    Raises
    ------
    fsw_control.schema.models.InputError
        If a weld at its set-points violates an essential limit, or the model has no equilibrium
        there.
    """
    points = procedure.set_points
    at = f"{points.depth_mm.value:g} mm and {points.temperature_c.value:g} °C"
    try:
        needed = ProcessModel(nominal()).equilibrium(
            points.depth_mm.value, points.temperature_c.value
        )
    except OperatingPointError as error:
        raise InputError(
            f"procedure {procedure.id}: its set-points cannot be held: {error}"
        ) from None
    torque_nm = needed.outputs.motor_torque_nm
    values: dict[Variable, float] = {
        "force_kn": needed.force_kn,
        "speed_rpm": needed.speed_rpm,
        "torque_nm": torque_nm,
        "power_kw": torque_nm * needed.speed_rpm * KW_PER_NM_RPM,
        "traverse_mm_per_min": procedure.machine.traverse_mm_per_min,
    }
    for limit in procedure.essential:
        value = values.get(limit.variable)
        if value is not None and not limit.holds(value):
            whose = (
                "the machine has"
                if limit.variable == "traverse_mm_per_min"
                else f"the model needs at {at}"
            )
            raise InputError(
                f"procedure {procedure.id}: essential limit {limit.words} is impossible: "
                f"{value:.4g} is what {whose}"
            )


def _always(procedure: Procedure, variable: Variable) -> list[Limit]:
    phases = {phase.name for phase in procedure.phases}
    return [
        row
        for row in procedure.essential
        if row.variable == variable and (not row.phases or set(row.phases) == phases)
    ]


def _narrowest(limits: list[Limit]) -> tuple[float | None, float | None]:
    lows = [bound.min for bound in limits if bound.min is not None]
    highs = [bound.max for bound in limits if bound.max is not None]
    return max(lows, default=None), min(highs, default=None)


class Deviation(Worded):
    """How a weld leaves its procedure."""

    SET_POINT = "set-point {quantity} {value:g} is in force; permitted: {low:g} to {high:g}"
    CONTROLLER = "{controller} is in command; permitted: {permitted}"
    MODE = "mode {mode} ({cause.words}) instead of auto"
    SWAP = "swap to {controller} ({cause.words}); permitted: {permitted}"
    TUNING = "{controller} has parameters {sha256:.12}…, the procedure wants {wanted:.12}…"
    LEAVES = "{deviations}"
    KEEPS = "no deviation"


class ProcedureWatch:
    """Deviations of a weld from its procedure, each with a name."""

    def __init__(self, procedure: Procedure) -> None:
        self._procedure = procedure
        self._permitted = {entry.name: entry.parameters_sha256 for entry in procedure.controllers}
        self._found: dict[str, Fact] = {}
        self._first = ""
        self._welds = False  # before automatic control has begun, hold is normal

    @property
    def deviations(self) -> dict[str, Fact]:
        """Present deviations, including those that cannot be undone."""
        return dict(self._found)

    @property
    def fact(self) -> Fact:
        """All deviations; the field ``names`` distinguishes those that have the same code."""
        if not self._found:
            return Fact.of(Deviation.KEEPS)
        deviations, names = tuple(self._found.values()), tuple(sorted(self._found))
        return Fact.of(Deviation.LEAVES, deviations=deviations, names=names)

    def _set(self, name: str, fact: Fact | None) -> None:
        if fact:
            self._found[name] = fact
        else:
            self._found.pop(name, None)

    def set_points(self, depth_mm: float, temperature_c: float) -> None:
        """Take the set-points in force."""
        for name, value in (("depth_mm", depth_mm), ("temperature_c", temperature_c)):
            point = getattr(self._procedure.set_points, name)
            inside = point.min <= value <= point.max
            data = {"quantity": name, "value": value, "low": point.min, "high": point.max}
            self._set(f"set_point_{name}", None if inside else Fact(Deviation.SET_POINT, data))

    def state(self, controller: str, mode: str, cause: Cause) -> None:
        """Take controller, mode and cause, as reported by the supervisor."""
        foreign = controller and controller not in self._permitted
        data = {"controller": controller, "permitted": tuple(self._permitted)}
        self._set("controller", Fact(Deviation.CONTROLLER, data) if foreign else None)
        self._welds = self._welds or mode == "auto"
        other = Fact.of(Deviation.MODE, mode=mode, cause=cause)
        self._set("mode", other if self._welds and mode != "auto" else None)
        if not controller:
            return
        if not self._first:
            self._first = controller
        acceptance = self._procedure.acceptance
        if controller != self._first and not acceptance.permits_swap(cause):
            # kept: a swap back does not undo it
            permitted = acceptance.swap_words
            swap = Fact.of(Deviation.SWAP, controller=controller, cause=cause, permitted=permitted)
            self._found.setdefault("swap", swap)

    def tuning(self, controller: str, parameters: Mapping[str, Any]) -> None:
        """Take the present parameters of a controller's node."""
        permitted = self._permitted.get(controller)
        actual = tuning_sha256(parameters)
        data = {"controller": controller, "sha256": actual, "wanted": permitted}
        other = (
            Fact(Deviation.TUNING, data) if permitted is not None and actual != permitted else None
        )
        self._set(f"tuning_{controller}", other)
