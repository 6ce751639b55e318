"""``fsw schema``: what an editor gets."""

import json

import pytest

from fsw.main import main
from fsw.schema_command import GROUP, kinds
from fsw_control.schema.extensions import loaded


@pytest.mark.parametrize("name", kinds())
def test_schema_has_the_keys_of_the_model(name, capsys):
    fields = loaded(GROUP, name).model_fields
    assert main(["schema", name]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (
        content["$schema"].startswith("https://json-schema.org/") and content["type"] == "object"
    )
    assert set(content["properties"]) == {field.alias or key for key, field in fields.items()}


def test_unknown_kind_of_file_is_a_usage_error(capsys):
    with pytest.raises(SystemExit) as end:
        main(["schema", "weld"])
    assert end.value.code == 2
