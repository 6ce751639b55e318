#!/usr/bin/env python3
"""Draws ``docs/figures/operator_page.png``.

The page beside ``demo.py --live`` on the joint line, after four minutes.

On the way the NMPC is chosen by the page.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "test" / "support"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(dev=True, extras=("hmi",))

from playwright.sync_api import Page, expect

from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_test_support.browser import chromium
from fsw_test_support.page_steps import in_control, press
from fsw_test_support.waiting import wait_for_text

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "figures" / "operator_page.png"
#: until the joint line begins
_PATIENCE_MS = 400_000
#: of the joint line that is shown
_AFTER_S = 25.0


def steer(page: Page, token: str) -> None:
    """Bring the page to what the picture shows."""
    in_control(page, secret=token)
    expect(page.locator("#who strong")).to_contain_text("auto")
    press(page, "Controller")
    page.locator("dialog").get_by_label("nmpc").check()
    page.locator("dialog select").select_option("10")
    press(page, "Swap")
    expect(page.locator("#progress strong")).to_have_text("joint line")
    page.wait_for_timeout(1e3 * _AFTER_S)


def main() -> int:
    """Start the weld, and draw."""
    expect.set_options(timeout=_PATIENCE_MS)
    with (
        tempfile.TemporaryDirectory() as text,
        free_domain() as domain,
        Launcher(Path(text) / "log", domain) as launcher,
        chromium() as browser,
    ):
        launcher.start("demo", "fsw.demo", ["--live", "--port", "0", "--out", f"{text}/weld"])
        url = wait_for_text(launcher, "demo", r"http://\S+")
        token = wait_for_text(launcher, "demo", r"token: \S+").split()[1]
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(_PATIENCE_MS)
        page.goto(url)
        steer(page, token)
        page.screenshot(path=PICTURE)
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
