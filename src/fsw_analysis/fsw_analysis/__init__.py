"""Analysis of recorded welds: aligned signals, figures of merit, plots, comparison, verdict."""

import os
from contextlib import suppress

from fsw_control.schema.files import user_cache

# Without a home folder that can be written matplotlib warns in several lines.
if not os.access(os.path.expanduser("~"), os.W_OK):
    with suppress(OSError):
        os.environ.setdefault("MPLCONFIGDIR", str(user_cache("matplotlib")))
