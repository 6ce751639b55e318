# %% [markdown]
# # The canister in heat
#
# The paper's process has one constant temperature far away. In a canister the copper conducts,
# warms up and cools round an edge: the same weld needs less and less power. The plant of this
# scenario is a [model of that conduction](../concepts/canister.md), reduced from finite elements.

# %%
import numpy as np

import fsw

weld = fsw.simulate("canister_weld_heat", "decentral:tight")
minutes = weld["time_s"] / 60.0
for minute in (1, 5, 10, 20, 30, 40):
    now = np.searchsorted(minutes, minute)
    power, speed = weld["truth_process_power_kw"][now], weld["truth_speed_rpm"][now]
    print(
        f"{minute:3d} min: {power:5.1f} kW, {speed:5.1f} rpm hold {weld['truth_temperature_c'][now]:.1f} degC"
    )
weld.plot()
