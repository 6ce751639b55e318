"""The document agrees with the code."""

from dataclasses import asdict
from pathlib import Path

from fsw_model import nominal
from fsw_model.parameters import ORIGIN

DOCUMENT = Path(__file__).parents[3] / "docs" / "concepts" / "model.md"


def test_table_of_parameters_and_origins():
    lines = DOCUMENT.read_text(encoding="utf-8").splitlines()
    for name, value in asdict(nominal()).items():
        assert f"| `{name}` | {value!r} | {ORIGIN[name]} |" in lines
