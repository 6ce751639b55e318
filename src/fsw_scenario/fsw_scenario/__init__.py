"""Scenarios and weld programmes as data, run in a single process or in the graph."""

import os

# The matrices here are small: threads of the linear algebra would only slow each other and other
# processes. Takes effect unless numpy is loaded already.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
