# %% [markdown]
# # First weld in five lines
#
# One minute of a weld: a step of the depth at 5 s, one of the temperature at 20 s, and a
# disturbance of the depth at 40 s.

# %%
import fsw

weld = fsw.simulate("quick", controller="nmpc")
error_um = 1e3 * (weld["truth_depth_mm"] - weld["reference_depth_mm"])
print(f"depth error at the end: {error_um[-1]:.1f} um")
weld.plot()

# %% [markdown]
# All signals are arrays with a value per tick of 0.1 s, and `to_pandas()` makes a table of them.

# %%
weld.to_pandas()[
    ["reference_depth_mm", "depth_mm", "temperature_c", "force_kn", "speed_rpm"]
].iloc[48:56].round(2)

# %% [markdown]
# `weld.kpi` has the figures of merit. Two controllers are compared by one line:

# %%
fsw.compare("quick", ["decentral:tight", "nmpc"])
