# %% [markdown]
# # Identify and tune
#
# A machine whose copper takes up heat faster and whose tool sinks more easily than in the paper:

# %%
import tempfile
from pathlib import Path

import fsw

machine = {
    "factors.thermal_gain_c_per_kw": 1.25,
    "factors.depth_gain_mm_per_kn_s": 1.4,
    "factors.dead_time_s": 1.2,
}
experiment = fsw.simulate("identify_closed_loop", plant=machine)

# %% [markdown]
# The experiment moves the set-points under control, so that the weld stays good. Its sensors and
# the drives' feedback are enough for the parameters that a weld can show:

# %%
found = fsw.identify(experiment)
for name, std in found.std.items():
    true = getattr(fsw.model().parameters, name) * machine.get(f"factors.{name}", 1.0)
    print(f"{name:<24} {getattr(found.parameters, name):10.5g} +- {std:<8.2g} true {true:.5g}")

# %% [markdown]
# The NMPC with the identified model instead of the paper's, on this machine:

# %%
file = Path(tempfile.mkdtemp()) / "model.yaml"
file.write_text(found.text, encoding="utf-8")
before = fsw.simulate("reference_tracking", "nmpc", plant=machine, noise=False)
after = fsw.simulate(
    "reference_tracking", "nmpc", plant=machine, noise=False, parameters={"model_file": str(file)}
)
before.label, after.label = "paper's model", "identified model"
both = fsw.Comparison({weld.label: weld for weld in (before, after)})
both

# %%
both.plot(6)
