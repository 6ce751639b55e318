"""Parameters of the plant. Chosen means: not in the paper, chosen for this project."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import create_model

from fsw_control import weld
from fsw_control.common_parameters import Commands, DriveBounds, numbers
from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import Model, Whole
from fsw_control.schema.ranges import Range
from fsw_control.sensors import DEPTH_CHANNELS, SENSORS, Sensor
from fsw_model import ModelParameters
from fsw_plant.canister import CanisterParameters

if TYPE_CHECKING:
    DepthSensor = str
else:  # so that the schema has the names
    DepthSensor = Literal["ideal", *DEPTH_CHANNELS]


class Start(Model):
    """Parameters ``start.*``."""

    depth_mm: Annotated[float, Range(1.0, 5.0, "mm")] = weld.DEPTH_MM
    """Shoulder depth of the equilibrium at the start."""
    temperature_c: Annotated[float, Range(500.0, 1080.0, "degC")] = weld.TEMPERATURE_C
    """Temperature of the equilibrium at the start."""
    power_kw: Annotated[float, Range(1.0, 200.0, "kW")] = 50.0
    """With process canister: power that heats it from ambient before the first tick, until the
    thermocouple shows start.temperature_c (chosen)."""


class Tool(Model):
    """Parameters ``tool.*``."""

    traverse_mm_per_min: Annotated[float, Range(0.0, 300.0, "mm/min")] = 86.0
    """Where the scenario has no phases and no path: traverse speed of the tool, paper section
    II."""
    axial_mm: Annotated[float, Range(-200.0, 500.0, "mm")] = 0.0
    """With process canister, where the scenario has no phases and no path: height of the tool
    above the joint line, towards the lid."""


class Limits(DriveBounds):
    """Parameters ``limits.*``."""

    force_rate_kn_per_s: Annotated[float, Range(0.01, 1000.0, "kN/s")] = 10.0
    """Maximum rate of the axial force; applied as a maximum change per tick."""
    speed_rate_rpm_per_s: Annotated[float, Range(0.01, 10000.0, "rpm/s")] = 30.0
    """Maximum rate of the spindle speed; applied as a maximum change per tick."""


class Actuators(Model):
    """Parameters ``actuators.*``."""

    lag_s: Annotated[float, Range(0.0, 10.0, "s")] = 0.02
    """Time constant of both drives, first order; 0: no lag (chosen)."""
    dead_time_ticks: Annotated[Whole, Range(0, 10, "")] = 0
    """Ticks from a command to its arrival at both drives (fieldbus, cycle of the PLC); the
    watchdog's commands take it, too (chosen)."""


class _Sensors(Model):
    """Parameters ``sensors.*`` that one sensor has."""

    temperature_lag_s: Annotated[float, Range(0.0, 60.0, "s")] = 0.0
    """Time constant of the thermocouple's probe, first order, ahead of its noise and faults; 0:
    none."""
    torque_drop_nm_per_rpm: Annotated[float, Range(0.0, 10.0, "N m/rpm")] = 0.0
    """Drop of the measured torque per rpm above 407.576 rpm, as in Fig. 5; the process is not
    affected."""


def _of_sensor(row: Sensor) -> dict[str, tuple[Range, float, str]]:
    """Parameters that every sensor has, by name."""
    quantity, title, stem = row.quantity, row.title, row.stem
    noise = f"Standard deviation of the {title}'s noise (chosen)"
    colour = (
        f"Correlation time of the {title}'s noise, a first-order Gauss-Markov process; 0: white"
    )
    steps = f"Quantisation of the {title}; 0: none (chosen)"
    return {
        f"{stem}_noise_{quantity.suffix}": (quantity.noise, row.noise, noise),
        f"{stem}_noise_correlation_s": (Range(0.0, 600.0, "s"), 0.0, colour),
        f"{stem}_resolution_{quantity.suffix}": (quantity.resolution, row.resolution, steps),
    }


_SENSORS = {name: field for row in SENSORS.values() for name, field in _of_sensor(row).items()}
_FACTORS = {
    name: (Range(0.1, 10.0, ""), 1.0, f"Factor on the model parameter {name}")
    for name in ModelParameters.model_fields
}
SENSOR_PARAMETERS = create_model("SensorParameters", __base__=_Sensors, **numbers(_SENSORS))()
MODEL_FACTORS = create_model("ModelFactors", __base__=Model, **numbers(_FACTORS))()


class Watchdog(Model):
    """Parameters ``watchdog.*``."""

    timeout_s: Annotated[float, Range(0.1, 60.0, "s")] = 1.0
    """Time without a valid command after which the watchdog holds the last one."""
    hold_s: Annotated[float, Range(0.0, 600.0, "s")] = 2.0
    """Time for which the watchdog holds the last command before it ramps to the safe state
    (chosen)."""
    safe_force_kn: Annotated[float, Range(0.0, 200.0, "kN")] = 65.0
    """Axial force of the safe state, in which the spindle keeps turning; a lower force is kept
    (chosen)."""
    safe_rate_kn_per_s: Annotated[float, Range(0.01, 100.0, "kN/s")] = 2.0
    """Rate of the ramp to the safe force (chosen)."""
    armed_at_start: bool = False
    """Whether the watchdog is armed from the start rather than from the first valid command."""


class Machine(Model):
    """Parameters ``machine.*``; by default the machine is rigid and the copper even."""

    depth_channels: bool = False
    """Whether the machine has several sensors of the depth, from which fsw/depth is fused."""
    depth_sensor: DepthSensor = "ideal"
    """Without depth_channels: the channel behind fsw/depth, with that channel's errors."""
    footprint_file: str = ""
    """JSON file of fsw.py footprint, of an earlier weld on the machine: its bias of the depth is
    taken off; empty: none."""
    compliance_mm_per_kn: Annotated[float, Range(0.0, 0.2, "mm/kN")] = 0.0
    """Deflection of the machine by the axial force; the axial position shows it as depth."""
    touch_off_kn: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_KN
    """Axial force at which the touch-off has removed the deflection from the shown depth."""
    tool_growth_mm_per_kw: Annotated[float, Range(0.0, 0.1, "mm/kW")] = 0.0
    """Thermal growth of tool and spindle in steady state, since the touch-off; the tool is deeper
    than it is shown."""
    tool_growth_s: Annotated[float, Range(1.0, 100_000.0, "s")] = 600.0
    """Time constant of that growth, first order (chosen)."""
    canister_growth_mm_per_kw: Annotated[float, Range(0.0, 0.1, "mm/kW")] = 0.0
    """Thermal growth of the canister towards the machine in steady state."""
    canister_growth_s: Annotated[float, Range(1.0, 100_000.0, "s")] = 1500.0
    """Time constant of that growth, first order (chosen)."""
    hardness: Annotated[float, Range(0.5, 2.0, "")] = 1.0
    """Hardness of this canister's copper, as a factor on all stresses: force and torque that the
    same depth needs are proportional to it."""
    hardness_variation: Annotated[float, Range(0.0, 0.2, "")] = 0.0
    """Standard deviation of the hardness along the circumference, as a share; the seed decides
    where the copper is hard."""
    hardness_length_mm: Annotated[float, Range(1.0, 2000.0, "mm")] = 200.0
    """Length along the circumference within which the hardness is similar (chosen)."""
    runout_mm: Annotated[float, Range(0.0, 1.0, "mm")] = 0.0
    """Amplitude of the head's movement once per turn of the spindle, aliased by the tick."""
    swelling_mm_per_mm: Annotated[float, Range(0.0, 5.0, "")] = 0.0
    """Height of flash and swollen copper beside the shoulder per depth beyond swelling_from_mm."""
    swelling_from_mm: Annotated[float, Range(0.0, 10.0, "mm")] = 2.4
    """Depth at which copper begins to swell (chosen)."""
    edge_mm: Annotated[float, Range(-2.0, 2.0, "mm")] = 0.0
    """Height of an edge of the surface across the path of the tool."""
    edge_at_mm: Annotated[float, Range(0.0, 10_000.0, "mm")] = 100.0
    """Where on the path the edge is."""


class PlantParameters(NodeParameters):
    """Parameters of the plant, a factor on each parameter of the model, and the canister's."""

    autostart: Annotated[bool, AT_START] = True
    """Configure and activate on start-up; if false, wait for lifecycle transitions."""
    seed: Annotated[Whole, Range(0, 4294967295, "")] = 1
    """Seed of the sensor noise; a change takes effect at the next reset."""
    noise: bool = True
    """Whether the sensors have noise and quantisation."""
    process: Annotated[Literal["paper", "canister"], AT_START] = "paper"
    """Where the stir zone's temperature comes from: paper, the equation (16); canister, conduction
    in a canister with the parameters canister.*."""
    start: Start = Start()
    tool: Tool = Tool()
    limits: Limits = Limits()
    actuators: Actuators = Actuators()
    sensors: type(SENSOR_PARAMETERS) = SENSOR_PARAMETERS  # type: ignore[valid-type]
    watchdog: Watchdog = Watchdog()
    commands: Commands = Commands()
    scenario: str = ""
    """Timed disturbances and faults: path of a scenario file, or its YAML text; a change replaces
    all future events."""
    model_file: Annotated[str, AT_START] = ""
    """YAML file with parameters of the process model; empty: the nominal ones."""
    clock: Annotated[Literal["real", "simulated"], AT_START] = "real"
    """real: ticks follow the wall clock; simulated: the plant publishes /clock."""
    speed: Annotated[float, Range(0.0, 1000.0, ""), AT_START] = 1.0
    """Speed of simulated time relative to the wall clock; 0: lockstep; any value other than 1
    implies simulated time."""
    wait_for_subscribers: Annotated[Whole, Range(0, 100, ""), AT_START] = 0
    """Number of subscribers of each sensor topic to wait for before the first tick; if not 0, and
    always in lockstep, also for a publisher of fsw/command."""
    lockstep_timeout_s: Annotated[float, Range(0.1, 600.0, "s")] = 2.0
    """In lockstep, wall time without a command after which the plant reports an error and repeats
    the tick; it also repeats it when another node begins to publish commands. Also the longest
    wait for a subscriber that has stopped."""
    lockstep_give_up_s: Annotated[float, Range(0.0, 86400.0, "s")] = 180.0
    """In lockstep, wall time without a command after which the plant exits with an error; longer
    than a standby waits (2 s, after takeovers up to 16 s); 0: never."""
    discovery_s: Annotated[float, Range(0.0, 10.0, "s"), AT_START] = 0.5
    """Time for which the plant looks for another plant in the same domain before it starts."""
    factors: type(MODEL_FACTORS) = MODEL_FACTORS  # type: ignore[valid-type]
    machine: Annotated[Machine, AT_START] = Machine()
    canister: Annotated[CanisterParameters, AT_START] = CanisterParameters()
