"""Ament package of the analysis of recorded welds."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
from _ament import setup_package

setup_package(__file__, "rule_book.yaml")
