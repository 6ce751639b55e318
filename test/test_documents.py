"""Every command line in the documentation is one that its program takes, and the safety case is whole."""

from __future__ import annotations

import importlib.util
import io
import json
import re
import shlex
import sys
from contextlib import redirect_stderr
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from fsw.demo import parser as demo_parser
from fsw.main import parser as operator_parser
from fsw_control.parameters import NodeParameters, describe
from fsw_control.schema.extensions import all_loaded
from fsw_hmi.main import parser as hmi_parser
from fsw_test_support import doc_blocks
from fsw_test_support.machine_server import parser as machine_server_parser

WORKSPACE = Path(__file__).resolve().parent.parent
PAGES = [
    *(WORKSPACE / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((WORKSPACE / "docs").rglob("*.md")),
    *sorted((WORKSPACE / "lab" / "studies").glob("*/README.md")),
]
PARSERS = {
    "fsw.py": cache(operator_parser),
    "demo.py": cache(demo_parser),
    "run_hmi.py": cache(hmi_parser),
    "run_machine_server.py": cache(machine_server_parser),
}
PROGRAM = re.compile(r"(\.venv/bin/python|python3|(scripts/)?fsw\.py|fsw|scripts/\w+\.py) ")
FOLDERS = ("scripts/", "src/", "lab/", "quality/", "test/", "examples/", "benchmarks/", "docs/")


def commands_of(text: str) -> list[str]:
    """Commands in a page that call one of the project's programs, without those shortened by ``…``."""
    return [
        line
        for line in doc_blocks.lines_of(text)
        if PROGRAM.match(line) and not re.search(r"…|\.\.\.|\bNAME\b", line)
    ]


def commands() -> list[tuple[str, str]]:
    """Page and text of each command on the committed pages."""
    return sorted(
        {
            (str(page.relative_to(WORKSPACE)), line)
            for page in PAGES
            for line in commands_of(page.read_text("utf-8"))
        }
    )


@cache
def parameters() -> set[str]:
    """Names of the parameters of all nodes."""
    models = all_loaded("fsw.schemas").values()
    return {
        "use_sim_time",
        *(
            name
            for model in models
            if issubclass(model, NodeParameters)
            for name in describe(model)
        ),
    }


def refusal(text: str) -> str | None:
    """Why a command cannot run as it is written, without running it; None if it can."""
    words = shlex.split(text.partition(" > ")[0].replace("[", "").replace("]", ""), comments=True)
    if words[0] in ("python3", ".venv/bin/python") and words[1] == "-m":
        if words[0] == "python3":
            return (
                None
                if words[2] in sys.stdlib_module_names
                else "python3 has none of the project's modules"
            )
        return None if importlib.util.find_spec(words[2]) else f"no module {words[2]}"
    words = words[1:] if words[0] in ("python3", ".venv/bin/python") else words
    script = WORKSPACE / ("scripts/fsw.py" if words[0] in ("fsw.py", "fsw") else words[0])
    if not script.is_file():
        return f"no file {words[0]}"
    options, _, ros = (list(part) for part in _cut(words[1:], "--ros-args"))
    for name in (word.partition(":=")[0] for flag, word in pairwise(ros) if flag == "-p"):
        if name not in parameters():
            return f"no parameter {name}"
    for before, word in pairwise(["", *options]):
        if (
            word.startswith(FOLDERS)
            and before not in ("--out", "--json")
            and not (WORKSPACE / re.sub(r"\.py:\w+$", ".py", word)).exists()
        ):
            return f"no file {word}"
    if script.name in PARSERS:
        with redirect_stderr(io.StringIO()) as printed:
            try:
                PARSERS[script.name]().parse_args(options)
            except SystemExit as end:
                only_named = (
                    words[0] in ("fsw.py", "fsw") and "are required" in printed.getvalue()
                )  # "`fsw.py export c` writes"
                return None if end.code == 0 or only_named else printed.getvalue().splitlines()[-1]
        return None
    source = script.read_text(encoding="utf-8")
    for module in re.findall(r'(?<!\.)start\("([\w.]+)"', source):
        source += Path(str(importlib.util.find_spec(module).origin)).read_text(encoding="utf-8")
    if script.parent.name == "benchmarks":
        source += (script.parent / "_benchmark.py").read_text(encoding="utf-8")
    known = ("--help",) if script.name.startswith("run_") else ()
    unknown = [
        word
        for word in options
        if word.startswith("--") and word not in known and f'"{word}"' not in source
    ]
    return f"no option {unknown[0]}" if unknown else None


def _cut(words: list[str], separator: str) -> tuple[list[str], list[str], list[str]]:
    where = words.index(separator) if separator in words else len(words)
    return words[:where], words[where : where + 1], words[where + 1 :]


@pytest.mark.parametrize(("page", "text"), commands())
def test_a_command_in_the_documentation_can_run(page: str, text: str) -> None:
    assert (why := refusal(text)) is None, f"{page}: {text}: {why}"


@pytest.mark.parametrize(
    "text",
    [
        "python3 scripts/fsw.py bag shadow test/golden/reference_tracking",
        "python3 scripts/fsw.py simulate quick --no-such-option",
        "python3 scripts/run_nmpc.py --ros-args -p no_such_parameter:=1",
        "python3 -m distributed.cli.dask_scheduler",
        "python3 scripts/compare_controllers.py --no-such-option",
        "fsw.py bag info test/golden/no_such_weld",
        "fsw simulate quick --no-such-option",
        "python3 scripts/no_such_script.py --help",
    ],
)
def test_a_wrong_command_would_be_found(text: str) -> None:
    assert refusal(text)


def load(name: str, folder: str = "scripts") -> ModuleType:
    """A module of a folder that is no package."""
    spec = importlib.util.spec_from_file_location(name, WORKSPACE / folder / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def safety_case() -> ModuleType:
    return load("safety_case")


def test_the_safety_case_is_whole(safety_case: ModuleType) -> None:
    requirements = yaml.safe_load(safety_case.REQUIREMENTS.read_text(encoding="utf-8"))
    assert (
        safety_case.faults(
            requirements, safety_case.marked(), safety_case.PAGE.read_text(encoding="utf-8")
        )
        == []
    )


def test_tables_of_the_safety_case_are_those_of_the_results(safety_case: ModuleType) -> None:
    page = safety_case.PAGE.read_text(encoding="utf-8")
    requirements = yaml.safe_load(safety_case.REQUIREMENTS.read_text(encoding="utf-8"))
    assert safety_case.with_tables(page, requirements, *safety_case.load_results()) == page


def test_skipped_test_does_not_verify_a_requirement(safety_case: ModuleType) -> None:
    marks = ("reaction times", "last run")
    page = "\n".join(f"<!-- {name}: begin -->\n\n<!-- {name}: end -->" for name in marks)
    counts = {
        "S1": (2, 0, 0, 0),
        "S2": (1, 0, 1, 0),
        "S3": (0, 0, 2, 0),
        "S4": (3, 1, 0, 0),
        "S6": (2, 0, 0, 1),
    }
    results = {
        "commit": "c",
        "date": "d",
        "chosen": "pytest",
        "requirements": {
            key: dict(zip(safety_case.KINDS, numbers, strict=True))
            for key, numbers in counts.items()
        },
    }
    text = safety_case.with_tables(page, [*counts, "S5"], results, safety_case.load_results()[1])
    expected = "1 of 6 requirements; failed: S4; passed in part: S2, S6; skipped: S3; not run: S5."
    assert expected in text


def test_each_requirement_has_a_test_that_is_run_without_full(safety_case: ModuleType) -> None:
    requirements = yaml.safe_load(safety_case.REQUIREMENTS.read_text(encoding="utf-8"))
    assert set(requirements) - set(safety_case.marked(full=False)) == set()


def is_program(text: str) -> bool:
    """Whether a module has a ``main`` of its own, or one of those of all nodes."""
    return bool(re.search(r"^(def main\(|main = )", text, re.MULTILINE))


def test_each_node_has_a_test_that_is_run_without_full(safety_case: ModuleType) -> None:
    """A file that names the node's module, and has a test without the mark."""
    texts = [path.read_text(encoding="utf-8") for path in safety_case.test_files()]
    texts = [
        text for text in texts if re.search(r"^(?<!full\n)(async )?def test_", text, re.MULTILINE)
    ]
    texts = [
        text
        for text in texts
        if not re.search(r"^pytestmark = .*pytest\.mark\.full\b", text, re.MULTILINE)
    ]
    nodes = [
        path
        for path in WORKSPACE.glob("*/fsw_*/fsw_*/*_node.py")
        if is_program(path.read_text("utf-8"))
    ]
    assert len(nodes) >= 10
    named = [rf"\b{path.parent.name}(\.| import (\w+, )*){path.stem}\b" for path in nodes]
    assert [name for name in named if not any(re.search(name, text) for text in texts)] == []


def test_marks_are_read_without_an_import(safety_case: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "test_one.py"
    path.write_text(
        'raise SystemExit\n@pytest.mark.slow\n@pytest.mark.requirement("S1", "S2")\n'
        'def test_a(): ...\n@pytest.mark.requirement("S2")\nclass Machine: ...\n'
        '@pytest.mark.skip("S3")\ndef test_b(): ...\n@pytest.mark.full\n'
        '@pytest.mark.requirement("S4")\ndef test_c(): ...\n'
    )
    assert safety_case.marked([path])["S4"] == [(path, "test_c")]
    assert safety_case.marked([path], full=False) == {
        "S1": [(path, "test_a")],
        "S2": [(path, "test_a"), (path, "Machine")],
    }


def test_gaps_in_the_safety_case_are_reported(safety_case: ModuleType) -> None:
    gaps = safety_case.faults(
        {"S1": "good", "S2": "no test", "S3": "no hazard"},
        {
            "S1": [(Path("t.py"), "test_a")],
            "S3": [(Path("t.py"), "test_a")],
            "S4": [(Path("t.py"), "test_b")],
        },
        "hazards: S1, S2, S9",
    )
    assert [line.partition(":")[0] for line in gaps] == ["S2", "S3", "S9", "S4"]
    assert "t.py::test_b" in gaps[-1]


def test_the_table_of_requirements_has_their_tests(safety_case: ModuleType) -> None:
    tests = {"S1": [(Path("t.py"), "test_b"), (Path("t.py"), "test_a")]}
    counts = {"passed": 2, "failed": 0, "skipped": 1}
    results = {"commit": "c", "date": "d", "chosen": "pytest", "requirements": {"S1": counts}}
    table = safety_case.table({"S1": "it\nholds"}, tests, results)
    [row] = [line for line in table.splitlines() if line.startswith("| S1 ")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells == ["S1", "it holds", "t.py: `test_a`, `test_b`", "2 passed, 1 skipped"]


def test_the_sites_state_diagram_has_every_mode_and_transition() -> None:
    drawing = load("draw_state_machine")
    shown = drawing.svg_diagram()
    assert all(f">{mode}<" in shown for mode in drawing.Mode)
    assert all(
        f">{trigger.word}<" in shown for trigger in {row.trigger for row in drawing.TRANSITIONS}
    )
    assert shown.count("<circle") == len(drawing.TRANSITIONS)


#: pages that are written by hand, and words of each
_MOST_PAGES, _MOST_WORDS = 45, 900
_GUIDES = [
    *(page for page in WORKSPACE.glob("*.md") if page.stem != "CHANGELOG"),
    *(
        page
        for name in ("concepts", "how-to", "reference")
        for page in (WORKSPACE / "docs" / name).glob("*.md")
    ),
]
#: hazards, fault model and exceptions are read together by who assesses the safety
_LONGER = {"safety": 1350}
#: pages of results that studies and benchmarks write from their templates
_GENERATED = {
    "README",
    "campaign",
    "campaign_worst",
    "canister",
    "corridors",
    "first-hour",
    "history",
    "losses",
    "monitor",
    "other-models",
    "other-processes",
    "realistic",
    "sensors",
    "solvers",
    "targets",
}
_LONGEST_RESULTS = 1400
#: what scripts write into a page, and comments
_WRITTEN_IN = re.compile(
    r"<!-- [^>]*\bbegin -->.*?<!-- [^>]*\bend -->|<!-- rows of .*?<!-- rows: end -->|<!--.*?-->",
    re.DOTALL,
)


def words_in(text: str) -> int:
    """Words of a page, without the bars of tables, the formulas and the diagrams."""
    text = re.sub(r"\$\$.*?\$\$|```mermaid.*?```", "", text, flags=re.DOTALL)
    return sum(any(map(str.isalnum, word)) for word in text.split())


def test_pages_by_hand_are_few() -> None:
    assert len(_GUIDES) <= _MOST_PAGES


@pytest.mark.parametrize("page", sorted({*_GUIDES, *PAGES}), ids=lambda page: page.stem)
def test_no_page_is_too_long_to_be_read(page: Path) -> None:
    text, name = page.read_text(encoding="utf-8"), page.relative_to(WORKSPACE)
    if page.parent.name == "results" and page.stem in _GENERATED:
        assert words_in(text) <= _LONGEST_RESULTS, f"{name}: shorten its template"
    else:
        words = words_in(_WRITTEN_IN.sub("", text))
        assert words <= _LONGER.get(page.stem, _MOST_WORDS), f"{name}: {words} words; shorten it"


@pytest.mark.parametrize(
    "page", sorted((WORKSPACE / "docs" / "results").glob("*.md")), ids=lambda page: page.stem
)
def test_a_page_of_results_has_one_table_and_one_figure(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"^\|[ :]*-[-:| ]*\|$", text, re.MULTILINE)) <= 1
    assert len(re.findall(r"^!\[", text, re.MULTILINE)) <= 1


def test_each_block_diagram_is_drawn_with_its_own_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(WORKSPACE / "scripts"))
    drawer = load("block_diagram")
    graphs = [
        graph
        for path in sorted((WORKSPACE / "docs").rglob("*.md"))
        for graph in re.findall(
            r"```mermaid\n(graph LR\n.*?)```", path.read_text("utf-8"), re.DOTALL
        )
    ]
    assert len(graphs) >= 3
    for graph in graphs:
        words, arrows = drawer.parse(graph)
        drawing = drawer.svg(graph, "title")
        assert len(arrows) == graph.count("-->") == drawing.count('fill="none"')
        assert drawing.count("<rect") == len(words)
        shown = set(re.findall(r">([^<>]+)</text>", drawing))
        assert {line for text in words.values() for line in text} <= shown
        stacks, loops = drawer.columns(words, arrows)
        column = {name: i for i, stack in enumerate(stacks) for name in stack}
        assert all(column[a] < column[b] for a, b, _ in arrows if (a, b) not in loops)
    assert drawer.columns(*drawer.parse("graph LR\na --> b\nb --> a"))[1] == {("b", "a")}


def test_readme_is_short() -> None:
    assert len((WORKSPACE / "README.md").read_text(encoding="utf-8").splitlines()) <= 90


@pytest.fixture(scope="module")
def generated() -> dict[str, str]:
    """The pages of the reference, which are in the site alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(WORKSPACE / "scripts")
        files: dict[str, str] = load("reference_pages").reference()
    return {name.removesuffix(".md"): text for name, text in files.items() if name.endswith(".md")}


def test_commands_on_generated_pages_can_run(generated: dict[str, str]) -> None:
    texts = {text for page in generated.values() for text in commands_of(page)}
    assert {text: why for text in sorted(texts) if (why := refusal(text))} == {}


def test_the_reference_has_all_messages_parameters_and_commands(generated: dict[str, str]) -> None:
    tables = "\n".join(text for name, text in generated.items() if name.startswith("parameters"))
    names = parameters() - {"use_sim_time"}
    assert len(names) > 100 and [name for name in names if f"| `{name}` |" not in tables] == []
    definitions = "\n".join(
        text
        for name, text in generated.items()
        if name.startswith(("messages", "services", "actions"))
    )
    paths = [
        path
        for kind in ("msg", "srv", "action")
        for path in (WORKSPACE / "src/fsw_msgs" / kind).glob("*.*")
    ]
    assert [path.stem for path in paths if f"\n## {path.stem}\n" not in definitions] == []
    verbs = next(
        action.choices for action in operator_parser()._actions if isinstance(action.choices, dict)
    )
    assert [verb for verb in verbs if f"## {verb}\n" not in generated["command-line"]] == []


@cache
def tree() -> str:
    """Paths of all sources, each followed by a space."""
    files = (path for folder in FOLDERS for path in (WORKSPACE / folder).rglob("*.[pch]*"))
    return "".join(f"{path} " for path in files)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_named_in_a_text_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:src|lab|quality|test|scripts|benchmarks)/[\w./-]+\.\w+)`", text)
    assert [path for path in named if "NAME" not in path and not (WORKSPACE / path).exists()] == []
    sources = re.findall(r"`(?!examples/)((?:\w+/)*\w+\.(?:py|c|h))`", text)
    assert [name for name in sources if "NAME" not in name and f"/{name} " not in tree()] == []


@pytest.mark.parametrize(
    "page",
    [
        *WORKSPACE.glob("*.md"),
        *WORKSPACE.glob("src/*/README.md"),
        *WORKSPACE.glob("quality/*/README.md"),
        *WORKSPACE.glob("lab/**/README.md"),
    ],
)
def test_links_outside_the_site_lead_to_a_file(page: Path) -> None:
    """MkDocs checks those of ``docs``; a generated page cannot be linked from outside the site."""
    links = re.findall(r"\]\((?!\w+:|#)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_rows_of_the_results_are_copied_and_a_missing_one_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(WORKSPACE / "scripts")
    build_docs = load("build_docs")
    heading = "Welds inside the limits: nmpc:default"
    mark, end = f"<!-- rows of campaign.md, {heading} -->", "<!-- rows: end -->"
    page = build_docs.with_rows(f"before\n{mark}\nold\n{end}\nafter\n")
    row = next(line for line in page.splitlines() if line.startswith("| nmpc:default |"))
    assert row in (WORKSPACE / "docs/results/campaign.md").read_text(encoding="utf-8").splitlines()
    assert (
        "old" not in page
        and len([line for line in page.splitlines() if line.startswith("|")]) == 3
    )
    assert build_docs.with_rows(page) == page
    with pytest.raises(SystemExit, match="no such row"):
        build_docs.with_rows(page.replace("nmpc:default -->", "nmpc:default; no such row -->"))


def test_page_of_the_first_hour_follows_from_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(WORKSPACE / "benchmarks"))
    module = load("first_hour", "benchmarks")
    folder = module._benchmark.RESULTS
    numbers, page = (folder / name for name in ("first-hour_tables.json", "first-hour.md"))
    figures = json.loads(numbers.read_text(encoding="utf-8"))
    page_now = module._benchmark.rendered(module.PAGE, module.content_of(figures))
    assert page_now == page.read_text(encoding="utf-8")
    figures["fsw"]["import_cpu_s"] = 99.0
    assert any(row.startswith("import: 99.0 s CPU") for row in module.lost(figures))
    notebook = {"cells": [
        {"cell_type": "code", "source": [line]}
        for line in ("%%capture\na = 1", "a", "print(a)", "f()", "last()")
    ]}  # fmt: skip
    code = module.python_of(json.dumps(notebook), "last")
    assert module.lines_of(code) == 2 and "f()" in code


@pytest.mark.full
def test_page_of_solvers_names_those_closer_than_twice_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(WORKSPACE / "benchmarks"))
    solvers = load("solvers", "benchmarks")
    qp: dict[str, float | None] = {}
    qp |= {"default_active": 13.0, "default_iterations": 5.0}
    for preset, ratio in (("default", 0.8), ("paper", 3.0)):
        qp |= {
            f"{preset}_{name}": 0.05
            for name in ("own_ms", "daqp_ms", "daqp_warm_ms", "prediction_ms")
        }
        qp |= {
            f"{preset}_problems": 4,
            f"{preset}_excess_own": 1e-9,
            f"{preset}_excess_daqp": 1e-12,
        }
        qp |= {
            f"{preset}_unsolved_daqp": 0,
            f"{preset}_ratio_daqp": ratio,
            f"{preset}_unsolved_osqp": 4,
        }
    nlp = {
        "solve_rti108_ms": 1.7,
        "cost_excess_rti108": 1e-7,
        "ratio_problems": 4,
        "unsolved_fatrop": 4,
    }
    nlp |= {
        "solve_ipopt_ms": 357.0,
        "ratio_ipopt": 210.0,
        "cost_excess_ipopt": 1e-5,
        "solve_fatrop_ms": None,
        "ratio_fatrop": None,
    }
    for name, figures in (("qp", qp), ("nlp", nlp)):
        (tmp_path / f"{name}.json").write_text(json.dumps(figures), encoding="utf-8")
    page = tmp_path / "page.md"
    files = [str(tmp_path / "qp.json"), str(tmp_path / "nlp.json")]
    monkeypatch.setattr(sys, "argv", ["solvers.py", *files, "--page", str(page)])
    assert solvers.main() == 0
    text = page.read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    cells = {row[0]: row[1:] for row in rows if row}
    assert cells["DAQP"] == ["0.8", "3", "", ""] and cells["IPOPT"] == ["", "", "210", ""]
    assert cells["OSQP"] == ["4 not solved", "4 not solved", "", ""]
    assert cells["FATROP"] == ["", "", "4 not solved", ""]
    assert "Not measured here" in text
    assert "QP, preset default: DAQP (0.8).**" in text and "13 of 160" in text
    tables = json.loads((tmp_path / "page_tables.json").read_text(encoding="utf-8"))["tables"]
    assert tables["QP, preset default"][0]["name"] == "DAQP"
    assert page.with_suffix(".png").stat().st_size > 5_000
    acados: dict[str, float] = {"ticks": 300, "own_ms": 0.25, "own_p99_ms": 0.5}
    for applied in ("own", "hpipm"):
        acados |= {f"{applied}_iae_depth_mm_s": 1.5, f"{applied}_iae_temperature_c_s": 100.0}
        acados |= {f"{applied}_fallbacks": 0}
    for name in ("hpipm", "partial", "qpoases"):
        for phase in ("", "_preparation", "_feedback"):
            acados |= {f"{name}{phase}_ms": 0.75, f"{name}{phase}_p99_ms": 1.25}
        acados |= {f"{name}_ratio": 3.0, f"{name}_move_difference": 0.0125}
    (tmp_path / "acados.json").write_text(json.dumps(acados), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--acados", str(tmp_path / "acados.json")])
    assert solvers.main() == 0
    text = page.read_text(encoding="utf-8")
    assert "Not measured here" not in text
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    ticks = {row[0]: row[1:] for row in rows if len(row) == 5}
    assert sum(cells == ["", "", "", "3"] for cells in ticks.values()) == 3
    assert ticks["this project's"][-1] == "1"
    assert text.count("0.75 / 1.25") == 9 and text.count("differs by 0.013 ") == 3


def test_a_formula_wider_than_the_page_scrolls_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one without a number; one within a line is no box."""
    monkeypatch.syspath_prepend(str(WORKSPACE / "scripts"))
    blocks = [rf'<div class="arithmatex">\[{tex}\]</div>' for tex in (r"a = b \tag{1}", "c")]
    content = "".join([*blocks, r'<span class="arithmatex">\(d\)</span>'])
    shown = load("build_docs").on_page_content(content, None, None, None)
    boxes = re.findall(r'<div class="equation">(<span>\(1\)</span>)?<math', shown)
    assert boxes == ["<span>(1)</span>", ""] and shown.count("<math") == 3
