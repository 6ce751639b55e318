"""Lint of the operator's page, ``test.py --lint``: its types by tsc, its habits by ESLint.

Both come by ``npm ci`` into a folder that is not tracked, with the npm of the wheel in
``requirements/node.lock``. Where they cannot be had, a line says so and the lint is skipped.
"""

import subprocess
import sys

import npm_packages as npm
from _bootstrap import WORKSPACE

_LOCK = WORKSPACE / "requirements" / "node.lock"


def lint() -> int:
    """Check the page's modules; the exit code of the first tool that complains."""
    print("== tsc and eslint of the operator's page", flush=True)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q"]
    subprocess.run([*pip, "--only-binary", ":all:", "-r", str(_LOCK)])
    try:
        npm.install(npm.PACKAGE)
    except npm.NpmError as error:
        print(f"SKIPPED, the page is not checked: {error}", flush=True)
        return 0
    program = npm.find()
    assert program is not None
    lint_page = [str(program), "run", "--silent", "lint"]
    return subprocess.run(lint_page, cwd=npm.PACKAGE, env=npm.environment(program)).returncode
