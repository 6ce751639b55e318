# %% [markdown]
# # A campaign
#
# Many welds whose process differs from the model: every parameter of the shipped campaign `model_uncertainty`
# is drawn at random. `fsw campaign` runs them on all cores and leaves one Parquet dataset. Here are 8 welds for
# each of three controllers; [the results](../results/campaign.md) have 2,000.

# %%
import io
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

import pyarrow.parquet

from fsw.main import main

folder = Path(tempfile.mkdtemp()) / "campaign"
with redirect_stdout(io.StringIO()):
    main(["campaign", "model_uncertainty", "--welds", "8", "--out", str(folder)])
welds = pyarrow.parquet.read_table(folder / "welds").to_pandas()
welds.groupby("controller")[["iae_depth_mm_s", "iae_temperature_c_s"]].describe().T.round(2).to_string()
