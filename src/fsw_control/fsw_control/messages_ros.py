"""Converts between the messages (SI) and the core's data (the paper's units)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from importlib import import_module
from itertools import pairwise
from math import degrees, nan, radians
from typing import Any

from builtin_interfaces.msg import Duration, Time
from std_msgs.msg import Header

from fsw_control import units
from fsw_control.coded import RefusedError
from fsw_control.contract import Command, Plan, Proposal, Reference
from fsw_control.depth_channels import ChannelHealth
from fsw_control.depth_fusion import DepthEstimate
from fsw_control.fence import ActuatorState, Signature
from fsw_control.heat_plan import HeatPlan
from fsw_control.ranges import Forbidden, set_point_problem
from fsw_control.reason import Lack, Readiness, Reason
from fsw_control.sensors import DEPTH, DEPTH_CHANNELS, SENSORS
from fsw_control.stop import Stop, StopCause
from fsw_control.units import NANOSECONDS
from fsw_msgs.msg import ActuatorState as ActuatorStateMessage
from fsw_msgs.msg import (
    ControllerHealth,
    ControllerStatus,
    DriveFeedback,
    Prediction,
    ShoulderDepth,
    SupervisorState,
    WeldCommand,
    WeldReference,
    WeldReferencePlan,
)
from fsw_msgs.msg import HeatPlan as HeatPlanMessage
from fsw_msgs.msg import Reason as ReasonMessage
from fsw_msgs.msg import Stop as StopMessage
from fsw_msgs.srv import SetMode, SetReference, SwitchController

#: quantity in the core -> name with SI unit on the wire, and conversion; other names stay
#: unchanged
_WIRE: dict[str, tuple[str, Callable[[float], float]]] = {
    "depth_mm": ("depth [m]", units.m_from_mm),
    "temperature_c": ("temperature [degC]", float),
    "torque_nm": ("torque [N m]", float),
    "torque_scale": ("torque_scale", float),
    "force_kn": ("force [N]", units.n_from_kn),
    "speed_rpm": ("speed [rad/s]", units.rad_s_from_rpm),
    "power_kw": ("power [W]", units.w_from_kw),
    "attainable_depth_mm": ("attainable_depth [m]", units.m_from_mm),
    "attainable_temperature_c": ("attainable_temperature [degC]", float),
    "copper_temperature_c": ("copper_temperature [degC]", float),
    "depth_rate_mm_per_s": ("depth_rate [m/s]", units.m_from_mm),
    "temperature_rate_c_per_s": ("temperature_rate [degC/s]", float),
    "force_deviation_kn": ("force_deviation [N]", units.n_from_kn),
    "power_deviation_kw": ("power_deviation [W]", units.w_from_kw),
    "depth_deviation_mm": ("depth_deviation [m]", units.m_from_mm),
    "temperature_deviation_c": ("temperature_deviation [degC]", float),
    "depth_rate_deviation_mm_per_s": ("depth_rate_deviation [m/s]", units.m_from_mm),
    "temperature_rate_deviation_c_per_s": ("temperature_rate_deviation [degC/s]", float),
}


def stamp_ns(stamp: Time) -> int:
    """Nanoseconds of a message's stamp."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def stamp_from_ns(time_ns: int) -> Time:
    """Stamp of a message from nanoseconds."""
    sec, nanosec = divmod(time_ns, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def header(time_ns: int) -> Header:
    """Header with a stamp."""
    return Header(stamp=stamp_from_ns(time_ns))


@cache
def message_type(sensor: str) -> Any:
    """Type of a sensor's messages."""
    package, _, name = SENSORS[sensor].message_type.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def sensor_message(sensor: str, value: float, time_ns: int) -> Any:
    """Sample of a sensor, ``value`` in its unit (mm, N m, degC)."""
    row = SENSORS[sensor]
    values = {row.quantity.name: row.on_wire(value)}
    message = message_type(sensor)(header=header(time_ns), **values)
    if row.quantity is DEPTH:
        message.standard_deviation = row.on_wire(row.noise)
    return message


def add_basis(
    message: ShoulderDepth,
    fused: DepthEstimate | None,
    footprint_bias_mm: float,
    footprint_sha256: str,
) -> None:
    """Add the channels of a fused depth, and the footprint of an earlier weld."""
    message.footprint_bias = units.m_from_mm(footprint_bias_mm)
    message.footprint = footprint_sha256
    if fused is not None:
        message.standard_deviation = units.m_from_mm(fused.deviation_mm)
        names, unknown = DEPTH_CHANNELS.values(), ChannelHealth.UNKNOWN
        message.channel_health = [fused.health.get(name, unknown) for name in names]
        message.channels_used = sum((name in fused.used) << k for k, name in enumerate(names))


def sensor_value(sensor: str, message: Any) -> float:
    """Value of a sensor's message in the unit inside."""
    row = SENSORS[sensor]
    return float(row.inside(getattr(message, row.quantity.name)))


def drives_message(
    acting: Command, time_ns: int, actuator: ActuatorState | None = None
) -> DriveFeedback:
    """Drive feedback: the inputs that act, and the memory of the actuator end."""
    state = actuator or ActuatorState()
    return DriveFeedback(
        header=header(time_ns),
        axial_force=units.n_from_kn(acting.force_kn),
        spindle_speed=units.rad_s_from_rpm(acting.speed_rpm),
        actuator=ActuatorStateMessage(
            term=state.term,
            leader=state.leader,
            unanswered=state.unanswered,
            source=state.source,
            answered=stamp_from_ns(state.answered_ns),
            stop=stop_message(state.stop),
        ),
    )


def actuator_state(message: DriveFeedback) -> ActuatorState:
    """Memory of the actuator end."""
    state = message.actuator
    memory = stop(state.stop), stamp_ns(state.answered)
    return ActuatorState(state.term, state.leader, state.unanswered, state.source, *memory)


def stop(message: StopMessage) -> Stop:
    """Copy of the stop register."""
    cause, since_ns = StopCause(message.cause), stamp_ns(message.since)
    return Stop(int(message.epoch), bool(message.stopped), cause, message.who, since_ns)


def stop_message(value: Stop) -> StopMessage:
    """Copy of the stop register as a message."""
    cause, since = int(value.cause), stamp_from_ns(value.since_ns)
    state = {"epoch": value.epoch, "stopped": value.stopped, "who": value.who}
    return StopMessage(cause=cause, since=since, **state)


def signature(message: WeldCommand | SupervisorState) -> Signature:
    """Sender of a command or a state: its term, its identity and its copy of the stop register."""
    return Signature(int(message.term), message.leader, stop(message.stop))


def sign(message: WeldCommand | SupervisorState, value: Signature) -> None:
    """Enter the sender into a command or state."""
    message.term, message.leader, message.stop = value.term, value.leader, stop_message(value.stop)


def reference(message: WeldReference) -> Reference:
    """Set-points of a reference message; ValueError if a value is not finite or out of range."""
    value = Reference(units.mm_from_m(message.depth), float(message.temperature))
    if problem := set_point_problem(value.depth_mm, value.temperature_c):
        raise RefusedError(problem)
    return value


def reference_plan(message: WeldReferencePlan) -> list[tuple[int, Reference]]:
    """Set-points of a plan, each with the time in ns from which it will hold.

    Raises as :func:`reference` does, and also if the stamps do not rise.
    """
    planned = [(stamp_ns(entry.header.stamp), reference(entry)) for entry in message.references]
    if any(before_ns >= after_ns for (before_ns, _), (after_ns, _) in pairwise(planned)):
        raise RefusedError.of(Forbidden.FALLING)
    return planned


def reference_plan_message(
    planned: Sequence[tuple[int, Reference]], time_ns: int
) -> WeldReferencePlan:
    """Message of a plan that holds after ``time_ns``: set-points, each with its start in ns."""
    return WeldReferencePlan(
        header=header(time_ns),
        references=[reference_message(point, begin_ns) for begin_ns, point in planned],
    )


def heat_plan(message: HeatPlanMessage) -> HeatPlan | None:
    """Plan of a message, not checked; None if it withdraws the plan before it.

    It has no thermal model, and so a problem, if the model's names and values differ in number.
    """
    if not len(message.time):
        return None
    names, values = message.model_names, message.model_values
    return HeatPlan(
        list(message.time),
        [units.kw_from_w(heat_w) for heat_w in message.heat],
        [units.kw_from_w(units.kw_from_w(variance_w2)) for variance_w2 in message.variance],
        dict(zip(names, values, strict=True)) if len(names) == len(values) else {},
        [units.mm_from_m(length_m) for length_m in message.length],
        list(map(degrees, message.angle)),
        message.type,
        message.profile,
    )


def heat_plan_message(plan: HeatPlan | None, time_ns: int) -> HeatPlanMessage:
    """Message of a plan from the tick after ``time_ns``; without a plan it withdraws the last."""
    if plan is None:
        return HeatPlanMessage(header=header(time_ns))
    return HeatPlanMessage(
        header=header(time_ns),
        type=plan.type,
        profile=plan.profile,
        time=list(plan.at_s),
        length=[units.m_from_mm(travel_mm) for travel_mm in plan.travel_mm],
        angle=list(map(radians, plan.angle_deg)),
        heat=[units.w_from_kw(heat_kw) for heat_kw in plan.heat_kw],
        variance=[units.w_from_kw(units.w_from_kw(value)) for value in plan.variance_kw2],
        model_names=list(plan.model),
        model_values=[float(value) for value in plan.model.values()],
    )


def reference_message(
    value: Reference, time_ns: int, issued_ns: int = 0, mark: str = ""
) -> WeldReference:
    """Reference message effective from ``time_ns``; a node that reports it adds ``issued_ns``."""
    return WeldReference(
        header=header(time_ns),
        depth=units.m_from_mm(value.depth_mm),
        temperature=float(value.temperature_c),
        issued=stamp_from_ns(issued_ns),
        mark=mark,
    )


def command(message: WeldCommand | DriveFeedback | SetMode.Request) -> Command:
    """Inputs of a command, proposal or drive feedback; not checked for finite values."""
    speed_rpm = units.rpm_from_rad_s(message.spindle_speed)
    return Command(units.kn_from_n(message.axial_force), speed_rpm)


def command_message(
    value: Command, time_ns: int, source: str, healthy: bool = True, why: Reason | str = ""
) -> WeldCommand:
    """Command or proposal message that answers the measurement of ``time_ns``."""
    return WeldCommand(
        header=header(time_ns),
        axial_force=units.n_from_kn(value.force_kn),
        spindle_speed=units.rad_s_from_rpm(value.speed_rpm),
        source=source,
        healthy=healthy,
        why=reason_message(why),
    )


def status_message(
    proposal: Proposal,
    time_ns: int,
    controller: str,
    applied_source: str,
    tolerated_sensors: Iterable[str],
) -> ControllerStatus:
    """A controller's report with a proposal; ``applied_source`` computed the applied command."""
    diagnosis = proposal.diagnosis
    names, values = wire_quantities(diagnosis.disturbances)
    return ControllerStatus(
        header=header(time_ns),
        controller=controller,
        healthy=proposal.healthy,
        why=reason_message(proposal.reason),
        selected=applied_source == controller,
        tolerated_sensors=list(tolerated_sensors),
        depth_estimate=units.m_from_mm(diagnosis.depth_estimate_mm),
        temperature_estimate=float(diagnosis.temperature_estimate_c),
        torque_estimate=float(diagnosis.torque_estimate_nm),
        disturbance_names=names,
        disturbances=values,
        solver_status=diagnosis.solver_status,
        iterations=int(diagnosis.iterations),
        solve_time=float(diagnosis.solve_time_s),
        active_limits=list(diagnosis.active_limits),
        bad_cycles=int(diagnosis.bad_cycles),
        applied_source=applied_source,
    )


def wire_quantities(quantities: Mapping[str, float]) -> tuple[list[str], list[float]]:
    """Names and values of quantities as messages carry them, e.g. ``depth_mm`` -> ``depth [m]``.

    Only the core's names are converted; a controller's own names and values are passed through
    unchanged.
    """
    wire = [(*_WIRE.get(name, (name, float)), value) for name, value in quantities.items()]
    return [name for name, _, _ in wire], [converted(value) for _, converted, value in wire]


def attainable(message: ControllerStatus) -> Reference | None:
    """Set-points that the controller tracks instead; None if it does not report any."""
    wire = dict(zip(message.disturbance_names, message.disturbances, strict=False))
    names = [_WIRE[name][0] for name in ("attainable_depth_mm", "attainable_temperature_c")]
    if not wire.keys() >= set(names):
        return None
    depth_m, temperature_c = (float(wire[name]) for name in names)
    return Reference(units.mm_from_m(depth_m), temperature_c)


def prediction_message(
    plan: Plan, time_ns: int, deviations: tuple[Iterable[float], Iterable[float]] = ((), ())
) -> Prediction:
    """Message of a predicted horizon, with the standard deviations of depth and temperature."""
    depth_mm, temperature_c = deviations
    return Prediction(
        header=header(time_ns),
        time=list(map(float, plan.time_s)),
        depth=[units.m_from_mm(value) for value in plan.depth_mm],
        temperature=list(map(float, plan.temperature_c)),
        axial_force=[units.n_from_kn(value) for value in plan.force_kn],
        spindle_speed=[units.rad_s_from_rpm(value) for value in plan.speed_rpm],
        depth_deviation=[units.m_from_mm(value) for value in depth_mm],
        temperature_deviation=list(map(float, temperature_c)),
    )


def set_reference_request(
    depth_mm: float | None, temperature_c: float | None, ramp: bool
) -> SetReference.Request:
    """Request for new set-points; None keeps the present value."""
    return SetReference.Request(
        depth=nan if depth_mm is None else units.m_from_mm(depth_mm),
        temperature=nan if temperature_c is None else temperature_c,
        ramp=ramp,
    )


def switch_request(
    controller: str, wait_s: float, strict: bool = False, who: str = ""
) -> SwitchController.Request:
    """Request to switch the controller; ``wait_s`` is how long it may take to be ready."""
    kind, seconds = SwitchController.Request, int(wait_s)
    timeout = Duration(sec=seconds, nanosec=round((wait_s - seconds) * 1e9))
    strictness = kind.STRICT if strict else kind.BEST_EFFORT
    return kind(name=controller, strictness=strictness, timeout=timeout, who=who)


def mode_request(
    mode: str, force_kn: float | None = None, speed_rpm: float | None = None, who: str = ""
) -> SetMode.Request:
    """Request for a mode by an operator; force and speed are for ``manual``."""
    return SetMode.Request(
        mode=mode,
        axial_force=nan if force_kn is None else units.n_from_kn(force_kn),
        spindle_speed=nan if speed_rpm is None else units.rad_s_from_rpm(speed_rpm),
        who=who,
    )


def reason(message: WeldCommand | ControllerStatus) -> Reason:
    """Why a command must not be applied, or why its source is in command."""
    return Reason.of_messages([message.why])


def chain_messages(reason: Reason) -> list[ReasonMessage]:
    """A reason and its causes as a chain of messages."""
    return [ReasonMessage(**item.fields) for item in reason.chain]


def reason_message(reason: Reason | str) -> ReasonMessage:
    """A reason as a message; a text comes from a user's controller."""
    return ReasonMessage(**Reason.of(reason).fields)


def readiness(message: ControllerHealth) -> Readiness:
    """What a controller lacks, as the supervisor reports it."""
    return Readiness(
        Lack(message.lack),
        Reason.of_messages(message.why),
        tuple(message.missing_sensors),
        message.consecutive_good,
        message.required_good,
    )
