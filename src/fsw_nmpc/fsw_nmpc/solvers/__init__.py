"""Solvers of the NMPC's problem, one interface."""
