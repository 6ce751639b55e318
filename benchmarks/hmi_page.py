"""Operator's page in Chromium: how old a value is when it is on the screen, and what updates and trends cost.

A small server sends a synthetic weld at 10 Hz. The age is from the server's stamp of a tick (the
same machine's clock) to the first frame that the browser draws after the page has written its
values.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "support"))

from report import parser, save, show

from fsw_test_support.browser import chromium
from fsw_test_support.fake_hmi import FakeHmi

#: run in the page before its scripts: note each tick's age when it is drawn, and what
#: handling it costs
WATCH = """
window.ages = []; window.busy = [];
const native = WebSocket;
window.WebSocket = class extends native {
  set onmessage(handle) {
    super.onmessage = (event) => {
      const begin = performance.now();
      handle(event);
      const spent = performance.now() - begin;
      const frame = JSON.parse(event.data);
      if (frame.t !== 'tick') return;
      window.busy.push(spent);
      requestAnimationFrame(() => setTimeout(() => window.ages.push(Date.now() - 1000 * frame.server_s)));
    };
  }
};
"""


def measure(window: str, seconds: float) -> dict[str, Any]:
    """Figures of a page that shows the trends of ``window`` for a time."""
    server = FakeHmi().start()
    try:
        with chromium() as browser:
            page = browser.new_page(viewport={"width": 1920, "height": 1080})
            page.add_init_script(WATCH)
            page.goto(server.url)
            page.get_by_role("button", name=window, exact=True).click()
            page.evaluate("window.ages = []; window.busy = []")
            session = page.context.new_cdp_session(page)
            session.send("Performance.enable")
            before = _task_s(session)
            page.wait_for_timeout(1000.0 * seconds)
            busy_s = _task_s(session) - before
            ages, ticks = (
                np.array(page.evaluate("window.ages")),
                np.array(page.evaluate("window.busy")),
            )
    finally:
        server.stop()
    key = window.replace(" ", "_")
    return {
        f"{key}_ticks": len(ages),
        f"{key}_age_ms_p50": float(np.percentile(ages, 50)),
        f"{key}_age_ms_p99": float(np.percentile(ages, 99)),
        f"{key}_age_ms_max": float(ages.max()),
        f"{key}_update_ms_p99": float(np.percentile(ticks, 99)),
        f"{key}_main_thread_share": busy_s / seconds,
    }


def _task_s(session: Any) -> float:
    metrics = session.send("Performance.getMetrics")["metrics"]
    return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))


def main() -> None:
    """Command line."""
    arguments = parser(__doc__, "10 s each instead of 60 s").parse_args()
    figures: dict[str, Any] = {}
    for window in ("1 min", "45 min"):
        figures |= measure(window, 10.0 if arguments.quick else 60.0)
    show(figures)
    save(figures, arguments.json)


if __name__ == "__main__":
    main()
