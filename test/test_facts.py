"""Facts travel as fields: nothing in the tree reads a sentence of ours back."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: names of fields and variables that hold sentences
PROSE = {"reason", "text", "message", "words", "detail", "why", "msg", "said", "sentence"}
#: methods and functions that take a text apart, or look into it
READS = {
    "startswith",
    "endswith",
    "partition",
    "rpartition",
    "split",
    "removeprefix",
    "removesuffix",
    "find",
    "index",
}
MATCHES = {"search", "match", "fullmatch", "findall", "finditer"}
#: texts that other software or a person wrote
FOREIGN = {}
PYTHON = [
    path
    for top in ("src", "quality", "lab")
    for path in sorted(ROOT.glob(f"{top}/*/*/**/*.py"))
    if "test" not in path.parts
]
OTHERS = [
    path
    for name in ("scripts", "benchmarks", "lab/studies", "examples")
    for path in sorted(ROOT.glob(f"{name}/**/*.py"))
    if "test" not in path.parts
]
PAGE = [
    path
    for top in ("src", "quality", "lab")
    for path in sorted((ROOT / top).rglob("*.js"))
    if "node_modules" not in path.parts
]
_FIELD = rf"\.({'|'.join(sorted(PROSE))})\b"
IN_PAGE = re.compile(
    rf"\b({'|'.join(sorted(PROSE))})\??\.(split|match|startsWith|endsWith|includes|indexOf|slice)\("
    rf"|{_FIELD} ?[=!]== ?[\"'`]\w|\.(test|exec|has|includes)\([\w.?]*{_FIELD}\)|switch ?\([\w.?]*{_FIELD}\)"
)


def holds_prose(node: ast.AST) -> bool:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str":
        return any(map(holds_prose, node.args))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return node.func.attr in ("lower", "strip", "casefold") and holds_prose(node.func.value)
    # a variable `text` is mostly what a person or a file gives
    names = PROSE - {"text"}
    if isinstance(node, ast.Attribute):
        return node.attr in PROSE
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        return node.slice.value in PROSE
    return isinstance(node, ast.Name) and (
        node.id in names or node.id.endswith(("_reason", "_words"))
    )


def is_words(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant) and isinstance(node.value, str) and bool(node.value.strip())
    )


def is_constant(node: ast.AST) -> bool:
    if isinstance(node, ast.Attribute) and node.attr in PROSE:
        return is_constant(node.value)  # the words of a constant
    return is_words(node) or (isinstance(node, ast.Name) and node.id.isupper())


def reads(node: ast.AST) -> bool:
    """Whether a sentence is read.

    ``text.startswith(...)``, ``re.search(..., text)``, ``"x" in text``.
    """
    if isinstance(node, ast.Match):
        return holds_prose(node.subject)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        owner, method = node.func.value, node.func.attr
        is_re = isinstance(owner, ast.Name) and owner.id == "re" and method in ("split", "sub")
        return (method in READS and bool(node.args) and holds_prose(owner)) or (
            (is_re or method in MATCHES) and any(map(holds_prose, node.args))
        )
    if isinstance(node, ast.Compare):
        [*operators], sides = node.ops, [node.left, *node.comparators]
        # a variable may be a mapping
        is_text = is_words(sides[0]) or not isinstance(sides[1], ast.Name)
        among = isinstance(sides[1], ast.Tuple | ast.List | ast.Set) and sides[1].elts
        is_phrase = is_words(sides[0]) and " " in sides[0].value.strip()
        looks_in = isinstance(operators[0], ast.In | ast.NotIn) and (
            (is_text and holds_prose(sides[1]))
            or (is_phrase and isinstance(sides[1], ast.Name))
            or (holds_prose(sides[0]) and among and any(map(is_words, among)))
        )
        is_equal = (
            isinstance(operators[0], ast.Eq | ast.NotEq)
            and any(map(holds_prose, sides))
            and any(map(is_constant, sides))
        )
        return looks_in or is_equal
    return False


def sentences_read(source: str) -> list[int]:
    return [node.lineno for node in ast.walk(ast.parse(source)) if reads(node)]


def test_nothing_reads_a_sentence_of_ours():
    keys = {
        path.relative_to(ROOT).as_posix(): sentences_read(path.read_text("utf-8"))
        for path in [*PYTHON, *OTHERS]
    }
    assert {path: lines for path, lines in keys.items() if lines and path not in FOREIGN} == {}


def test_the_page_reads_no_sentence_of_ours():
    assert [
        f"{path.name}: {match[0]}"
        for path in PAGE
        for match in IN_PAGE.finditer(path.read_text("utf-8"))
    ] == []


def test_no_interlock_has_its_level_in_its_name():
    joined = re.compile(r""":(warn|trip)["'`]|\}:\{(level|severity)""", re.IGNORECASE)
    sources = [*PYTHON, *OTHERS, *PAGE]
    assert [path.name for path in sources if joined.search(path.read_text("utf-8"))] == []
    assert joined.search('name.endswith(":warn")') and joined.search('f"{name}:{level}"')


@pytest.mark.parametrize(
    "line",
    [
        'swap.reason.startswith("on request")',
        're.search("operator", event.text)',
        "_WHO.match(event.text)",
        '"start infeasible" in candidate.reason',
        'message.removeprefix("refused: ")',
        'state.reason == "operator"',
        're.split(" is trip", row["reason"])',
        "first_reason != NO_SET_POINT",
        "words == NO_SET_POINT.words",
        "any(word in event.text for word in WORDS)",
        "pattern.fullmatch(str(event.text))",
        'any("not white" in line for line in remarks(summary))',
        'answer.message.lower().startswith("no ")',
        'reason in ("frozen", "too fast")',
        """match line["reason"]:\n    case "frozen": pass""",
    ],
)
def test_a_sentence_that_is_read_is_found(line):
    assert sentences_read(line) == [1]


#: message -> the field that says why or what, as a number; and the sentences that may go with it
FACTS = {
    "SupervisorState": ("uint8 cause", set()),
    "ControllerHealth": ("uint8 lack", set()),
    "WeldCommand": ("Reason why", set()),
    "ControllerStatus": ("Reason why", set()),
    "Reason": ("uint8 code", {"detail"}),
    "OperatorAction": ("uint8 kind", {"action", "message"}),
    "AlarmEvent": ("uint8 kind", {"text", "reason"}),
}


@pytest.mark.parametrize("name", FACTS)
def test_messages_say_by_a_number_what_was_and_why(name):
    lines = (ROOT / f"src/fsw_msgs/msg/{name}.msg").read_text("utf-8").splitlines()
    fact, sentences = FACTS[name]
    fields = [
        line.split()[:2]
        for line in lines
        if line.strip() and not line.startswith("#") and "=" not in line
    ]
    assert fact.split() in fields
    texts = PROSE | {"action", "event"}
    assert {field for kind, field in fields if kind == "string" and field in texts} == sentences


def test_no_header_carries_a_term_or_a_name():
    written = re.compile(r"frame_id\s*=(?!=)|\bHeader\([^)]*frame_id")
    assert [path.name for path in PYTHON if written.search(path.read_text("utf-8"))] == []


def test_spaces_may_be_put_in_order():
    assert sentences_read('" ".join(text.split())') == []
