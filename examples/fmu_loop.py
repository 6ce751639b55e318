"""Two FMUs in closed loop: .venv/bin/python examples/fmu_loop.py plant.fmu nmpc.fmu"""

import sys
from typing import Any

from fmpy import extract, read_model_description
from fmpy.simulation import instantiate_fmu


class Unit:
    def __init__(self, path, folder=None, **parameters):
        model = read_model_description(path)
        self.variables = {v.name: v for v in model.modelVariables}
        self.inputs = {v.name for v in model.modelVariables if v.causality == "input"}
        self.fmu: Any = instantiate_fmu(extract(path, folder), model, "CoSimulation")
        self.set(**parameters)
        self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, name):
        v = self.variables[name]
        return getattr(self.fmu, f"get{v.type}")([v.valueReference])[0]

    def set(self, **values):
        for v, value in ((self.variables[name], value) for name, value in values.items()):
            getattr(self.fmu, f"set{v.type}")([v.valueReference], [value])

    def feed(self, other):
        outputs = [v.name for v in self.variables.values() if v.causality == "output"]
        other.set(**{name: self.get(name) for name in outputs if name in other.inputs})


def step(plant, controller, number):
    plant.feed(controller)  # what the sensors show at this time ...
    controller.fmu.doStep(0.1 * number, 0.1)
    controller.feed(plant)  # ... and the command that answers it
    plant.fmu.doStep(0.1 * number, 0.1)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    plant, controller = Unit(sys.argv[1]), Unit(sys.argv[2])
    if "reference_depth_mm" not in controller.inputs:
        sys.exit("give the plant first, then the controller")
    if "drives_valid" in controller.inputs:
        controller.set(drives_valid=True)
    for number in range(600):
        if number == 100:
            controller.set(reference_depth_mm=2.76)
        step(plant, controller, number)
        if number % 50 == 0:
            print(
                f"{0.1 * number:4.1f} s {plant.get('depth_mm'):.4f} mm "
                f"{plant.get('temperature_c'):.2f} degC"
            )
