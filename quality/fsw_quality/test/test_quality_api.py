"""What the quality distribution adds to ``import fsw``."""

import pytest

import fsw
from fsw_control.schema.models import InputError
from fsw_test_support.doc_examples import check, examples


@pytest.mark.parametrize(
    "example", examples(["fsw_quality.api"]), ids=lambda example: example.name
)
def test_the_examples_in_the_docstrings(example):
    check(example)


def test_an_argument_of_a_wrong_type_is_named_in_one_line():
    with pytest.raises(InputError, match=r"bag is 3\b"):
        fsw.record(3, "copper_lid")
