"""Ament package fsw_export."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
from _ament import setup_package

setup_package(__file__, "targets.json", "c/*", "c/cortex_m7/*", "fmi/*", "templates/*")
