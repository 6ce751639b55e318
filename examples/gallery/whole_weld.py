# %% [markdown]
# # The whole weld
#
# 45 minutes around the canister: dwell, start, down to the joint line, once around, overlap, parking; with slow
# heating, edges, drifts and wear of the tool.

# %%
import fsw
from fsw_analysis import phase_kpi
from fsw_scenario.scenario_file import load
from fsw_scenario.weld_programme import spans

weld = fsw.simulate("canister_weld", "nmpc")
weld.plot()

# %% [markdown]
# The figures of merit of each phase:

# %%
phases = spans(load("canister_weld").phases, weld.signals.duration_s + 0.1)
print(phase_kpi.markdown([phase_kpi.compute(weld.signals, weld.label, phases)]))

# %% [markdown]
# Welded in the graph, by `fsw demo --scenario canister_weld`, the same weld leaves a bag, and `fsw record BAG
# --procedure copper_lid --out DIR` judges it: [the record of a weld](../how-to/record.md).
