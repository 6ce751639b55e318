"""The operator's page with many viewers.

Processor time of its server, and how old a tick is when it is seen.

Plant, both controllers, supervisor, an idle scenario player and the page's server run as processes
in real time. The viewers are websockets in this process, and one is a browser, whose trends get
45 minutes of the past. A tick's age is from its stamp, at which the plant measures, to its arrival
here, and in the browser to the first frame drawn with it.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import tempfile
import time
from pathlib import Path
from urllib.request import urlopen

import _benchmark
from websockets.asyncio.client import connect

from fsw_control import weld
from fsw_control.free_domain import free_domain
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_test_support.browser import CHROMIUM, chromium
from fsw_test_support.waiting import wait_for_text

#: run in the page before its scripts: note each tick's age, from the plant's stamp, when it is
#: drawn, and what handling it costs
WATCH = """
window.ages = []; window.busy = [];
const past = (nowS, columns) => Array.from({ length: 27000 }, (_, i) => // 45 minutes
  [nowS + 0.1 * (i - 27000), ...Array(columns - 1).fill(1 + 1e-3 * Math.sin(0.01 * i))]);
const native = WebSocket;
window.WebSocket = class extends native {
  set onmessage(handle) {
    super.onmessage = (event) => {
      const begin = performance.now();
      handle(event);
      const spent = performance.now() - begin;
      const frame = JSON.parse(event.data);
      if (frame.t === 'hello') {
        const rows = past(frame.server_s, frame.columns.length);
        handle({ data: JSON.stringify({ t: 'history', rows }) });
      }
      if (frame.t !== 'tick') return;
      window.busy.push(spent);
      const drawn = () => window.ages.push(Date.now() - 1000 * frame.row[0]);
      requestAnimationFrame(() => setTimeout(drawn));
    };
  }
};
"""

VIEWERS = 100
#: while the pages open and get the past
WARM_UP_S = 3.0
#: for the browser: the percentile 99 needs hundreds of ticks
SCREEN_S = 60.0


async def view(url: str, build: str, ages_s: list[float], token: str = "") -> None:
    """Be a viewer, and with a token the one who gives the first set-points."""
    async with connect(
        f"{url.replace('http', 'ws')}ws?build={build}",
        origin=url.rstrip("/"),
        compression=None,
        max_size=None,
    ) as socket:
        if token:
            start = {"depth_mm": weld.DEPTH_MM, "temperature_c": weld.TEMPERATURE_C}
            for number, request in enumerate(
                (
                    {"do": "login", "token": token, "name": "benchmark"},
                    {"do": "take_control"},
                    {"do": "set_reference", **start},
                )
            ):
                await socket.send(json.dumps({"id": number, **request}))
        async for text in socket:
            if isinstance(text, str) and text.startswith('{"t":"tick"'):
                ages_s.append(time.time() - json.loads(text)["row"][0])


async def watch(
    url: str, token: str, viewers: int, seconds: float, process: int
) -> _benchmark.Figures:
    """Open the pages, and measure for so long when they are open."""
    with urlopen(url) as response:
        match = re.search(r'name="build" content="(\w+)"', response.read().decode())
    build = match[1] if match else ""
    ages_s: list[float] = []
    jobs = [
        asyncio.create_task(view(url, build, ages_s, "" if i else token)) for i in range(viewers)
    ]
    await asyncio.sleep(WARM_UP_S)  # the measurement itself
    ages_s.clear()
    before_s, begin_s = _benchmark.processor_s(process), time.monotonic()
    await asyncio.sleep(seconds)
    share = (_benchmark.processor_s(process) - before_s) / (time.monotonic() - begin_s)
    count = len(ages_s)
    for job in jobs:
        if job.done():
            job.result()  # raises what ended it
        job.cancel()
    return {
        f"core_share_{viewers}_percent": 100.0 * share,
        f"ticks_per_s_and_viewer_{viewers}": count / viewers / seconds,
        **_benchmark.percentiles("tick_age", [1e3 * age_s for age_s in ages_s], f"{viewers}_ms"),
    }


def watch_screen(url: str) -> _benchmark.Figures:
    """Look at the page in a browser; nothing where there is none."""
    if not CHROMIUM.exists():
        return {}
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(WATCH)
        page.goto(url)
        page.get_by_role("button", name="45 min", exact=True).click()
        page.wait_for_timeout(1000.0 * WARM_UP_S)  # the measurement itself
        page.evaluate("ages = []")
        page.wait_for_timeout(1000.0 * SCREEN_S)
        ages_ms = page.evaluate("ages")
    return {"screen_ticks": len(ages_ms), **_benchmark.percentiles("screen_age", ages_ms)}


def measure(seconds: float) -> _benchmark.Figures:
    """Run the graph, then watch it with one page and with many, and in a browser."""
    with (
        tempfile.TemporaryDirectory() as text,
        free_domain() as domain,
        Launcher(Path(text) / "log", domain) as launcher,
    ):
        WeldGraph(None, Path(text), ("nmpc", "decentral"), realtime=True, record=False).start(
            launcher
        )
        hmi = launcher.start("hmi", "hmi", ["--port", "0"])
        url = wait_for_text(launcher, "hmi", r"http://\S+")
        token = wait_for_text(launcher, "hmi", r"token: \S+").split()[1]
        wait_for_text(launcher, "supervisor", "taking over")
        figures: _benchmark.Figures = {"load_before": os.getloadavg()[0]}
        for viewers in (1, VIEWERS):
            figures |= asyncio.run(watch(url, token, viewers, seconds, hmi.process.pid))
        figures |= watch_screen(url)
        figures["load_after"] = os.getloadavg()[0]
        return figures


if __name__ == "__main__":
    _benchmark.run(
        __doc__,
        "5 s each instead of 60 s, but for the browser",
        lambda quick: (measure(5.0 if quick else 60.0), {}),
    )
