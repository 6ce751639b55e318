# %% [markdown]
# # The whole weld's record
#
# 45 minutes around the canister: dwell, start, down to the joint line, once around, overlap,
# parking; with slow heating, edges, drifts and wear of the tool. Here it runs over DDS, in
# processes, as fast as they can, as by `fsw demo` on the command line.

# %%
import io
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

import fsw
from fsw.main import main
from fsw_analysis import phase_kpi

folder = Path(tempfile.mkdtemp())
with redirect_stdout(io.StringIO()):
    main(
        [
            "demo",
            "--scenario",
            "canister_weld",
            "--controller",
            "nmpc",
            "--out",
            str(folder / "welded"),
        ]
    )
bag = folder / "welded" / "canister_weld" / "nmpc" / "bag"
weld = fsw.read_bag(bag, "nmpc")
weld.plot()

# %% [markdown]
# The figures of merit of each phase:

# %%
phases = phase_kpi.recorded_spans(weld.signals)
print(phase_kpi.markdown([phase_kpi.compute(weld.signals, weld.label, phases)]))

# %% [markdown]
# Its record, judged by the welding procedure `copper_lid`; [as a page and
# PDF](../how-to/record.md), too:

# %%
record = fsw.record(bag, "copper_lid", folder / "record")
print(record.verdict)
for rule in record.rules:
    print(f"{rule.verdict:<7} {rule.words}: {rule.figure}")
