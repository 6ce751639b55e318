"""Campaigns: many welds of one scenario with random parameters, on Dask, into Parquet."""

import fsw_scenario  # noqa: F401  (before numpy: it sets the threads of the linear algebra)
