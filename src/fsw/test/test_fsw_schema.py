"""``fsw schema``: what an editor gets."""

import json
from importlib import import_module

import pytest

from fsw.main import main
from fsw.schema_command import FILES


@pytest.mark.parametrize("name", FILES)
def test_schema_has_the_keys_of_the_model(name, capsys):
    module, model = FILES[name]
    fields = getattr(import_module(module), model).model_fields
    assert main(["schema", name]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["$schema"].startswith("https://json-schema.org/") and content["type"] == "object"
    assert set(content["properties"]) == {field.alias or key for key, field in fields.items()}


def test_unknown_kind_of_file_is_a_usage_error(capsys):
    with pytest.raises(SystemExit) as end:
        main(["schema", "weld"])
    assert end.value.code == 2
