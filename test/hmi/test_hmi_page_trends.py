"""Trends and recorded welds on the page in a browser."""

import re
from datetime import datetime

from playwright.sync_api import expect

from fsw_test_support.browser import shot
from fsw_test_support.fake_hmi import LIMITS
from fsw_test_support.page_steps import DRAWN_AHEAD, band_pixels, in_control, press, ready, until


def test_prediction_has_a_band(fake, open_page):
    page = ready(open_page(fake.url))
    expect(page.locator(".legend")).to_contain_text("expected, ± 2 σ")
    until(page, f"{band_pixels('temperature_c')} > 500")
    shot(page, "prediction_band")


def test_resume_is_drawn_ahead_before_it_is_confirmed(fake, open_page, uplot):
    fake.progress.update(
        state="held", left=True, way_back_s=10.5, depth_mm=2.66, temperature_c=826.4
    )
    page = ready(open_page(fake.url))
    in_control(page)
    assert page.evaluate(DRAWN_AHEAD) == [False] * 4
    press(page, "Resume weld")
    expect(page.locator(".summary")).to_contain_text("816.4 → 826.4 °C (+10.0)")
    until(page, f"{DRAWN_AHEAD}.join() === 'true,true,false,false'")
    shot(page, "resume")
    press(page, "Cancel")
    until(page, f"{DRAWN_AHEAD}.join() === 'false,false,false,false'")
    assert not [request for request in fake.requests if request["do"] == "weld"]


def test_trends_are_zoomed_moved_by_keys_and_swapped_and_lead_back_to_now(fake, open_page, uplot):
    page = ready(open_page(fake.url))
    until(page, "document.querySelectorAll('.plot canvas').length === 4")
    back = page.get_by_role("button", name="Back to now")
    expect(back).to_be_hidden()
    box = page.locator(".plot .u-over").first.bounding_box()
    page.mouse.move(box["x"] + 50, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 30)
    page.mouse.up()
    expect(back).to_be_visible()
    plot = page.locator(".plot").first
    zoomed = plot.screenshot()
    plot.press("ArrowLeft")
    plot.press("ArrowRight")
    assert plot.screenshot() == zoomed  # it stands still, and comes back by the same way
    page.get_by_role("button", name="Torque, Power").click()
    expect(page.locator(".trend h2")).to_contain_text(["Depth", "Temperature", "Torque", "Power"])
    expect(page.locator(".plot canvas")).to_have_count(4)
    shot(page, "zoomed")
    back.click()
    expect(back).to_be_hidden()
    page.get_by_role("button", name="Force, Speed").click()
    expect(page.locator(".trend h2")).to_contain_text(["Depth", "Temperature", "Force", "Speed"])


DAY_S = 86_400
#: script: all readings are of one time
ONE_TIME = (
    "new Set(Array.from(document.querySelectorAll('.trend .reading'),"
    " (reading) => reading.textContent.split(': ')[0])).size === 1"
)


def test_panning_by_keys_ends_with_the_data_and_readings_keep_the_time_of_the_cursor(
    fake, open_page, uplot
):
    page = ready(open_page(fake.url))
    until(page, "document.querySelectorAll('.plot canvas').length === 4")
    press(page, "5 min")
    box = page.locator(".plot .u-over").first.bounding_box()
    middle = (box["x"] + 0.5 * box["width"], box["y"] + 30)
    page.mouse.move(box["x"] + 50, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(*middle)
    page.mouse.up()
    readings = page.locator(".trend .reading")
    seen = []
    for key, count in (("ArrowLeft", 0), ("ArrowLeft", 1), ("ArrowLeft", 40), ("ArrowRight", 80)):
        for _ in range(count):
            page.locator(".plot").first.press(key)
        expect(readings).to_have_text([re.compile(r"^\d\d:\d\d:\d\d: \d")] * 4)
        until(page, ONE_TIME)  # the plots follow one after the other
        time = datetime.strptime(readings.first.inner_text().split(": ")[0], "%H:%M:%S")
        seen.append(time)
    before = [(time - seen[0]).seconds for time in seen]  # within a day: midnight may be between
    assert before[3] < DAY_S / 2 < before[2] < before[1]


#: script: keeps the texts that are drawn into each trend since it was last cleared
LABELS = """(() => {
    window.labels = {};
    const { fillText, clearRect } = CanvasRenderingContext2D.prototype;
    const trend = (context) => context.canvas.closest(".trend")?.className;
    CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
        (window.labels[trend(this)] ??= new Set()).add(text);
        fillText.call(this, text, ...rest);
    };
    CanvasRenderingContext2D.prototype.clearRect = function (...rest) {
        window.labels[trend(this)] = new Set();
        clearRect.call(this, ...rest);
    };
})()"""


def test_vertical_axes_of_low_trends_have_two_labels(fake, open_page, uplot):
    page = open_page(fake.url, 1280, 650)
    page.add_init_script(LABELS)
    page.reload()
    until(page, "document.querySelectorAll('.plot canvas').length === 4")
    numbers = "Object.values(window.labels).map((texts) => [...texts].filter((text) => /^[0-9.,]+$/.test(text)).length)"
    for other in ("Torque, Power", "Force, Speed"):
        until(page, f"{numbers}.length >= 4 && Math.min(...{numbers}) >= 2")
        press(page, other)


def test_bag_shows_its_first_tick_at_once_and_whose_the_map_is(bags, open_page):
    for bag in bags.bags:
        del bag["rows"][0]  # the first tick of a weld is at 0.1 s
    page = open_page(bags.url)
    expect(page.locator("#foot output")).to_have_text("0:00 / 4:00")
    expect(page.locator("#value-depth_mm output")).to_have_text("2.74")
    expect(page.locator("#map h2")).to_contain_text("weld_0")


def test_limit_beyond_a_scale_has_no_label_over_that_of_its_end(bags, open_page, monkeypatch):
    depth = LIMITS["depth_mm"] | {"trip": [1.4, 3.7]}  # the scale begins at 1.5
    monkeypatch.setitem(LIMITS, "depth_mm", depth)
    page = open_page(bags.url, 1280, 1400)
    ticks = page.locator("#value-depth_mm .tick:not(.warn)")
    expect(ticks).to_have_text(["3.7", "1.5", "4"])


def test_bag_is_scrubbed_played_zoomed_and_compared(bags, open_page, uplot):
    page = open_page(bags.url)
    expect(page.locator("#status")).to_contain_text("weld_0 and weld_1")
    page.locator("#scrub").fill("70")
    expect(page.locator("#status")).to_contain_text("nmpc · auto")
    expect(page.locator("#status")).to_contain_text("joint line")
    page.locator("#scrub").press("ArrowLeft")
    expect(page.locator("#foot output")).to_have_text("1:09 / 4:00")
    page.locator("#speed").select_option("60")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    until(page, "document.querySelector('#scrub').valueAsNumber > 80")
    page.keyboard.press("Space")
    expect(page.locator("#play")).to_have_text("▶ Play")
    box = page.locator(".plot .u-over").first.bounding_box()
    page.mouse.move(box["x"] + 50, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 30)
    page.mouse.up()
    expect(page.get_by_role("button", name="Whole weld")).to_be_enabled()
    expect(page.locator("#map h2")).to_contain_text("57° welded")
    expect(page.locator(".notes li")).to_have_text(["▲ weld_1: 3 ticks without a command"])
    shot(page, "bags")
