"""Friction stir welding, simulated, controlled and analysed: a public API, and the command line beside it."""

import fsw_scenario  # noqa: F401  (before numpy: it sets the threads of the linear algebra)

__version__ = "0.1.0"
