"""Experiments: scenarios as data, run in one process or in the graph; their KPIs and figures."""
