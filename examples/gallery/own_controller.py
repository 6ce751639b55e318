# %% [markdown]
# # Your own controller against all
#
# Derive from `fsw.Controller` and say which force and speed you want. Bounds, rates and invalid
# sensors are looked after. This one has a PI controller for each output. That of the temperature
# asks for power, and the measured torque, less the friction (23), says which speed gives it: so
# the power stays when the force changes.

# %%
from math import pi

import fsw

friction_nm = fsw.model().equation(23)


class TwoLoops(fsw.Controller):
    name = "two_loops"

    def reset(self, applied):
        self.sums = [0.0, 0.0]
        self.torque_nm = None

    def command(self, measurement, reference, applied):
        depth_mm = reference.depth_mm - measurement.depth_mm
        temperature_c = reference.temperature_c - measurement.temperature_c
        self.sums[0] += 0.1 * depth_mm
        self.sums[1] += 0.1 * temperature_c
        process_nm = measurement.torque_nm - float(friction_nm(applied.speed_rpm))
        self.torque_nm = (
            process_nm if self.torque_nm is None else 0.7 * self.torque_nm + 0.3 * process_nm
        )
        power_kw = 43.6 + 0.25 * temperature_c + 0.008 * self.sums[1]
        return fsw.Command(
            78.4 + 80.0 * depth_mm + 1.0 * self.sums[0], 30000.0 / pi * power_kw / self.torque_nm
        )


# %%
welds = fsw.compare(
    "reference_tracking", [TwoLoops(), "decentral:conservative", "decentral:tight", "nmpc"]
)
welds

# %%
welds.plot(6)
