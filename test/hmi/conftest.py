"""A browser for the tests of the page."""

import re
from functools import partial

import npm_packages as npm
import pytest
from argon2 import PasswordHasher
from playwright.sync_api import expect

from fsw_test_support.browser import CHROMIUM, chromium
from fsw_test_support.fake_hmi import FakeHmi, sample_bag
from fsw_test_support.trends_library import uplot

__all__ = ["uplot"]

#: for conditions that come at once on an idle machine
PATIENCE_MS = 150_000
expect.set_options(timeout=PATIENCE_MS)


@pytest.fixture(autouse=True, scope="session")
def cheap_hashes():
    """What a hash of a password costs is the library's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fsw_hmi.users.HASHER", PasswordHasher(1, 8, 1))
        yield


@pytest.fixture(scope="session")
def axe():
    """The script of axe-core; without npm or its registry the tests that need it are skipped."""
    try:
        return (npm.install(npm.PACKAGE) / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
    except npm.NpmError as error:
        pytest.skip(f"axe-core: {error}")


@pytest.fixture(scope="session")
def browser():
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing (apt install chromium)")
    with chromium() as made:
        yield made


def _patient(silence_ms, route):
    """Serve the script with ten minutes in place of a second.

    On a busy machine a page may stand still.
    """
    response = route.fetch()
    text, count = re.subn(
        r"(?<=SILENCE_MS = )800|(?<=BEHIND_MS = )1000", str(silence_ms), response.text()
    )
    assert count == 2
    route.fulfill(response=response, body=text)


@pytest.fixture
def open_page(browser):
    """Function that opens an address at a size.

    Errors of the page's scripts and policies fail the test.

    A ``patient`` page takes itself for disconnected after ten minutes of silence, not within a
    second.
    """
    errors, contexts = [], []

    def opened(url, width=1280, height=800, patient=True, silence_ms=600_000, **options):
        size = {"width": width, "height": height}
        contexts.append(browser.new_context(viewport=size, **options))
        page = contexts[-1].new_page()
        if patient:
            page.route("**/connection.js*", partial(_patient, silence_ms))
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on(
            "console",
            lambda line: (
                errors.append(line.text) if "Content Security Policy" in line.text else None
            ),
        )
        page.goto(url)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert not errors


@pytest.fixture
def fake():
    server = FakeHmi().start()
    yield server
    server.stop()


@pytest.fixture
def bags():
    server = FakeHmi("bag", bags=[sample_bag(0), sample_bag(1, shift_mm=0.02)]).start()
    yield server
    server.stop()
