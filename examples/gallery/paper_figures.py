# %% [markdown]
# # The paper's Figs. 4 to 9
#
# *Simulation based evaluation of a nonlinear model predictive controller for friction stir welding
# of nuclear waste canisters* (Nielsen, Garpinger, Cederqvist, ECC 2013) shows the process in open
# loop and two controllers on steps of the set-points and of disturbances. The sizes of the steps
# are not in the paper; they are chosen. ## Open loop: Figs. 4 and 5

# %%
import fsw

fsw.simulate("open_loop_force_steps").plot(4)

# %%
fsw.simulate("open_loop_speed_steps").plot(5)

# %% [markdown]
# ## Set-points: Figs. 6 and 7

# %%
tracking = fsw.compare("reference_tracking", ["decentral", "nmpc"])
tracking.plot(6)

# %%
tracking.plot(7)

# %% [markdown]
# ## Disturbances of the outputs: Figs. 8 and 9

# %%
disturbed = fsw.compare("output_disturbances", ["decentral", "nmpc"])
disturbed.plot(8)

# %%
disturbed.plot(9)
