"""Clicking in the page against a real graph: processes, DDS and a browser."""

import pytest
from playwright.sync_api import expect

from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_test_support.browser import shot
from fsw_test_support.patient_weld import PATIENT_ARGUMENTS
from fsw_test_support.waiting import wait_for_text

#: what a stop cools until it is acknowledged, is no further cause to stop
WIDE = ("low.warn:=310.0", "low.trip:=300.0")
PARTS = {
    "decentral": ("fsw_decentral.decentral_node", []),
    "nmpc": ("fsw_nmpc.nmpc_node", []),
    "supervisor": (
        "fsw_supervisor.supervisor_node",
        ["--ros-args", *PATIENT_ARGUMENTS, *(word for one in WIDE for word in ("-p", f"interlocks.temperature_{one}"))],
    ),
    "plant": ("fsw_plant.plant_node", ["--ros-args", "-p", "wait_for_subscribers:=3"]),
}


@pytest.fixture
def address(tmp_path):
    """Address and token of a page at a weld that runs."""
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        launcher.start("hmi", "fsw_hmi.main", ["--port", "0"])
        url = wait_for_text(launcher, "hmi", r"http://\S+")
        token = wait_for_text(launcher, "hmi", r"token: \S+").split()[1]
        for name, (module, arguments) in PARTS.items():
            launcher.start(name, module, arguments)
        yield url, token


def test_set_points_swap_disturbance_fault_and_safe_stop_by_clicking(address, open_page):
    url, token = address
    page = open_page(url)

    def press(name):
        page.get_by_role("button", name=name, exact=True).click()

    press("Log in")
    page.get_by_label("Name").fill("Anna")
    page.get_by_label("Token").fill(token)
    press_in_form = page.locator("dialog button[type=submit]")
    press_in_form.click()
    press("Take control")
    expect(page.locator("#value-depth_mm output")).not_to_have_text("–")
    press("Set-points")
    form = page.locator("dialog")
    form.get_by_label("Depth").fill("2.66")
    form.get_by_label("Temperature").fill("816.4")
    form.get_by_label("as a ramp").uncheck()
    press("Apply set-points")
    expect(form).to_have_count(0)
    expect(page.locator("#who strong")).to_contain_text("auto")
    other = "decentral" if page.locator("#who strong").inner_text().startswith("nmpc") else "nmpc"
    press("Controller")
    form.get_by_label(other).check()
    form.locator("select").select_option("10")
    press("Swap")
    expect(form).to_have_count(0)
    expect(page.locator("#who strong")).to_have_text(f"{other} · auto")
    press("Disturb")
    expect(form.get_by_label("Period")).to_be_hidden()
    form.get_by_label("Shape").select_option("sine")
    form.get_by_label("Amplitude").fill("0.02")
    expect(form.get_by_label("Duration")).to_be_hidden()
    form.get_by_label("Period").fill("20")
    shot(page, "graph_disturb")
    press_in_form.click()
    expect(form).to_have_count(0)
    press("Fault")
    form.get_by_label("Fault").select_option("bias")
    form.get_by_label("Size").fill("0.01")
    press("Set the fault")
    expect(form).to_have_count(0)
    shot(page, "graph")
    page.locator("#safe-stop").click()
    expect(page.locator("#who strong")).to_have_text("safe stop")
    expect(page.locator("#verdict")).to_have_attribute("data-level", "high")
    shot(page, "graph_safe_stop")
    press("Acknowledge stop")
    expect(page.get_by_role("button", name="Acknowledge stop")).to_be_disabled()
    press("Mode")
    form.get_by_label("hold").check()
    press("Change mode")
    expect(form).to_have_count(0)
    expect(page.locator("#who strong")).to_contain_text("hold")
