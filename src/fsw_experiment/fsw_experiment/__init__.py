"""Demonstration and command line."""

import fsw_scenario  # noqa: F401  (before numpy: it sets the threads of the linear algebra)
