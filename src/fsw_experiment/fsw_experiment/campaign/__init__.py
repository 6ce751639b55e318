"""Campaigns: many welds of one scenario with parameters drawn at random, on Dask, into one Parquet dataset."""
