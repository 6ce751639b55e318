"""What the lab adds to ``import fsw``."""

import pytest

import fsw
from fsw_control.schema.extensions import extensions
from fsw_control.schema.models import InputError
from fsw_test_support.doc_examples import check, examples

EXAMPLES = examples(["fsw_lab.identify", "fsw_lab.tasks"])
#: modules that some examples need, which are extras
NEEDED = {"campaign": "distributed", "export_fmu": "fmpy"}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_the_examples_in_the_docstrings(example):
    pytest.importorskip(NEEDED.get(example.name.rpartition(".")[2], "fsw"))
    check(example)


def test_every_public_name_has_an_example():
    shown = {example.name for example in EXAMPLES}
    named = {
        point.value.replace(":", ".")
        for point in extensions("fsw.api").values()
        if point.value.startswith("fsw_lab")
    }
    assert named - shown == {"fsw_lab.identify.Identified"}  # which identify makes
    assert named >= shown


@pytest.mark.parametrize(
    ("call", "facts"),
    [
        (lambda: fsw.identify(), ["identify: ", "one weld"]),
        (lambda: fsw.identify({}), ["table", "columns"]),
        (
            lambda: fsw.identify("bag", start="file"),
            ["identify: start", "ModelParameters", "'file'"],
        ),
        (
            lambda: fsw.identify("bag", drive_lag_s=float("nan")),
            ["drive_lag_s is", "from 0", "not nan"],
        ),
        (lambda: fsw.tune(["nmpc"]), ["tune: controller", "string", "['nmpc']"]),
        (lambda: fsw.tune("decentral:tight", evaluations=0), ["evaluations", "least 1", "not 0"]),
        (
            lambda: fsw.campaign("model_uncertainty", "folder", workers=0),
            ["workers", "least 1", "not 0"],
        ),
        (lambda: fsw.export_c("decentral", {}), ["export_c: folder", "Path", "{}"]),
        (
            lambda: fsw.export_fmu("plant", "x.fmu", platforms="win64"),
            ["platforms is", "Sequence", "'win64'"],
        ),
    ],
)
def test_an_argument_of_a_wrong_type_is_named_in_one_line(call, facts):
    with pytest.raises(InputError) as raised:
        call()
    text = str(raised.value)
    assert [fact for fact in facts if fact not in text] == [] and "\n" not in text
