# %% [markdown]
# # A campaign
#
# Many welds whose process differs from the model: every parameter of the shipped campaign
# `model_uncertainty` is drawn at random. `fsw.campaign` runs them on all cores and leaves one
# Parquet dataset. Here are 8 welds for each of three controllers; [the
# results](../results/campaign.md) have 2,000.

# %%
import tempfile

import fsw

welds = fsw.campaign("model_uncertainty", tempfile.mkdtemp(), welds=8).to_pandas()
welds.groupby("controller")[["iae_depth_mm_s", "iae_temperature_c_s"]].describe().T.round(
    2
).to_string()
