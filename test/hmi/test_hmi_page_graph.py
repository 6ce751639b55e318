"""Clicking in the page against a real graph: processes, DDS and a browser."""

import re
import time

import pytest
from playwright.sync_api import expect

from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import parse
from fsw_test_support.browser import shot
from fsw_test_support.page_steps import DRAWN_AHEAD, in_control, press, until
from fsw_test_support.patient_weld import PATIENT_ARGUMENTS, PatientWeld
from fsw_test_support.waiting import PATIENCE_S, wait_for_text

PARTS = {
    "decentral": ("fsw_decentral.decentral_node", []),
    "nmpc": ("fsw_nmpc.nmpc_node", []),
    "supervisor": (
        "fsw_supervisor.supervisor_node",
        [
            "--ros-args",
            *PATIENT_ARGUMENTS,
        ],
    ),
    "plant": ("fsw_plant.plant_node", ["--ros-args", "-p", "wait_for_subscribers:=3"]),
}
PROGRAMME = """
name: canister
announced: true
plant: {start.temperature_c: 816.4}
phases:
  - {name: dwell, duration_s: 2.0}
  - {name: joint_line, to_deg: 120.0, set_points: [{at_s: 1.0, temperature_c: 825.0, over_s: 10.0}]}
"""


@pytest.fixture
def address(tmp_path):
    """Address and token of a page at a weld that runs."""
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        launcher.start("hmi", "fsw_hmi.main", ["--port", "0"])
        url = wait_for_text(launcher, "hmi", r"http://\S+")
        token = wait_for_text(launcher, "hmi", r"token: \S+").split()[1]
        for name, (module, arguments) in PARTS.items():
            launcher.start(name, module, arguments)
        yield url, token, launcher


def fault(launcher, *arguments):
    """Let a sensor of the emulated plant fail."""
    launcher.start("fault", "fsw.main", ["fault", *arguments])


def hold_after_stop(page):
    """Acknowledge a stop and ask for hold, again if a tick missed meanwhile has demanded another acknowledgement."""
    acknowledge = page.get_by_role("button", name="Acknowledge stop")
    mode = page.get_by_role("button", name="Mode", exact=True)
    form, end_s = page.locator("dialog"), time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if acknowledge.is_enabled():
            acknowledge.click()
            expect(acknowledge).to_be_disabled()
        elif mode.is_enabled():
            mode.click()
            form.get_by_label("hold").check()
            press(page, "Change mode")
            refused = form.get_by_text("refused")
            expect(page.locator("body:not(:has(dialog))").or_(refused)).to_have_count(1)
            if not refused.count():
                return
            press(page, "Cancel")
        else:
            page.wait_for_timeout(20)
    pytest.fail("hold was refused all the time")


def test_set_points_swap_and_safe_stop_by_clicking(address, open_page):
    url, token, _ = address
    page = open_page(url)
    in_control(page, secret=token)
    expect(page.locator("#value-depth_mm output")).not_to_have_text("–")
    press(page, "Set-points")
    form = page.locator("dialog")
    form.get_by_label("Depth").fill("2.66")
    form.get_by_label("Temperature").fill("816.4")
    form.get_by_label("as a ramp").uncheck()
    press(page, "Apply set-points")
    expect(form).to_have_count(0)
    expect(page.locator("#who strong")).to_contain_text("auto")
    other = "decentral" if page.locator("#who strong").inner_text().startswith("nmpc") else "nmpc"
    press(page, "Controller")
    form.get_by_label(other).check()
    form.locator("select").select_option("10")
    press(page, "Swap")
    expect(form).to_have_count(0)
    expect(page.locator("#who strong")).to_have_text(f"{other} · auto")
    shot(page, "graph")
    page.locator("#safe-stop").click()
    expect(page.locator("#who strong")).to_have_text("safe stop")
    expect(page.locator("#verdict")).to_have_attribute("data-level", "high")
    shot(page, "graph_safe_stop")
    hold_after_stop(page)
    expect(page.locator("#who strong")).to_contain_text("hold")


@pytest.fixture
def programme(tmp_path):
    """Address and token of a page at a weld that follows a programme."""
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        launcher.start(
            "hmi", "fsw_hmi.main", ["--port", "0", "--ros-args", "-p", "request_timeout_s:=60.0"]
        )
        url = wait_for_text(launcher, "hmi", r"http://\S+")
        token = wait_for_text(launcher, "hmi", r"token: \S+").split()[1]
        PatientWeld(
            parse(PROGRAMME), tmp_path / "weld", ["decentral", "nmpc"], realtime=True
        ).start(launcher)
        yield url, token, launcher


# with a page that others play to: test_hmi_page.py; without the page: test_hmi_weld.py
@pytest.mark.full
def test_programme_is_held_and_resumed_and_its_weld_unrolled_by_clicking(programme, open_page):
    url, token, launcher = programme
    page = open_page(url)
    in_control(page, secret=token)
    form, progress, unrolled = (
        page.locator("dialog"),
        page.locator("#progress"),
        page.locator("#map h2"),
    )
    plan = page.locator("#value-temperature_c .plan")
    expect(progress).to_contain_text("joint line")
    expect(plan).to_have_text("= programme 825.0")  # its ramp is over
    expect(unrolled).to_contain_text(re.compile(r"[1-9]\d*° welded"))
    press(page, "Hold weld")
    expect(progress).to_contain_text("held")

    press(page, "Set-points")
    form.get_by_label("Temperature").fill("818")
    form.get_by_label("as a ramp").uncheck()
    press(page, "Apply set-points")
    expect(form).to_have_count(0)
    expect(plan).to_have_text("≠ programme 825.0")
    assert page.evaluate(DRAWN_AHEAD) == [False] * 4
    press(page, "Resume weld")
    expect(page.locator(".summary")).to_contain_text(
        "818.0 → 825.0 °C (+7.0); back to the programme by a ramp of "
    )
    until(page, f"{DRAWN_AHEAD}.join() === 'true,true,false,false'")
    shot(page, "graph_resume")
    form.locator("button[type=submit]").click()
    expect(form).to_have_count(0)
    expect(plan).to_have_text("= programme 825.0")
    expect(progress).not_to_contain_text("held")

    # a depth that is measured wrong leaves the band, and that is marked where it was
    fault(launcher, "depth", "bias", "0.3", "--duration", "5")
    mark = page.locator(".exceedances button").first
    expect(mark).to_have_attribute(
        "aria-label", re.compile(r"depth error outside: .*, \d+° to \d+°, \d\d:\d\d:\d\d")
    )
    expect(unrolled).not_to_contain_text("nowhere outside")
    mark.click()
    back = page.get_by_role("button", name="Back to now")
    expect(back).to_be_visible()
    shot(page, "graph_unrolled")
    back.click()
    expect(back).to_be_hidden()
