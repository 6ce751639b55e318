"""The documentation's search in a site that was opened from disk, where browsers start no worker."""

from pathlib import Path

import pytest

SHIM = Path(__file__).resolve().parents[2] / "docs" / "iframe-worker.js"
PAGE = """<body><script src="iframe-worker.js"></script><script>
const worker = new Worker(new URL("echo.js", location.href).href)
worker.addEventListener("message", event => document.title += event.data)
for (const word of ["a", "b"]) worker.postMessage(word)
</script></body>"""
ECHO = "addEventListener('message', event => postMessage(`${event.data};`))"


@pytest.mark.slow
def test_script_of_a_worker_answers_in_a_page_from_disk(tmp_path, browser):
    for name, text in (("page.html", PAGE), ("echo.js", ECHO), (SHIM.name, SHIM.read_text())):
        (tmp_path / name).write_text(text)
    page = browser.new_page()
    page.goto((tmp_path / "page.html").as_uri())
    page.wait_for_function("document.title === 'a;b;'")
    page.close()
