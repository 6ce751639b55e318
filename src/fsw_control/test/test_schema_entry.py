"""Programs that are imported when they are called."""

import subprocess
import sys

import pytest

SLOW = """
import os, signal, sys
def end(sign):
    os.kill(os.getpid(), sign)
    while True:
        pass
if "interrupted" in sys.argv:
    end(signal.SIGINT)
if "terminated" in sys.argv:
    end(signal.SIGTERM)
def main():
    if "later" in sys.argv:
        end(signal.SIGINT)
    print("begins", signal.getsignal(signal.SIGINT) is signal.default_int_handler)
    return 3
"""


QUIET = (0, "", "")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], (3, "begins True\n", "")),
        (["interrupted"], QUIET),
        (["terminated"], QUIET),
        (["later"], QUIET),
    ],
)
def test_a_program_is_called_or_ends_quietly_while_it_is_imported(tmp_path, words, expected):
    (tmp_path / "slow").mkdir()
    (tmp_path / "slow" / "node.py").write_text(SLOW)
    path = [str(tmp_path), *filter(None, sys.path)]
    # as the scripts do that setuptools makes of entry points
    code = (
        f"import sys; sys.path[:] = {path!r}; from fsw_control.schema.entry import slow; "
        "sys.exit(slow.node.main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == expected
