"""A simple PLC behind the gateway: its drives follow at once.

Without commands its watchdog lowers the force.
"""

from __future__ import annotations

from importlib import resources
from math import nan

from fsw_control.contract import Command
from fsw_control.parameters import defaults
from fsw_machine.gateway import Gateway
from fsw_machine.machine_file import MachineFile
from fsw_machine.parameters import GatewayParameters
from fsw_machine.samples import CycleRead, RawValue
from fsw_plant.config import PlantConfig
from fsw_plant.emulator import Watchdog

MACHINE = MachineFile.parse((resources.files("fsw_machine") / "machine.yaml").read_text())


def new_gateway() -> Gateway:
    """A gateway with its default parameters that is not connected yet."""
    return Gateway(MACHINE, defaults(GatewayParameters))


class Plc:
    """Set-points in force, the cycle counter and the machine's own watchdog."""

    def __init__(self, config: PlantConfig, in_force: Command) -> None:
        self.watchdog = Watchdog(config)
        self.in_force = in_force
        self.counter = 100

    def cycle(self) -> None:
        """Let one cycle pass: without commands the machine goes to its own safe state."""
        self.counter += 1
        self.in_force = self.in_force._replace(
            force_kn=self.watchdog.advance(self.in_force.force_kn)
        )

    def take(self, command: Command) -> None:
        """Put a command in force."""
        self.in_force = command
        self.watchdog.feed()

    def read(
        self,
        clock_ns: int,
        now_s: float,
        acting: Command,
        sensors: tuple[float, float, float] = (2.66, 980.0, nan),
        steps: int = 1,
        permissive: bool = True,
    ) -> CycleRead:
        """The cycle as the gateway reads it.

        ``sensors``: depth, torque and temperature [mm, N m, degC].
        """
        numbers = dict(zip(("depth", "torque", "temperature"), sensors, strict=True))
        numbers |= {"force_acting": acting.force_kn, "speed_acting": acting.speed_rpm}
        numbers |= {
            "force_in_force": self.in_force.force_kn,
            "speed_in_force": self.in_force.speed_rpm,
        }
        values = {name: RawValue(value, source_ns=clock_ns) for name, value in numbers.items()}
        values["permissive"] = RawValue(permissive, source_ns=clock_ns)
        return CycleRead(self.counter, values, clock_ns, now_s, clock_ns, steps)
