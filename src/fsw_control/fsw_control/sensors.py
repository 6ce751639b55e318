"""The sensors of a weld: the table behind topics, parameters, checks, faults, records and labels.

A new sensor needs a row here and, for a new kind of quantity, its value in the plant
(``fsw_plant_show``) and its message; a channel of the depth what it shows of the machine
(``fsw_plant.library``) and what the fusion knows of it (``fsw_control.depth_channels``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from fsw_control.schema.ranges import Range
from fsw_control.units import from_si, to_si


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a sensor measures: its units and the permitted ranges of its parameters."""

    name: str  #: also the field of the message
    unit: str  #: inside, e.g. ``N m``; on the wire it is SI (``fsw_control.units``)
    suffix: str  #: the unit in names, e.g. ``nm``
    plausible: Range  #: of a sensor's limits
    fault: Range  #: of a fault's magnitude (per second for a drift)
    noise: Range  #: of the standard deviation of a sensor's noise
    resolution: Range  #: of a sensor's quantisation

    @property
    def signal(self) -> str:
        """Name of its values, with the unit, e.g. ``temperature_c``."""
        return f"{self.name}_{self.suffix}"


def _quantity(name: str, unit: str, suffix: str, *ranges: tuple[float, float]) -> Quantity:
    return Quantity(name, unit, suffix, *(Range(*ends, unit) for ends in ranges))


DEPTH = _quantity("depth", "mm", "mm", (-10.0, 20.0), (-5.0, 5.0), (0.0, 1.0), (0.0, 1.0))
TORQUE = _quantity(
    "torque", "N m", "nm", (-5000.0, 10_000.0), (-2000.0, 2000.0), (0.0, 500.0), (0.0, 100.0)
)
TEMPERATURE = _quantity(
    "temperature", "degC", "c", (-50.0, 1500.0), (-1000.0, 1000.0), (0.0, 100.0), (0.0, 10.0)
)


@dataclass(frozen=True, slots=True)
class Sensor:
    """A row of the table; numbers are in the unit of the quantity.

    Control needs every ``required`` sensor: ticks wait for it, and it can stop a weld. Any other
    sensor is published, checked, recorded and shown if present; nothing waits for it.
    """

    name: str  #: in faults, alarms and reports
    title: str  #: for people, within a sentence
    quantity: Quantity
    topic: str  #: relative to the weld's namespace
    message_type: str  #: as `package/Name`; the value is in the field with the quantity's name
    #: smallest and largest plausible sample, and fastest plausible change (per second)
    minimum: float
    maximum: float
    max_rate: float
    #: largest change that the supervisor believes; None: any, for a sensor that cannot stop a weld
    max_jump: float | None
    noise: float  #: standard deviation: added by the emulator, and expected by the checks
    resolution: float  #: quantisation in the emulator
    key: str = ""  #: stem of its names in figures and parameters, by default its name
    required: bool = True

    @property
    def stem(self) -> str:
        """Name of its signal without unit."""
        return self.key or self.name

    @property
    def signal(self) -> str:
        """Name of its values, with the unit, e.g. ``temperature_c``."""
        return f"{self.stem}_{self.quantity.suffix}"

    @property
    def label(self) -> str:
        """Label of its values, for people."""
        return self.stem.replace("_", " ").capitalize()

    def inside(self, value: Any) -> Any:
        """A value from the wire, or an array of them, in the unit inside."""
        return value * from_si(1.0, self.quantity.unit)

    def on_wire(self, value: Any) -> Any:
        """A value in the unit inside, or an array of them, as it is on the wire."""
        return value * to_si(1.0, self.quantity.unit)


#: the sensors of the depth on a machine that has several (Posiva SKB Report 08, 2018: a laser, two
#: LVDTs, the axial position), each with its title and the standard deviation of its noise (chosen)
_DEPTH_CHANNELS = (
    ("laser", "depth laser", 0.015),
    ("lvdt_lead", "leading LVDT", 0.005),
    ("lvdt_trail", "trailing LVDT", 0.005),
    ("axial", "axial position", 0.004),
)


#: at the surface of the copper a sensor's noise and offset show less than nothing (chosen)
SURFACE_MM = -0.5
_DEPTH_TYPE, _TORQUE_TYPE = "fsw_msgs/msg/ShoulderDepth", "fsw_msgs/msg/SpindleTorque"
_TEMPERATURE_TYPE = "sensor_msgs/msg/Temperature"


def _depth_channel(channel: str, title: str, noise_mm: float) -> Sensor:
    return Sensor(
        *(f"depth_{channel}", title, DEPTH, f"fsw/depth/{channel}", _DEPTH_TYPE),
        minimum=SURFACE_MM,
        maximum=6.0,
        max_rate=10.0,
        max_jump=None,
        noise=noise_mm,
        resolution=0.001,
        required=False,
    )


_ROWS = (
    Sensor(
        *("depth", "depth sensor", DEPTH, "fsw/depth", _DEPTH_TYPE),
        minimum=SURFACE_MM,
        maximum=6.0,
        max_rate=10.0,
        max_jump=0.5,
        noise=0.002,
        resolution=0.0001,
    ),
    Sensor(
        *("torque", "torque sensor", TORQUE, "fsw/spindle_torque", _TORQUE_TYPE),
        minimum=100.0,
        maximum=3000.0,
        max_rate=3000.0,
        max_jump=200.0,
        noise=2.0,
        resolution=0.1,
    ),
    Sensor(
        *("thermocouple", "thermocouple", TEMPERATURE, "fsw/thermocouple", _TEMPERATURE_TYPE),
        minimum=300.0,
        maximum=1080.0,
        max_rate=400.0,
        max_jump=40.0,
        noise=0.1,
        resolution=0.01,
        key="temperature",
    ),
    *(_depth_channel(*channel) for channel in _DEPTH_CHANNELS),
)
#: by name; the required ones come first, in the order of ``Measurement``
SENSORS = {row.name: row for row in _ROWS}
REQUIRED = tuple(row.name for row in _ROWS if row.required)
OPTIONAL = tuple(row.name for row in _ROWS if not row.required)
#: by sensor, the channels that a depth may be fused from
DEPTH_CHANNELS = {f"depth_{channel}": channel for channel, *_ in _DEPTH_CHANNELS}
if TYPE_CHECKING:
    SensorName = str
else:  # so that models and schemas have the names
    SensorName = Literal[tuple(SENSORS)]
