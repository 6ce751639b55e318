"""Conversion of the server's values, and the check of its nodes once per connection."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from asyncua import Client, ua

from fsw_control.common_parameters import DriveLimits
from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS
from fsw_control.validity import sensor_limits
from fsw_machine.machine_file import WRITTEN, MachineFile, Quantity
from fsw_machine.samples import RawValue

_EPOCH = datetime(1970, 1, 1)
_MICROSECOND = timedelta(microseconds=1)
#: integer types with their numbers of values
WHOLE = {
    ua.VariantType[name]: 1 << bits
    for bits, names in (
        (8, ("SByte", "Byte")),
        (16, ("Int16", "UInt16")),
        (32, ("Int32", "UInt32")),
    )
    for name in names
} | {ua.VariantType.Int64: 1 << 64, ua.VariantType.UInt64: 1 << 64}
#: coarsest permitted steps of integer nodes: half a move of a set-point, ten times a measurement's
#: noise (chosen)
_COARSE_MOVES, _COARSE_NOISES = 0.5, 10.0
#: upper bound of a ROS stamp
_LAST_NS = 2**31 * NANOSECONDS
_NUMBERS = {ua.VariantType.Float, ua.VariantType.Double, *WHOLE}


class LinkError(RuntimeError):
    """The server does not match the machine file; the message names the entry and the remedy."""


def epoch_ns(when: datetime) -> int:
    """Nanoseconds since 1970 of a timestamp in UTC."""
    plain = when.astimezone(UTC).replace(tzinfo=None) if when.tzinfo else when
    return (plain - _EPOCH) // _MICROSECOND * 1000


def raw_value(answer: ua.DataValue) -> RawValue:
    """Convert a value of the server from asyncua's types."""
    value = None if answer.Value is None else answer.Value.Value
    status = answer.StatusCode or ua.StatusCode()
    source_ns = None if answer.SourceTimestamp is None else epoch_ns(answer.SourceTimestamp)
    return RawValue(value, int(status.value), status.name, source_ns)


def check_clock(source_ns: int) -> None:
    """Raise a `LinkError` if a source timestamp cannot be a measurement's stamp."""
    if not 0 <= source_ns < _LAST_NS:
        year = (_EPOCH + timedelta(microseconds=source_ns // 1000)).year
        problem = f"nodes.cycle: its source timestamp is of the year {year}"
        raise LinkError(f"{problem}; set the machine's clock, or clock.stamps: received")


async def check_nodes(
    client: Client, machine: MachineFile, nodes: dict[str, ua.NodeId], limits: DriveLimits
) -> dict[str, ua.VariantType]:
    """Check that all nodes exist, have a suitable type and are writable; return their types.

    A value that is only bad at present is not an error here.

    Raises
    ------
    LinkError
        With the entry of the machine file.
    """
    names = (*machine.nodes.read, *WRITTEN)
    requests = [ua.ReadValueId(nodes[name], ua.AttributeIds.Value) for name in names]
    requests += [ua.ReadValueId(nodes[name], ua.AttributeIds.UserAccessLevel) for name in WRITTEN]
    requests += [ua.ReadValueId(nodes[name], ua.AttributeIds.DataType) for name in names]
    answers = await client.uaclient.read(ua.ReadParameters(NodesToRead=requests))
    values = dict(zip(names, answers, strict=False))
    access = dict(zip(WRITTEN, answers[len(names) :], strict=False))
    types = dict(zip(names, answers[len(names) + len(WRITTEN) :], strict=True))
    kinds = {name: _type(name, machine, values[name], types[name]) for name in names}
    for name, kind in kinds.items():
        node = machine.nodes[name].node
        if name == "permissive":
            fits, wanted_kind = kind is ua.VariantType.Boolean, "a Boolean"
        elif name in ("cycle", "heartbeat", "touch_off"):
            fits, wanted_kind = kind in WHOLE, "a whole number"
        else:
            fits, wanted_kind = kind in _NUMBERS, "a number"
        if not fits:
            raise LinkError(f"nodes.{name}: {node} is of type {kind.name}, must be {wanted_kind}")
    check_whole_numbers(machine, kinds, limits)
    if kinds["heartbeat"] is not kinds["cycle"]:
        node, own = machine.nodes["heartbeat"].node, kinds["heartbeat"].name
        text = f"{node} is of type {own}, must be of the type of nodes.cycle, "
        raise LinkError(f"nodes.heartbeat: {text}{kinds['cycle'].name}")
    for name, answer in access.items():
        level = None if answer.Value is None else answer.Value.Value
        if isinstance(level, int) and not level >> ua.AccessLevel.CurrentWrite & 1:
            node = machine.nodes[name].node
            raise LinkError(f"nodes.{name}: {node} cannot be written by this user")
    return kinds


def check_whole_numbers(
    machine: MachineFile, kinds: dict[str, ua.VariantType], limits: DriveLimits
) -> None:
    """Raise a `LinkError` if the range or resolution of an integer node is insufficient.

    It must cover all values within the limits, or a sensor's plausible range, and resolve a move,
    or the sensor's noise.
    """
    needs = _needs(limits)
    for name, kind in kinds.items():
        need = needs.get(name) or needs.get(name.partition("_")[0])
        if need is not None and kind in WHOLE and (why := _unfit(machine.nodes[name], kind, need)):
            node = machine.nodes[name].node
            text = f"{node} is of type {kind.name}, {why}; give it another type or scale"
            raise LinkError(f"nodes.{name}: {text}")


@dataclass(frozen=True, slots=True)
class _Need:
    """Required range and coarsest step of a node, in the internal unit."""

    low: float
    high: float
    step: float
    unit: str


def _needs(limits: DriveLimits) -> dict[str, _Need]:
    """Requirements of limits and measurements, by a node's name or its first word."""
    force_kn = _COARSE_MOVES * limits.force_step_kn
    speed_rpm = _COARSE_MOVES * limits.speed_step_rpm
    force = _Need(limits.force_min_kn, limits.force_max_kn, force_kn, "kN")
    speed = _Need(limits.speed_min_rpm, limits.speed_max_rpm, speed_rpm, "rpm")
    needs = {"force": force, "speed": speed}
    for sensor, limit in sensor_limits().items():
        row, step = SENSORS[sensor], _COARSE_NOISES * limit.noise or math.inf
        # what is less than nothing is noise at the surface: a node may end at 0
        low = max(limit.minimum, 0.0)
        needs[row.stem] = _Need(low, limit.maximum, step, row.quantity.unit)
    return needs


def _unfit(spec: Quantity[str], kind: ua.VariantType, need: _Need) -> str:
    """Why an integer type is unsuitable for a quantity; empty if it is suitable."""
    smallest = 0 if kind.name in ("Byte", "UInt16", "UInt32", "UInt64") else -WHOLE[kind] // 2
    largest = smallest + WHOLE[kind] - 1
    numbers = sorted((spec.number(need.low), spec.number(need.high)))
    if numbers[0] < smallest or numbers[1] > largest:
        need_words = f"{numbers[0]:g} to {numbers[1]:g}"
        return f"which ends at {smallest} and {largest}, and the limits need {need_words}"
    step = abs(spec.inside(1.0) - spec.inside(0.0))
    if step > need.step:
        most = f"{need.step:g} {need.unit} at most will do"
        return f"which has steps of {step:g} {need.unit}, and {most}"
    return ""


def _type(
    name: str, machine: MachineFile, value: ua.DataValue, data_type: ua.DataValue
) -> ua.VariantType:
    node = machine.nodes[name].node
    status = value.StatusCode or ua.StatusCode()
    if status.value in (ua.StatusCodes.BadNodeIdUnknown, ua.StatusCodes.BadNodeIdInvalid):
        raise LinkError(f"nodes.{name}: the server has no node {node}")
    if status.value == ua.StatusCodes.BadAttributeIdInvalid:
        raise LinkError(f"nodes.{name}: {node} has no value; it must be a variable")
    if status.value in (ua.StatusCodes.BadUserAccessDenied, ua.StatusCodes.BadNotReadable):
        raise LinkError(f"nodes.{name}: {node} cannot be read by this user ({status.name})")
    if value.Value is not None and value.Value.VariantType is not ua.VariantType.Null:
        kind = value.Value.VariantType
    else:
        declared = None if data_type.Value is None else data_type.Value.Value
        kind, of_standard = ua.VariantType.Null, getattr(declared, "NamespaceIndex", -1) == 0
        if declared is not None and of_standard and declared.Identifier in range(1, 26):
            kind = ua.VariantType(declared.Identifier)
    if value.Value is not None and value.Value.is_array:
        raise LinkError(f"nodes.{name}: {node} is an array, must be a single value")
    return kind
