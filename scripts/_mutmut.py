"""mutmut for mutation_test.py.

Words are left as they are, tests are collected once, and survivors are printed as JSON.

Words are what a person reads: strings with a space, f-strings, what is raised and what is logged.
Mutants of them say nothing about a weld. mutmut itself can only leave out whole lines, and so
conditions that stand beside words; and it collects the tests anew for every mutant, which takes
far longer than to run those that notice it.

usage: in the folder that was laid out: _mutmut.py run | tell
"""

import json
import os
import sys

import libcst as cst
from _pytest.config import _prepareconfig
from _pytest.main import Session
from _pytest.runner import runtestprotocol
from mutmut.__main__ import _run, status_by_exit_code
from mutmut.configuration import config
from mutmut.mutation import file_mutation
from mutmut.mutation.data import SourceFileMutationData
from mutmut.mutation.diff_apply import get_diff_for_mutant
from mutmut.state import state
from mutmut.utils.file_utils import change_cwd, walk_mutatable_files
from mutmut.workers.isolation import ForkRunner

#: functions that only word or log what is handed to them
_TELLERS = ("log", "explain", "_add_problem", "join", "warn", "info", "error")


def is_words(node: cst.CSTNode) -> bool:
    """Whether a person reads this, and no code."""
    if isinstance(node, cst.Call):
        return isinstance(node.func, cst.Attribute) and node.func.attr.value in _TELLERS
    if isinstance(node, cst.SimpleString):
        return " " in node.value
    return isinstance(node, (cst.FormattedString, cst.ConcatenatedString, cst.Raise))


class _Visitor(file_mutation.MutationVisitor):
    """Collects mutants, but none inside words and none that takes words away."""

    def _skip_node_and_children(self, node: cst.CSTNode) -> bool:
        return is_words(node) or super()._skip_node_and_children(node)

    def _removes_ignored_code(self, node: cst.CSTNode, mutated_node: cst.CSTNode) -> bool:
        kept = {id(child) for child in file_mutation._walk(mutated_node)}
        gone = (child for child in file_mutation._walk(node) if id(child) not in kept)
        return any(map(is_words, gone)) or super()._removes_ignored_code(node, mutated_node)


def _collect_once(runner: ForkRunner) -> None:
    """Collect the tests before a process is forked for each mutant.

    There, run quick ones first, until one fails.
    """
    with change_cwd("mutants"):
        options = [*config().pytest_add_cli_args, *config().pytest_add_cli_args_test_selection]
        settings = _prepareconfig(["--rootdir=.", "--capture=sys", *options])
        settings._do_configure()
        session = Session.from_config(settings)
        settings.hook.pytest_sessionstart(session=session)
        settings.hook.pytest_collection(session=session)
    items = {item.nodeid: item for item in session.items}

    def run_tests(*, mutant_name: str, tests: list[str]) -> int:
        chosen = [
            items[test] for test in sorted(tests, key=lambda test: state().duration_by_test[test])
        ]
        with change_cwd("mutants"):
            for item, following in zip(chosen, [*chosen[1:], None], strict=True):
                if any(
                    report.failed
                    for report in runtestprotocol(item, log=False, nextitem=following)
                ):
                    return 1
        return 0

    runner.test_runner.run_tests = run_tests  # type: ignore[method-assign]


def _forget_survivors() -> None:
    """Run again what survived the last time: the tests may be better now."""
    for path in walk_mutatable_files():
        data = SourceFileMutationData(path=path)
        if not data.meta_path.exists():
            continue
        data.load()
        fates = data.exit_code_by_key.items()
        data.exit_code_by_key = {
            name: code if status_by_exit_code[code] == "killed" else None for name, code in fates
        }
        data.save()


def _tell() -> None:
    """Print the verdict of each mutant, with the change unless a test failed."""
    verdicts = []
    for path in walk_mutatable_files():
        data = SourceFileMutationData(path=path)
        data.load()
        for name, code in data.exit_code_by_key.items():
            verdict = status_by_exit_code[code]
            verdicts.append(
                (
                    name,
                    verdict,
                    "" if verdict == "killed" else get_diff_for_mutant(name, path=path),
                )
            )
    print(json.dumps(verdicts))


if __name__ == "__main__":
    file_mutation.MutationVisitor = _Visitor  # type: ignore[misc]
    ForkRunner.startup = _collect_once  # type: ignore[method-assign]
    if sys.argv[1] == "run":
        _forget_survivors()
        _run([], os.cpu_count())
    else:
        _tell()
