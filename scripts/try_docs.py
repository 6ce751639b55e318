#!/usr/bin/env python3
"""Runs the code blocks of the documentation as a reader would, also those that take minutes.

usage: try_docs.py [PAGE ...]

Each line says which block ran, for how long, and with what result; blocks that cannot run here
(`not run` and why, in the page) are listed, too. The exit code is 1 when one failed.
"""

import sys
import tempfile
import time
from pathlib import Path

from _bootstrap import TEST_EXTRAS, WORKSPACE, ensure

if __name__ == "__main__":
    ensure(dev=True, extras=TEST_EXTRAS)
sys.path.insert(0, str(WORKSPACE / "test" / "support"))

from fsw_test_support.doc_blocks import Page, pages


def main() -> int:
    """Run the blocks of the pages given, or of all; the exit code is 1 when one failed."""
    failed = 0
    with tempfile.TemporaryDirectory() as root:
        for path in map(Path.resolve, map(Path, sys.argv[1:])) if sys.argv[1:] else pages():
            page = Page(path, Path(root))
            for block in page.blocks:
                if block.not_run:
                    print(f"{block}: {block.mark}", flush=True)
                    continue
                began_s = time.monotonic()
                error = page.run(block)
                failed += bool(error)
                took = f"{time.monotonic() - began_s:.1f} s"
                print(f"{block}: {took}, {error or 'ok'}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
