"""Staged situations on the screen: the headline and the open alarm have cause and next action."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from fsw_test_support.browser import shot
from fsw_test_support.page_steps import in_control, press, ready
from fsw_test_support.staged import STAGED, page_of

#: one of each kind: an alarm of a weld that runs, one without measurements, a stop
SHOWN = ["thermocouple frozen", "link to the PLC lost", "safe stop by an interlock"]


@pytest.mark.parametrize("name", SHOWN)
def test_headline_and_open_alarm_show_cause_and_action(fake, open_page, name):
    page, staged = ready(open_page(fake.url)), STAGED[name]
    fake.alarms, headline = page_of(staged)
    state = staged.moments[-1].state
    fake.state.update(actual_mode=state["actual_mode"], target_mode=state["target_mode"])
    fake.measuring = staged.moments[-1].tick_age_s < 1.0
    fake.push()
    expect(page.locator("#verdict strong")).to_have_text(headline["text"])
    expect(page.locator("#verdict .detail")).to_contain_text(headline["detail"])
    expect(page.locator("#verdict .detail")).to_contain_text(f"→ {headline['next']}")
    opened = page.locator(".alarm details[open]")
    expect(opened).to_have_count(1)
    expect(opened.locator("strong")).to_have_text(headline["text"])
    expect(opened).to_contain_text(f"→ {headline['next']}")
    whole = "(one) => one.scrollHeight <= one.clientHeight + 1"
    assert page.locator("#verdict .detail").evaluate(whole), "no ellipsis"
    shot(page, f"staged_{name.replace(' ', '_')}")


def test_lost_connection_says_what_to_do_and_the_resumed_session_has_control_and_answer(
    fake, open_page
):
    page = ready(open_page(fake.url))
    in_control(page)
    fake.mute = {"weld"}
    press(page, "Hold weld")
    answer = page.locator("#actions .answer")
    expect(answer).to_have_attribute("data-outcome", "pending")
    fake.cut()
    expect(page.locator("#verdict")).to_have_attribute("data-level", "high")
    expect(page.locator("#verdict .detail")).to_contain_text("→")
    fake.silent = False
    ready(page)
    expect(answer).to_have_attribute("data-outcome", "done")
    expect(page.get_by_role("button", name="Release control")).to_be_enabled()
