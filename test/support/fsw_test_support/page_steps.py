"""What a person does at the page in a browser, and waits for."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

from playwright.sync_api import expect

from fsw_test_support.fake_hmi import TOKEN
from fsw_test_support.waiting import PATIENCE_S

T = TypeVar("T")

#: script: for each trend whether what Resume will do is drawn in it, which nothing else there is
#: as blue as
DRAWN_AHEAD = """[...document.querySelectorAll(".plot canvas")].map((one) => {
    const { data } = one.getContext("2d").getImageData(0, 0, one.width, one.height);
    return data.some((red, i) => i % 4 === 0 && red === 31 && data[i + 1] === 95 && data[i + 2] === 158);
})"""


def ready(page: Any) -> Any:
    """The page, once it shows a good weld."""
    expect(page.locator("#verdict strong")).to_have_text("Good")
    return page


def until(page: Any, condition: str) -> None:
    """Wait until a script is true.

    Playwright's own way to wait needs eval, which the policy of the page forbids.
    """
    end = time.monotonic() + PATIENCE_S
    while not page.evaluate(condition):
        assert time.monotonic() < end, condition
        page.wait_for_timeout(20)


def settled(page: Any, measure: Callable[[], T]) -> T:
    """What is measured once nothing is found.

    A page that a busy machine starves is cut off now and then.
    """
    end = time.monotonic() + PATIENCE_S
    while (faults := measure()) and time.monotonic() < end:
        page.wait_for_timeout(50)
    return faults


def press(page: Any, name: str) -> None:
    """Click on the button of this name."""
    page.get_by_role("button", name=name, exact=True).click()


def log_in(page: Any, name: str = "Anna", secret: str = TOKEN, label: str = "Token") -> None:
    """Log in by the form."""
    press(page, "Log in")
    page.get_by_label("Name").fill(name)
    page.get_by_label(label).fill(secret)
    page.keyboard.press("Enter")


def in_control(page: Any, name: str = "Anna", secret: str = TOKEN) -> None:
    """Log in and take control."""
    log_in(page, name, secret)
    press(page, "Take control")
    expect(page.locator(".control")).to_have_text(f"{name} (you) has control.")


def band_pixels(trend: str) -> str:
    """Script that counts what the band about a prediction covers in a trend.

    Nothing else there is as translucent.
    """
    return f"""(() => {{
        const canvas = document.querySelector(".trend.{trend} canvas");
        const {{ data }} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        return data.filter((one, i) => i % 4 === 3 && one === 0x66).length;
    }})()"""
