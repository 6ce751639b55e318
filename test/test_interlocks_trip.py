"""Every interlock trips on the emulated plant, by what its sensors and drives report and nothing else."""

import pytest

from fsw_control import weld
from fsw_control.cause import Severity
from fsw_plant import PlantConfig, PlantEmulator
from fsw_plant.event_schema import disturbance, fault
from fsw_supervisor import Arbiter, ProposalInput, SupervisorParameters
from fsw_supervisor.state_machine import Mode

#: by interlock: disturbances and sensor faults of the plant that lead to it, and no other one
_CAUSES = {
    "temperature_low": [("disturbance", "temperature", -30.0)],
    "temperature_high": [("disturbance", "temperature", 96.0)],
    "depth_high": [("disturbance", "depth", 1.0), ("fault", "depth", 0.1)],
    "force_high": [("disturbance", "axial_force", 97.2 - weld.FORCE_KN)],
    "torque_high": [("disturbance", "spindle_speed", -100.0), ("fault", "torque", 680.0)],
    "power_high": [("disturbance", "spindle_speed", 92.0), ("fault", "torque", 300.0)],
}


class Loop:
    """Plant and arbiter, with a controller that repeats the start's command."""

    def __init__(self):
        self.plant = PlantEmulator(PlantConfig.from_values({"noise": False}))
        self.arbiter = Arbiter(SupervisorParameters.from_values({}))
        self.start = self.plant.applied
        self.now_s = 100.0

    def tick(self):
        reading, self.now_s, out = self.plant.measure(), self.now_s + weld.TICK_S, []
        out += self.arbiter.on_drives(reading.stamp_ns, reading.drives, self.now_s)
        for sensor, (sample,) in reading.samples.items():
            out += self.arbiter.on_sample(sensor, sample.stamp_ns, sample.value, self.now_s)
        out += self.arbiter.on_proposal(
            "decentral", ProposalInput(reading.stamp_ns, "decentral", self.start), self.now_s
        )
        out += self.arbiter.on_status("decentral", (), False, self.now_s)
        out += self.arbiter.on_time(self.now_s + 0.08)
        for decision in out:
            assert self.plant.apply(decision.command, decision.stamp_ns, decision.source) == ""
        self.plant.step()

    def run(self, ticks):
        for _ in range(ticks):
            self.tick()
        return self.arbiter.machine.mode


@pytest.mark.requirement("S1")
@pytest.mark.parametrize("interlock", _CAUSES)
def test_interlock_trips_into_a_safe_stop(interlock):
    loop = Loop()
    assert loop.run(10) is Mode.AUTO
    for cause, target, amplitude in _CAUSES[interlock]:
        if cause == "fault":
            loop.plant.begin(fault(target, "bias", amplitude))
        else:
            loop.plant.begin(disturbance(target, "step", amplitude))
    assert loop.run(10) is Mode.SAFE_STOP
    facts = [event.fact for event in loop.arbiter.machine.events if event.fact.code == "interlock"]
    assert (interlock, Severity.TRIP) in [(f.data["interlock"], f.data["level"]) for f in facts]
    also = {
        "power_high": "torque",
        "temperature_high": "thermocouple",
    }  # the sensor that has jumped
    quantities = {interlock.partition("_")[0], also.get(interlock, "")}
    assert {name.partition("_")[0] for name in loop.arbiter.safety.tripped} <= quantities, (
        "by this one and no other"
    )


@pytest.mark.requirement("S1", "S2")
def test_a_push_that_no_command_asked_for_trips_though_the_command_stays_in_its_bounds():
    loop = Loop()
    loop.run(10)
    loop.plant.begin(disturbance("axial_force", "step", 97.2 - weld.FORCE_KN))
    for _ in range(3):
        assert loop.run(1) is Mode.AUTO, "a spike is no trip"
        assert loop.arbiter.applied == loop.start
    assert loop.run(1) is Mode.SAFE_STOP


@pytest.mark.requirement("S2")
def test_a_drives_sample_that_is_lost_hides_nothing():
    """Two of three drive samples are lost; the last one stands in, as with the sensors."""
    loop = Loop()
    loop.run(10)
    loop.plant.begin(disturbance("axial_force", "step", 97.2 - weld.FORCE_KN))
    loop.tick()
    hear, count = loop.arbiter.on_drives, [0]

    def sometimes(*sample):
        count[0] += 1
        return hear(*sample) if count[0] % 3 == 1 else []

    loop.arbiter.on_drives = sometimes
    assert loop.run(6) is Mode.SAFE_STOP
