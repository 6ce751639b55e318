"""Campaigns: many welds of one scenario with parameters drawn at random, on Dask, into one Parquet dataset."""

import fsw_scenario  # noqa: F401  (before numpy: it sets the threads of the linear algebra)
