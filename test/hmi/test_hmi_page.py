"""The operator's page in a browser, with a server that does what the test wants."""

import re
import time
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

from fsw_test_support.browser import shot
from fsw_test_support.fake_hmi import PLACE, TOKEN, FakeHmi, good_account, sample_alarms
from fsw_test_support.page_boxes import faults
from fsw_test_support.page_steps import (
    in_control,
    log_in,
    press,
    ready,
    settled,
    until,
)


def test_live_values_and_progress_are_on_the_screen(fake, open_page):
    page = ready(open_page(fake.url))
    fake.depth_offset_mm = 0.05
    until(
        page,
        "Math.abs(parseFloat(document.querySelector('#value-depth_mm "
        "output').textContent) - 2.75) < .1",
    )
    expect(page.locator("#who strong")).to_have_text("nmpc · auto")
    expect(page.locator("#progress .detail")).to_contain_text("143°")
    expect(page.locator(".trend.depth_mm .unit")).to_have_text("mm")  # no sensor that is not there
    shot(page, "good")


def test_value_beyond_its_limit_is_told_in_words_and_colour(fake, open_page):
    page = ready(open_page(fake.url))
    fake.depth_offset_mm = 1.2
    expect(page.locator("#value-depth_mm .flag")).to_have_text("■ beyond trip, high")
    expect(page.locator("#verdict strong")).to_have_text("Depth: beyond trip, high")


def test_value_far_off_its_set_point_is_not_normal_though_inside_its_limits(fake, open_page):
    page = ready(open_page(fake.url))
    fake.temperature_offset_c = 37.0
    expect(page.locator("#value-temperature_c .flag")).to_have_text("▲ off set-point, high")
    expect(page.locator("#verdict strong")).to_have_text("Temperature: off its set-point, high")


def test_value_off_the_scale_is_marked(fake, open_page):
    page = ready(open_page(fake.url))
    pointer = page.locator("#value-force_kn .pointer")
    expect(pointer).not_to_have_class(re.compile("off"))
    fake.force_kn = 40.0
    expect(page.locator("#value-force_kn .flag")).to_contain_text("off scale")
    expect(pointer).to_have_class(re.compile("off"))
    shot(page, "off_scale")


def test_set_point_out_of_reach_is_marked_with_what_is_attainable(fake, open_page):
    page = ready(open_page(fake.url))
    tile, mark = page.locator("#value-temperature_c"), page.locator("#value-temperature_c .goal")
    expect(mark).to_be_hidden()
    fake.attainable = {"depth_mm": 2.66, "temperature_c": 831.0}
    fake.push()
    expect(tile.locator(".flag")).to_have_text("● attainable 831.0")
    expect(mark).to_be_visible()
    fake.temperature_offset_c = 37.0  # which it explains
    expect(tile.locator(".flag")).to_have_text("▲ attainable 831.0")
    fake.temperature_offset_c, fake.attainable = 0.0, None
    fake.push()
    expect(tile.locator(".flag")).to_be_empty()
    expect(mark).to_be_hidden()


def test_alarms_are_ordered_announced_and_acknowledged(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    fake.alarms = sample_alarms(time.time())
    fake.push()
    expect(page.locator(".alarm .text").first).to_contain_text("Safe stop: hold for 10 s")
    expect(page.locator(".alarm", has_text="first out")).to_contain_text("Temperature above")
    expect(page.locator("#announce-alarms")).to_contain_text("high alarm: Depth sensor invalid")
    shot(page, "alarms")
    press(page, "Ack: Depth sensor invalid: frozen")
    expect(page.locator("#actions .answer")).to_have_text("Acknowledge alarm: ✓ done")
    assert fake.requests[-1]["ids"] == ["depth:stale"]
    next(alarm for alarm in fake.alarms if alarm["first_out"])["state"] = "cleared"
    fake.push()
    expect(page.locator(".alarm.cleared", has_text="first out")).to_contain_text(
        "Temperature above"
    )


def test_alarm_is_shelved_with_a_time_and_a_reason_and_taken_back(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    fake.alarms = sample_alarms(time.time())
    fake.push()
    expect(page.locator(".reach")).to_have_text("✓ Commands reach the machine")
    expect(page.locator(".alarm", has_text="Depth sensor")).to_contain_text("3 times")
    expect(page.get_by_role("button", name="Shelve: Depth sensor")).to_have_count(
        0
    )  # of high priority
    page.locator("summary", has_text="Temperature above 900 °C").click()
    press(page, "Shelve: Temperature above 900 °C")
    page.get_by_label("20 min").check()
    page.get_by_label("Why").fill("set-point is being lowered")
    page.locator("dialog").get_by_role("button", name="Shelve").click()
    expect(page.locator("#actions .answer")).to_have_text("Shelve an alarm: ✓ done")
    asked = {
        "alarm": "temperature_high:warn",
        "minutes": 20,
        "reason": "set-point is being lowered",
    }
    assert fake.requests[-1] == fake.requests[-1] | asked | {"do": "shelve"}
    press(page, "Back: x no longer reports")
    expect(page.locator("#actions .answer")).to_have_text("Take an alarm back: ✓ done")
    assert fake.requests[-1]["alarm"] == "node:x"


@pytest.mark.requirement("S16")
def test_server_that_is_gone_is_told_and_commands_are_off(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    fake.stop()
    expect(page.locator("#veil-text")).to_contain_text("Disconnected since")
    expect(page.locator("#veil")).to_have_css("opacity", "1")
    expect(page.locator("#safe-stop")).to_contain_text("not connected: stop at the machine")
    expect(page.get_by_role("button", name="Set-points")).to_be_disabled()
    shot(page, "disconnected")


@pytest.mark.requirement("S18")
@pytest.mark.requirement("S19")
def test_page_that_is_cut_off_keeps_form_and_control_and_sends_its_stop_first(fake, open_page):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Set-points")
    page.locator("dialog").get_by_label("Depth").fill("2.75")
    before = len(fake.requests)
    fake.cut()
    expect(page.locator("body")).to_have_attribute("data-link", "lost")
    page.locator("#safe-stop").click()
    expect(page.locator("#safe-stop")).to_contain_text("waits for the connection")
    fake.silent = False
    expect(page.locator("#who strong")).to_have_text("safe stop")
    assert [request["do"] for request in fake.requests[before:]] == ["safe_stop"]  # no login again
    expect(page.locator(".control")).to_have_text("Anna (you) has control.")
    expect(page.locator("dialog").get_by_label("Depth")).to_have_value("2.75")


@pytest.mark.requirement("S19")
def test_stop_that_is_lost_with_its_connection_is_sent_with_the_next(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    page.evaluate("() => { window.sends = WebSocket.prototype.send }")
    page.evaluate("() => { WebSocket.prototype.send = () => {} }")  # its loss is not noticed yet
    page.locator("#safe-stop").click()
    fake.cut()
    expect(page.locator("#safe-stop")).to_contain_text("waits for the connection")
    page.evaluate("() => { WebSocket.prototype.send = window.sends }")
    fake.silent = False
    expect(page.locator("#who strong")).to_have_text("safe stop")


@pytest.mark.requirement("S19")
def test_stop_that_waits_too_long_for_the_connection_is_told(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    fake.cut()
    expect(page.locator("body")).to_have_attribute("data-link", "lost")
    page.locator("#safe-stop").click()
    expect(page.locator("#safe-stop")).to_contain_text("waits for the connection")
    expect(page.locator("#actions .answer")).to_have_attribute("data-outcome", "timed_out")
    expect(page.locator("#safe-stop")).to_contain_text("not connected: stop at the machine")


@pytest.mark.requirement("S16")
@pytest.mark.full
def test_silent_connection_is_told_and_comes_back(fake, open_page):
    page = ready(open_page(fake.url, silence_ms=6000))
    fake.silent = True
    expect(page.locator("#veil-text")).to_contain_text("Frozen: no news since")
    fake.silent = False
    ready(page)
    expect(page.locator("#veil")).to_have_css("opacity", "0")


@pytest.mark.requirement("S16")
@pytest.mark.full
def test_page_whose_script_hangs_is_veiled_without_it(fake, open_page):
    page = ready(open_page(fake.url, patient=False))
    # the animation runs towards the veil by itself; only news of the weld wind it back
    hang = """new Promise((done) => setTimeout(() => {
        const end = performance.now() + 1200;
        while (performance.now() < end);
        done(document.querySelector("#veil").getAnimations()[0].effect.getTiming().duration);
    }))"""
    assert any(
        page.evaluate(hang) < 1000.0 for _ in range(20)
    )  # a page that is cut off just then is veiled already
    ready(page)


@pytest.mark.requirement("S16")
def test_measurements_that_stop_are_told_though_the_server_lives(fake, open_page):
    page = ready(open_page(fake.url))
    fake.measuring = False
    expect(page.locator("#verdict strong")).to_have_text("No measurements")
    expect(page.locator("body")).to_have_class("live old")


def test_wrong_token_is_refused_in_the_servers_words(fake, open_page):
    page = ready(open_page(fake.url))
    log_in(page, secret="guess")
    expect(page.locator("dialog .answer")).to_have_text("✕ refused: wrong token")


def test_page_of_an_old_build_asks_for_a_reload(fake, open_page):
    fake.build = "newer"
    page = open_page(fake.url)
    expect(page.locator("dialog")).to_contain_text("out of date")
    expect(page.get_by_role("button", name="Reload")).to_be_visible()


def test_set_points_show_from_to_and_ramp_before_they_are_sent(fake, open_page):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Set-points")
    page.locator("dialog").get_by_label("Temperature").fill("826.4")
    expect(page.locator(".summary")).to_have_text(
        "Temperature 816.4 → 826.4 °C (+10.0), by a ramp of 10 s"
    )
    shot(page, "set_points")
    press(page, "Apply set-points")
    expect(page.locator("dialog")).to_have_count(0)
    assert (
        fake.requests[-1]["do"] == "set_reference" and fake.requests[-1]["temperature_c"] == 826.4
    )


def test_mode_by_hand_asks_for_force_and_speed(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Mode")
    expect(page.get_by_label("Force in manual")).to_be_hidden()
    page.get_by_label("manual", exact=False).first.check()
    page.get_by_label("Force in manual").fill("80")
    page.get_by_label("Speed in manual").fill("410")
    assert settled(page, lambda: faults(page)) == {}
    press(page, "Change mode")
    expect(page.locator("dialog")).to_have_count(0)
    sent = fake.requests[-1]
    assert (sent["mode"], sent["force_kn"], sent["speed_rpm"]) == ("manual", 80, 410)


def test_swap_shows_why_it_is_refused(fake, open_page):
    fake.refusals["switch"] = "decentral is not ready: no set-points"
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Controller")
    press(page, "Swap")
    expect(page.locator("dialog .answer")).to_have_text(
        "✕ refused: decentral is not ready: no set-points"
    )


def test_swap_offers_the_first_that_is_ready_and_not_one_that_is_certain_to_be_refused(
    fake, open_page
):
    ready_one = fake.state["controllers"][1]
    dead = ready_one | {"name": "dead", "ready": False, "healthy": False, "reason": "has left"}
    warming = ready_one | {"name": "warming", "ready": False, "reason": "is not ready: 1 of 5"}
    fake.state["controllers"] = [dead, *fake.state["controllers"], warming]
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Controller")
    form, swap = page.locator("dialog"), page.get_by_role("button", name="Swap", exact=True)
    expect(form.get_by_label("decentral")).to_be_checked()
    expect(swap).to_be_enabled()
    form.get_by_label("dead").check()
    expect(swap).to_be_disabled()
    expect(swap).to_have_attribute("title", re.compile("has left"))
    form.get_by_label("warming").check()  # which may become ready within 2 s
    expect(swap).to_be_enabled()
    form.get_by_label("Wait until it is ready").select_option("0")
    expect(swap).to_be_disabled()


@pytest.mark.requirement("S19")
@pytest.mark.parametrize("way", ["click", "keys"])
def test_safe_stop_is_one_action_even_over_a_form(fake, open_page, way):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Set-points")
    if way == "click":
        page.locator("#safe-stop").click()
    else:
        page.keyboard.press("Control+.")
    expect(page.locator("#who strong")).to_have_text("safe stop")


def test_safe_stop_without_login_asks_for_the_token_and_then_stops(fake, open_page):
    page = ready(open_page(fake.url))
    page.locator("#safe-stop").click()
    page.get_by_label("Name").fill("Anna")
    page.get_by_label("Token").fill(TOKEN)
    press(page, "Log in and safe stop")
    expect(page.locator("#who strong")).to_have_text("safe stop")


@pytest.mark.requirement("S20")
def test_request_that_nobody_answers_times_out(fake, open_page):
    def impatient(route):
        response = route.fetch()
        text = response.text().replace("ANSWER_MS = 15_000", "ANSWER_MS = 200")
        route.fulfill(response=response, body=text)

    fake.local_stop, fake.mute = True, {"safe_stop"}
    page = open_page(fake.url, patient=False)
    page.route("**/connection.js*", impatient)
    page.reload()
    ready(page).locator("#safe-stop").click()
    expect(page.locator("#actions .answer")).to_contain_text("no answer from the server")


def test_normal_screen_has_no_internal_words(fake, open_page):
    page = ready(open_page(fake.url))
    in_control(page)
    expect(page.locator("#who strong")).to_have_text("nmpc · auto")
    text = page.locator("body").inner_text()
    assert (
        re.findall(r"fsw\w*|\w+_\w+|\bNone\b|\bNaN\b|undefined|null|\[object|/diagnostics", text)
        == []
    )


def test_safe_stop_on_the_servers_computer_needs_no_login(fake, open_page):
    fake.local_stop = True
    page = ready(open_page(fake.url))
    page.locator("#safe-stop").click()
    expect(page.locator("#who strong")).to_have_text("safe stop")


def test_without_control_alarms_and_commands_are_disabled_and_say_why(fake, open_page):
    fake.progress["state"] = "held"  # only then set-points are by hand
    fake.alarms = sample_alarms(time.time())
    page = open_page(fake.url)
    log_in(page)
    for name in (
        "Ack: Depth sensor invalid: frozen",
        "Ack all",
        "Set-points",
        "Abort weld",
    ):
        button = page.get_by_role("button", name=name, exact=True)
        expect(button).to_be_disabled()
        expect(button).to_have_attribute("title", "Take control to command.")
    expect(page.locator(".reach")).to_contain_text("Ack and Shelve need control.")
    press(page, "Take control")
    expect(page.get_by_role("button", name="Ack all")).to_be_enabled()
    expect(page.get_by_role("button", name="Set-points")).to_have_attribute("title", "")
    stop = page.get_by_role("button", name="Acknowledge stop")
    expect(stop).to_be_disabled()
    expect(stop).to_have_attribute("title", "There is no safe stop to acknowledge.")


@pytest.mark.requirement("S18")
def test_control_lost_by_a_restart_of_the_server_is_told_and_closes_the_form(fake, open_page):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = ready(open_page(fake.url))
    in_control(page)
    press(page, "Set-points")
    expect(page.locator("form")).to_be_visible()
    fake.stop()
    again = FakeHmi(port=fake.port).start()
    try:
        expect(page.locator(".control")).to_have_text(
            "Nobody has control. Take control to command. "
            "Control was lost with the connection to the server."
        )
        expect(page.locator(".control")).to_have_attribute("data-level", "medium")
        expect(page.locator("form")).to_have_count(0)
        press(page, "Take control")
        expect(page.locator(".control")).to_have_text("Anna (you) has control.")
    finally:
        again.stop()


@pytest.mark.parametrize(
    ("state", "left", "possible"),
    [
        ("running", False, ["Hold weld", "Abort weld"]),
        ("running", True, ["Hold weld", "Resume weld", "Abort weld"]),
        ("held", True, ["Resume weld", "Abort weld"]),
        ("done", False, []),
        ("aborted", False, []),
    ],
)
def test_what_the_programme_would_refuse_is_disabled_with_the_reason(
    fake, open_page, state, left, possible
):
    fake.progress.update(state=state, left=left)
    page = open_page(fake.url)
    in_control(page)
    for name in ("Hold weld", "Resume weld", "Abort weld"):
        button = page.get_by_role("button", name=name)
        if name in possible:
            expect(button).to_be_enabled()
        else:
            expect(button).to_be_disabled()
            expect(button).to_have_attribute("title", re.compile("weld|programme"))


@pytest.mark.parametrize(
    ("changed", "left", "lack"),
    [
        ({}, False, {"Set-points"}),
        ({}, True, set()),
        ({"actual_mode": "safe_stop"}, True, {"Mode"}),
        ({"actual_mode": "safe_stop", "acknowledged": True}, True, set()),
        ({"known": False}, True, {"Set-points", "Controller", "Mode", "Acknowledge stop"}),
    ],
)
def test_what_the_supervisor_would_refuse_is_disabled_with_the_reason(
    fake, open_page, changed, left, lack
):
    fake.progress["left"] = left
    fake.state.update(changed)
    page = open_page(fake.url)
    in_control(page)
    if changed.get("actual_mode") != "safe_stop" or changed.get("acknowledged"):
        lack = lack | {"Acknowledge stop"}
    for name in ("Set-points", "Controller", "Mode", "Acknowledge stop"):
        button = page.get_by_role("button", name=name)
        if name in lack:
            expect(button).to_be_disabled()
            expect(button).to_have_attribute("title", re.compile("."))
        else:
            expect(button).to_be_enabled()


def test_weld_that_is_aborted_and_stopped_is_not_continued(fake, open_page):
    fake.progress["state"] = "aborted"
    fake.state.update(actual_mode="safe_stop", acknowledged=True)
    page = open_page(fake.url)
    in_control(page)
    for name in ("Set-points", "Controller"):
        button = page.get_by_role("button", name=name)
        expect(button).to_be_disabled()
        expect(button).to_have_attribute("title", "This weld cannot be continued.")
    press(page, "Mode")
    form, confirm = page.locator("dialog:not(.notice)"), page.locator("dialog button[type=submit]")
    form.get_by_label(re.compile("^hold")).check()
    expect(confirm).to_be_enabled()
    form.get_by_label(re.compile("^auto")).check()
    expect(confirm).to_be_disabled()
    expect(form.locator(".summary")).to_have_text("This weld cannot be continued.")


def test_local_time_is_beside_utc(fake, open_page):
    page = open_page(fake.url, timezone_id="Asia/Kolkata")
    shown = page.locator("#clock .detail").first
    expect(shown).to_have_text(re.compile(r"UTC · \d\d:\d\d:\d\d local"))
    utc, local = page.evaluate(
        """[document.querySelector("#clock .time").textContent, document.querySelector("#clock .detail").textContent]"""
    )
    minutes = [60 * int(text[:2]) + int(text[3:5]) for text in (utc, local.split()[2])]
    assert (minutes[1] - minutes[0]) % 1440 == 330


def test_form_holds_what_may_be_sent_only(fake, open_page):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = ready(open_page(fake.url))
    in_control(page)
    form, confirm = page.locator("dialog"), page.locator("dialog button[type=submit]")
    press(page, "Mode")
    form.get_by_label(re.compile("^manual")).check()
    form.get_by_label("Force in manual").fill("59")
    expect(confirm).to_be_disabled()
    form.get_by_label("Force in manual").fill("78")
    expect(confirm).to_be_enabled()
    press(page, "Set-points")
    expect(form.locator(".summary")).to_have_text("These are the set-points in force.")
    form.get_by_label("Depth").fill("3.7")  # a trip
    expect(confirm).to_be_disabled()
    expect(form.locator("label", has_text="Depth")).to_contain_text("1.5 to 3.69 mm")
    form.get_by_label("Depth").fill("")
    expect(form.locator(".summary")).to_have_text("Depth and temperature are both needed.")
    assert fake.requests[-1]["do"] == "take_control"


def test_programme_and_set_points_in_force_are_side_by_side(fake, open_page):
    page = ready(open_page(fake.url))
    expect(page.locator("#value-temperature_c .plan")).to_have_text("= programme 816.4")
    fake.progress["temperature_c"] = 826.4
    fake.push()
    expect(page.locator("#value-temperature_c .plan.differs")).to_have_text("≠ programme 826.4")
    expect(page.locator("#value-temperature_c .planned")).to_be_visible()


def test_stop_is_followed_until_the_force_is_safe(fake, open_page):
    page = ready(open_page(fake.url))
    fake.held_s = 600.0  # however busy the machine is
    fake.force_kn = 78.0
    expect(page.locator("#value-force_kn output")).to_have_text("78.0")
    fake.state.update(actual_mode="safe_stop", target_mode="safe_stop", reason="operator")
    fake.progress["state"] = "aborted"
    fake.push()
    expect(page.locator("#progress strong")).to_have_text("Stopping: 78.0 → 65.0 kN")
    fake.force_kn = 70.0
    expect(page.locator("#progress strong")).to_have_text("Stopping: 70.0 → 65.0 kN")
    assert page.locator("#progress progress").evaluate("(one) => one.value") == pytest.approx(
        8 / 13, abs=1e-4
    )
    fake.held_s += 20.0
    expect(page.locator("#progress strong")).to_have_text("■ Force does not fall: 70.0 kN")
    fake.force_kn = 65.0
    expect(page.locator("#progress strong")).to_have_text("Stopped, tool turns")
    expect(page.locator("#progress .detail")).to_contain_text("this weld cannot be continued")
    expect(page.locator("#progress .detail")).to_contain_text("programme aborted at 143°")


def test_weld_is_unrolled_and_its_exceedances_lead_to_their_moments(fake, open_page):
    page = ready(open_page(fake.url))
    expect(page.locator("#map h2")).to_have_text(
        "Weld, unrolled 143° welded, nowhere outside the limits"
    )
    expect(page.locator("#verdict strong")).to_have_text("Good")
    fake.account = good_account(PLACE)
    fake.push()
    expect(page.locator("#verdict")).to_have_attribute("data-level", "medium")
    mark = page.locator(".exceedances button")
    label = re.compile(r"Depth error outside, 143° to 144°, \d\d:\d\d:\d\d")
    expect(mark).to_have_attribute("aria-label", label)
    assert page.locator(".way .medium").get_attribute("d")
    shot(page, "exceedance")
    mark.click()
    back = page.get_by_role("button", name="Back to now")
    expect(back).to_be_visible()
    back.click()
    expect(back).to_be_hidden()


def test_exceedance_without_a_place_is_beside_the_map_and_not_on_it(fake, open_page):
    page = ready(open_page(fake.url))
    fake.account = good_account(PLACE | {"from_deg": None, "to_deg": None})
    fake.push()
    mark = page.locator(".unplaced button")
    expect(mark).to_have_attribute(
        "aria-label", re.compile("Depth error outside, place not known")
    )
    expect(page.locator("#map h2")).to_contain_text("once outside the limits")
    expect(page.locator(".exceedances button")).to_have_count(0)
    assert not page.locator(".way .medium").get_attribute("d")
    mark.click()
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()
    fake.account = good_account(PLACE)
    fake.push()
    expect(page.locator(".exceedances button")).to_have_count(1)
    expect(mark).to_have_count(0)


def test_bands_and_levels_keep_their_colours_where_the_reader_chose_others(fake, open_page):
    page = ready(open_page(fake.url))
    colours = (
        "[...document.querySelectorAll('.band, .scale, "
        ".key')].map((one) => { const style = getComputedStyle(one); "
        "return [style.backgroundColor, style.backgroundImage, style.borderTopColor].join() })"
    )
    before = page.evaluate(colours)
    page.emulate_media(forced_colors="active")
    assert page.evaluate("matchMedia('(forced-colors: active)').matches")
    assert page.evaluate(colours) == before
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(201, 205, 208)"


#: texts on a panel, beside something that keeps its own colours
BESIDE_COLOURS = ["#who strong", "#progress strong", ".scale .tick.highest", ".legend li"]


def contrast(image):
    """Ratio of the lightest to the darkest pixel of a picture, as WCAG 2 has it."""
    colours = np.asarray(Image.open(BytesIO(image)).convert("RGB")) / 255.0
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return (luminance.max() + 0.05) / (luminance.min() + 0.05)


def test_texts_are_readable_in_forced_dark_colours(fake, open_page):
    page = ready(open_page(fake.url, forced_colors="active", color_scheme="dark"))
    contrasts = {name: contrast(page.locator(name).first.screenshot()) for name in BESIDE_COLOURS}
    assert {name: ratio for name, ratio in contrasts.items() if ratio < 4.5} == {}
