# %% [markdown]
# # Why decoupling matters
#
# Deeper is hotter, and hotter is softer and therefore deeper. The relative gain array of the
# linearised process says how much: it would be 1 on the diagonal if each output followed its own
# input alone.

# %%
import control
import numpy as np

import fsw

plant = fsw.model().linearise()[:2, :]  # force and speed to depth and temperature
omega = np.array([0.01, 0.03, 0.1, 0.3, 1.0])
gains = np.moveaxis(control.frequency_response(plant, omega).frdata, 2, 0)
for frequency, gain in zip(omega, gains, strict=True):
    relative = gain * np.linalg.inv(gain).T
    print(f"{frequency:5.2f} rad/s: relative gain force-depth {abs(relative[0, 0]):.2f}")

# %% [markdown]
# A step of the depth by 0.2 mm moves the temperature, too. Two loops that do not know of each
# other see that only when it has happened, after the dead time of 2.8 s; the predictive controller
# moves the speed with the force. Noise is off.

# %%
both = fsw.compare(
    "reference_tracking", ["decentral:tight", "decentral:smith", "nmpc"], noise=False
)
for label, weld in both.items():
    print(
        f"{label:<16} {weld.kpi['peak_temperature_in_depth_step_up_c']:5.2f} degC beside the set-point"
    )
both.plot(6)

# %% [markdown]
# What that takes is in the inputs:

# %%
both.plot(7)
