"""Scenarios and weld programmes as data, run in one process or in the graph."""

import os

# The matrices here are small: threads of the linear algebra only get into each other's way, and
# into that of other processes. Takes effect when numpy is not loaded yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
