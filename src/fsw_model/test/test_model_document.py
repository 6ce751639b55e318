"""The document agrees with the code."""

from pathlib import Path

from fsw_model import ModelParameters, nominal

DOCUMENT = Path(__file__).parents[3] / "docs" / "concepts" / "model.md"


def test_table_of_parameters_and_origins():
    lines = DOCUMENT.read_text(encoding="utf-8").splitlines()
    for name, value in dict(nominal()).items():
        assert (
            f"| `{name}` | {value!r} | {ModelParameters.model_fields[name].description} |" in lines
        )
