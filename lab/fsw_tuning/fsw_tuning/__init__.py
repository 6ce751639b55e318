"""Tuning of the controllers, margins of the loops, standard cases, design of experiments."""
