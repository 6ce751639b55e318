"""The start of the gateway's node where its library is not installed."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow


def test_without_its_library_it_says_what_to_install_in_a_line():
    pytest.importorskip("cryptography")  # which is imported first
    code = "import sys; sys.modules['asyncua'] = None; import fsw_machine.machine_node"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (2, "fsw_machine: asyncua is missing: pip install asyncua\n")
