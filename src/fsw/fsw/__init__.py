"""The command line: a module per command parses its arguments and calls what does the work."""

import fsw_scenario  # noqa: F401  (before numpy: it sets the threads of the linear algebra)
