"""Safety monitor, independent of the active controller: validity of sensors, and interlocks.

Causes of a safe stop act by level. There are three kinds, which share a list of names
(``tripped``):

- an interlock, a limit on a measured value or on a residual of :mod:`fsw_supervisor.consistency`,
- ``<sensor>_jump``: it has moved further than the drives can explain, and has not been
  acknowledged,
- ``<sensor>_blind``: under automatic control it has been invalid for too long, summed over time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan
from typing import Any

from fsw_control import weld
from fsw_control.cause import Cause, Severity
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_control.stop import StopCause
from fsw_control.units import NANOSECONDS, kw_from_w, rad_s_from_rpm
from fsw_control.validity import Flaw, SensorGuard, sensor_limits
from fsw_supervisor.consistency import Consistency
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.parameters import QUANTITIES, SupervisorParameters
from fsw_supervisor.state_machine import Level, Machine, Mode
from fsw_supervisor.tick import GAP_S, Tick

#: levels that must last before they take effect; OK needs no run, as no level is below it
_RAISED = Severity.WARN, Severity.TRIP
_LOG_LEVELS = {Severity.OK: Level.INFO, Severity.WARN: Level.WARN, Severity.TRIP: Level.ERROR}
#: by value, the sensor that it needs
_SENSOR = {**{SENSORS[name].signal: name for name in REQUIRED}, "power_kw": "torque"}
#: quantities of a measurement that interlocks watch
_MEASURED = ("depth_mm", "torque_nm", "temperature_c", "force_kn")
#: trips that a safe stop itself causes: under less force the tool rises and heats less
_CONSEQUENCES = {"depth_low", "temperature_low"}
#: modes in which the process is controlled, or is to be again, without an operator
_AUTOMATIC = (Mode.START, Mode.AUTO, Mode.HOLD)
#: time in which as much blindness is forgiven as has lasted for a tenth of it (chosen)
_FORGIVEN_SHARE = 0.1
#: longest time between two ticks that counts as blindness [s]; a longer gap has rules of its own
_LONGEST_TICK_S = 1.0

#: a single value may be a spike, however long ago the previous one was
_FEWEST_VALUES = 2
#: longer than any time to compare with [s]
_LONGEST_S = 1000.0


@dataclass(slots=True)
class Persistence:
    """Counts values in a row that meet a condition, and the time that they cover.

    Each covers the time since the previous value, the first one a tick period.
    """

    values: int = 0
    age_s: float = 0.0

    def note(self, shown: bool, elapsed_s: float, period_s: float) -> None:
        """Take a value that arrived ``elapsed_s`` after the previous one."""
        if not shown:
            self.values, self.age_s = 0, 0.0
            return
        # The first value covers a period, not the time since the one before, which did not meet
        # the condition: after a gap a single sample must not count for the whole gap.
        self.age_s = min(self.age_s + (elapsed_s if self.values else period_s), _LONGEST_S)
        self.values = min(self.values + 1, _FEWEST_VALUES)

    def reaches(self, limit_s: float, period_s: float) -> bool:
        """Whether it has lasted ``limit_s``, to the nearest tick, in at least two values."""
        return self.values >= _FEWEST_VALUES and self.age_s >= limit_s - period_s / 2.0


@dataclass(frozen=True, slots=True)
class Interlock:
    """A limit on one quantity."""

    name: str  #: e.g. ``temperature_high``; a name that ends in ``_low`` guards against low values
    quantity: str  #: key of the value that it watches, with the unit in the name
    #: limits in that unit
    warn: float
    trip: float
    hysteresis: float  #: how far the value must come back before the level falls

    def level(self, value: float, present: Severity) -> Severity:
        """Level that ``value`` means when the level is ``present``."""
        # The sign turns a guard against low values into one against high ones. Hysteresis holds
        # a level that is there but never raises one, so that noise at a limit does not toggle it.
        sign = 1.0 if self.trip > self.warn else -1.0
        excess_warn, excess_trip = sign * (value - self.warn), sign * (value - self.trip)
        if excess_trip >= 0.0 or (present is Severity.TRIP and excess_trip > -self.hysteresis):
            return Severity.TRIP
        if excess_warn >= 0.0 or (present is not Severity.OK and excess_warn > -self.hysteresis):
            return Severity.WARN
        return Severity.OK


def interlocks_from(values: Mapping[str, Any]) -> tuple[Interlock, ...]:
    """Table of the interlocks from the parameters."""
    keys = "warn", "trip", "hysteresis"
    return tuple(
        Interlock(name, quantity, *(values[f"interlocks.{name}.{key}"] for key in keys))
        for name, quantity in QUANTITIES.items()
    )


class Blindness:
    """Sum of the time each sensor was invalid under automatic control.

    It decays ten times as slowly.
    """

    def __init__(self) -> None:
        self.limit_s = 0.0
        self._sum_s = dict.fromkeys(REQUIRED, 0.0)
        self._last_ns: int | None = None

    def forget_time(self) -> None:
        """The clock went back; the sums stay."""
        self._last_ns = None

    def add(self, now_ns: int, invalid: tuple[str, ...], automatic: bool) -> None:
        """Take the sensors that are invalid at a tick; ``now_ns`` as ``Machine.time_ns``."""
        passed_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) / NANOSECONDS
        passed_s = min(max(passed_s, 0.0), _LONGEST_TICK_S)
        self._last_ns = now_ns
        # Summed, not restarted at each good sample: a sensor that fails every other second would
        # never reach a limit on one stretch. Forgiving a tenth keeps rare dropouts from adding up.
        for name, sum_s in self._sum_s.items():
            if name not in invalid:
                self._sum_s[name] = max(sum_s - _FORGIVEN_SHARE * passed_s, 0.0)
            elif automatic:
                self._sum_s[name] = min(sum_s + passed_s, self.limit_s)

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Sensors whose limit is reached."""
        return tuple(name for name, sum_s in self._sum_s.items() if sum_s >= self.limit_s - 1e-6)


class SafetyMonitor:
    """Judges the process at every tick: sensors and interlocks."""

    def __init__(self, machine: Machine) -> None:
        self.invalid_sensors: tuple[str, ...] = ()  #: those that may not be used at present
        #: since when there is one of them (``Machine.time_ns``), each of which an interlock needs;
        #: None: there is none
        self.blind_since_ns: int | None = None
        self.hold_s = 0.0  #: time for which the last good sample replaces a bad one
        self.judged = False  #: any tick has been judged; before, nothing is known
        self.machine = machine  #: mode and log, to which trips lead
        self._guard = SensorGuard()
        self._consistency = Consistency()
        self._blindness = Blindness()
        self._standing: dict[str, Fact] = {}  # jumps and blindness that are there
        self.configure(machine.settings)
        self._levels = dict.fromkeys(QUANTITIES, Severity.OK)
        self._runs = {name: {level: Persistence() for level in _RAISED} for name in QUANTITIES}
        self._leaving = {name: Persistence() for name in QUANTITIES}
        self._judged_ns: int | None = None
        self._causes: dict[str, Fact] = {}  # of the levels of the interlocks
        self._consequences: set[str] = set()  # interlocks that tripped during the safe stop, by it
        # possible consequences: time without a trip, and whether that was long in this stop
        self._free = {name: Persistence() for name in _CONSEQUENCES}
        self._was_free: set[str] = set()

    def configure(self, settings: SupervisorParameters) -> None:
        """Apply new settings, keeping the state."""
        values = settings.flat()
        self.hold_s = values["validity.hold"]
        self._guard.configure(sensor_limits(values))
        self._blindness.limit_s = values["blind_limit_s"]
        self._interlocks = interlocks_from(values)
        self._persistence_s = values["interlocks.persistence_s"]

    def forget_time(self) -> None:
        """The clock went back: earlier readings do not count any more."""
        self._guard.forget_time()
        self._consistency.forget_time()
        self._blindness.forget_time()

    def readmit(self, who: str) -> None:
        """Readmit sensors that have jumped and are steady: ``who`` acknowledges their values."""
        readmitted = self._guard.readmit()
        for name, value in readmitted.items():
            self._standing.pop(f"{name}_jump", None)
            data = {"who": who, "sensor": name, "value": value}
            self.machine.log(Level.WARN, who, Code.SENSOR_ACKNOWLEDGED, **data)
        still = [name for name in self.invalid_sensors if name not in readmitted]
        self.invalid_sensors = tuple(still)

    @property
    def sensor_flaws(self) -> dict[str, Flaw]:
        """By sensor, why its last sample was not used."""
        return self._guard.reasons

    @property
    def held_sensors(self) -> tuple[str, ...]:
        """Sensors whose last good value stands for their last sample."""
        return self._guard.held

    @property
    def active(self) -> Mapping[str, Severity]:
        """Active warnings and trips, jumps and blindness, by name."""
        levels = {name: level for name, level in self._levels.items() if level}
        return levels | dict.fromkeys(self._standing, Severity.TRIP)

    @property
    def tripped(self) -> tuple[str, ...]:
        """Names of the tripped interlocks, jumps and blindness."""
        levels = [name for name, level in self._levels.items() if level is Severity.TRIP]
        return (*levels, *self._standing)

    def why_stop(self, acknowledged: bool = False) -> Fact | None:
        """Why a safe stop must begin or last; None if it need not.

        With ``acknowledged``, as if sensors that have jumped and are steady were readmitted, and
        without the stop's own consequences: they only keep the mode from being left.
        """
        steady = self._guard.steady if acknowledged else ()
        seen = {f"{sensor}_jump" for sensor in steady}
        if acknowledged:
            seen |= self._consequences
        tripped = [name for name in self.tripped if name not in seen]
        if tripped:
            causes = self._causes | self._standing
            return Fact.of(Code.CAUSE_PRESENT, causes=tuple(causes[name] for name in tripped))
        blind = self._blind(steady)
        stopped = self.machine.mode is Mode.SAFE_STOP
        return Fact.of(Code.CAUSE_UNKNOWN, causes=blind) if stopped and blind else None

    def _blind(self, but: tuple[str, ...]) -> tuple[Fact, ...]:
        """Invalid sensors, and why; empty when all values that interlocks watch are known."""
        if not self.judged:
            return (Fact.of(Code.NOTHING_MEASURED),)
        return tuple(
            Fact.of(Code.SENSOR_INVALID, sensor=name, flaw=self.sensor_flaws[name])
            for name in self.invalid_sensors
            if name not in but
        )

    def judge(self, tick: Tick, acting: Command | None) -> Tick:
        """Judge the samples of a tick; a trip leads to a safe stop.

        ``acting``: force and speed that act. Returns the tick with the sensors that it lacks.
        """
        before, reasons = self.invalid_sensors, self._guard.reasons
        self.judged = True
        missing = (name for name in REQUIRED if name not in tick.samples)
        dropouts = tuple(name for name in missing if not reasons[name])
        measurement = self._guard.measure(tick.stamp_ns / NANOSECONDS, tick.samples, acting)
        self.invalid_sensors = measurement.invalid_sensors()
        if not self.invalid_sensors:
            self.blind_since_ns = None
        elif self.blind_since_ns is None:
            self.blind_since_ns = self.machine.time_ns
        for name in self.invalid_sensors:
            if name not in before:
                data = {"sensor": name, "flaw": reasons[name]}
                self.machine.log(Level.WARN, "sensors", Code.SENSOR_INVALID, **data)
        for name in before:
            if name not in self.invalid_sensors:
                self.machine.log(Level.INFO, "sensors", Code.SENSOR_VALID, sensor=name)
        self._blindness.add(self.machine.time_ns, self.invalid_sensors, self._is_automatic)
        self._note_standing(tick.samples)
        residuals = self._consistency.update(measurement)
        known = {
            **{name: getattr(measurement, name) for name in _MEASURED},
            **residuals._asdict(),
            "depth_deviation_mm": tick.depth_deviation_mm,
            "power_kw": kw_from_w(measurement.torque_nm * rad_s_from_rpm(measurement.speed_rpm)),
        }
        # A rejected sample may be the truth all the same: beyond a trip it counts, so that a worse
        # fault never leads to a later stop (requirement S36). NaN says nothing.
        rejected = {
            SENSORS[name].signal: value
            for name, value in tick.samples.items()
            if reasons[name] and not isnan(value)
        }
        if "torque_nm" in rejected:
            rate_rad_s = rad_s_from_rpm(measurement.speed_rpm)
            rejected["power_kw"] = kw_from_w(rejected["torque_nm"] * rate_rad_s)
        self.watch(known, measurement.held, rejected, self._since_judged_s())
        if self.invalid_sensors and self.machine.acknowledged:
            # from now on it is unknown whether a cause is present
            self.machine.renew(StopCause.BLIND, "sensors")
        return tick._replace(judged=True, dropouts=dropouts)

    @property
    def _is_automatic(self) -> bool:
        """Whether nobody but a controller watches the process."""
        return self.machine.mode in _AUTOMATIC and self.machine.target_mode is Mode.AUTO

    def _note_standing(self, samples: Mapping[str, float]) -> None:
        """Determine which sensors have jumped, and which have been invalid for too long."""
        before, self._standing = self._standing, {}
        for name, last_good in self._guard.jumped.items():
            cause, shown = f"{name}_jump", samples.get(name, nan)
            data = {"interlock": cause, "quantity": SENSORS[name].signal}
            fact = Fact.of(Code.SENSOR_JUMPED, **data, value=shown, last_good=last_good)
            # the first fact stays: it has the value with which the sensor jumped
            self._standing[cause] = before.get(cause, fact)
        # In manual the operator watches, and a time-out of its own ends it (BLIND_TIMEOUT).
        if self._is_automatic or self.machine.mode is Mode.SAFE_STOP:
            for name in self._blindness.exceeded:
                cause = f"{name}_blind"
                flaw, limit_s = self.sensor_flaws[name], self._blindness.limit_s
                fact = Fact.of(Code.SENSOR_BLIND, interlock=cause, flaw=flaw, limit_s=limit_s)
                self._standing[cause] = before.get(cause, fact)
        for cause, fact in self._standing.items():
            if cause not in before:
                self.machine.log(Level.ERROR, "interlock", fact.code, **fact.data)
        for cause in before:
            if cause not in self._standing:
                self.machine.log(Level.INFO, "interlock", Code.CLEARED, interlock=cause)

    def _since_judged_s(self) -> float:
        """Time since the last judged tick; one tick period for the first, and after a gap."""
        before_ns, self._judged_ns = self._judged_ns, self.machine.time_ns
        elapsed_s = inf if before_ns is None else (self.machine.time_ns - before_ns) / NANOSECONDS
        return elapsed_s if elapsed_s <= GAP_S else self.machine.settings.tick_period_s

    def watch(
        self,
        values: Mapping[str, float],
        held: tuple[str, ...] = (),
        rejected: Mapping[str, float] | None = None,
        elapsed_s: float = weld.TICK_S,
    ) -> None:
        """Compare values by quantity with the interlocks.

        A missing or non-finite value changes nothing.

        ``rejected`` are samples that are not valid: one beyond a trip, infinity too, counts as
        such, any other changes nothing.

        A level takes effect when the values of the last ``interlocks.persistence_s``, two at
        least, were each at that level or worse: a spike does not trip. A trip is gone after as
        long without it. Values of sensors that are ``held`` are no new ones: they neither trip nor
        clear. A trip acts for as long as it lasts, in every mode, not only when it begins.
        ``elapsed_s`` is the time since the values before.
        """
        before, stopped = set(self.tripped), self.machine.mode is Mode.SAFE_STOP
        if not stopped:
            self._was_free.clear()
        for item in self._interlocks:
            value, bad = values.get(item.quantity, nan), (rejected or {}).get(item.quantity, nan)
            if not isnan(bad) and item.level(bad, Severity.OK) is Severity.TRIP:
                self._judge(item, bad, elapsed_s)
            elif isfinite(value) and _SENSOR.get(item.quantity) not in held:
                self._judge(item, value, elapsed_s)
        tripped = set(names := self.tripped)
        # What was free of a trip during a stop, and trips later, cannot be its cause. Being free
        # has to last as long as a trip has to: a single value between two trips proves nothing.
        # A restart forgets it, and then a trip refuses: unknown counts as a cause.
        new = (tripped - before) & self._was_free
        self._consequences = (self._consequences & tripped if stopped else set()) | new
        if not tripped:
            return
        if stopped:
            if self.machine.acknowledged and tripped - self._consequences:
                self.machine.renew(StopCause.INTERLOCK, "interlock")
        else:
            reason = Reason(ReasonCode.INTERLOCKS, interlocks=names)
            self.machine.fire(Cause.INTERLOCK_TRIP, reason, "interlock")

    def _judge(self, item: Interlock, value: float, elapsed_s: float) -> None:
        """Determine the level of an interlock."""
        present, runs = self._levels[item.name], self._runs[item.name]
        period_s, leaving = self.machine.settings.tick_period_s, self._leaving[item.name]
        limit_s = self._persistence_s
        shown = item.level(value, present)
        if (free := self._free.get(item.name)) is not None:
            stopped = self.machine.mode is Mode.SAFE_STOP
            free.note(stopped and shown is not Severity.TRIP, elapsed_s, period_s)
            if free.reaches(limit_s, period_s):
                self._was_free.add(item.name)
        if not (shown or present or runs[Severity.WARN].values or leaving.values):
            return  # as nearly always: nothing is there, and nothing was
        # Levels are nested: a value at trip is also one at warning. So the run of a level counts
        # values at it or worse, and one trip value among warnings does not restart the warning.
        for level in _RAISED:
            runs[level].note(shown >= level, elapsed_s, period_s)
        leaves = present is Severity.TRIP and shown is not Severity.TRIP
        leaving.note(leaves, elapsed_s, period_s)
        if leaves and not leaving.reaches(limit_s, period_s):
            return
        lasting = {level for level in _RAISED if runs[level].reaches(limit_s, period_s)}
        level = min(shown, max({present, *lasting}))
        if level is present:
            return
        self._levels[item.name] = level
        data = {"interlock": item.name, "quantity": item.quantity}
        fact = self._causes[item.name] = Fact.of(Code.INTERLOCK, level=level, value=value, **data)
        self.machine.log(_LOG_LEVELS[level], "interlock", fact.code, **fact.data)
