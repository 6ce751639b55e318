"""The end of a weld on the page, and whether it is on record."""

import pytest
from playwright.sync_api import expect

from fsw_hmi.alarm_rules import Situation
from fsw_hmi.alarms import ACTIONS, NEXT_OF_BAG
from fsw_hmi.headline import headline
from fsw_test_support.browser import shot
from fsw_test_support.page_steps import ready


@pytest.fixture
def page(fake, open_page):
    return ready(open_page(fake.url))


@pytest.mark.parametrize("state", ["closed", "silent"])
def test_weld_that_is_done_shows_verdict_bag_and_next_action(fake, page, state):
    end = page.locator(".end-screen")
    expect(end).to_have_count(0)
    fake.progress["state"] = "done"
    fake.recording["state"] = state
    fake.measuring = False  # its plant has ended, too
    fake.push()
    expect(end).to_contain_text("Verdict of the rules so far: accept")
    expect(end).to_contain_text("weld/bag")
    expect(end).to_contain_text(f"Next: {ACTIONS[NEXT_OF_BAG[state]]}")
    expect(page.locator("#verdict")).to_have_attribute("data-level", "good")
    expect(page.locator("#verdict strong")).to_have_text("Weld done: Good")
    shot(page, f"end_{state}")
    end.get_by_role("button", name="Close").click()
    expect(end).to_have_count(0)
    fake.push()
    fake.stop()
    expect(page.locator("#verdict")).to_have_attribute("data-level", "attention")
    expect(page.locator("#verdict strong")).to_have_text("Weld done")
    expect(end).to_have_count(0)


def test_stopped_weld_cannot_be_continued_and_its_tool_still_turns(fake, page):
    fake.force_kn = 65.0
    fake.state.update(actual_mode="safe_stop", target_mode="safe_stop")
    fake.progress["state"] = "aborted"
    fake.push()
    end = page.locator(".end-screen")
    expect(end.locator("h2")).to_have_text("Weld aborted: it cannot be continued")
    expect(end).to_contain_text("rpm under 65 kN")
    expect(end).to_contain_text(f"Next: {ACTIONS['retract_and_acknowledge']}.")
    shot(page, "end_aborted")
    for changed in ({"acknowledged": True}, {"actual_mode": "hold"}, {"actual_mode": "auto"}):
        fake.state.update(changed)
        fake.push()
        expect(end).to_contain_text(f"Next: {ACTIONS[NEXT_OF_BAG['recording']]}.")


def test_old_values_are_not_shown_as_the_present_of_a_stop(fake, page):
    fake.force_kn = 65.0
    fake.state.update(actual_mode="safe_stop", target_mode="safe_stop")
    fake.progress["state"] = "aborted"
    fake.push()
    end, programme = page.locator(".end-screen"), page.locator("#progress strong")
    expect(end).to_contain_text("rpm under 65 kN")
    expect(programme).to_have_text("Stopped, tool turns")
    fake.measuring = False
    expect(programme).to_have_text("joint line (aborted)")
    expect(end).not_to_contain_text("65 kN")


def test_verdict_of_a_weld_is_not_that_of_the_next(fake, page):
    fake.progress["state"] = "done"
    fake.push()
    end = page.locator(".end-screen")
    expect(end).to_contain_text("accept")
    fake.account = None  # another weld begins, of which nothing is measured yet
    for state in ("running", "aborted"):
        fake.progress["state"] = state
        fake.push()
    expect(end.locator("h2")).to_contain_text("aborted")
    expect(end).to_contain_text("Not judged.")


def test_end_of_a_weld_that_the_headline_does_not_know_yet_says_nothing_of_what_is_next(
    fake, page, monkeypatch
):
    monkeypatch.setattr(fake, "_headline", lambda: {"t": "headline", **headline(Situation())})
    fake.progress["state"] = "done"
    fake.push()
    end = page.locator(".end-screen")
    expect(end).to_contain_text("Recording:")
    expect(end).not_to_contain_text("Next:")


def test_recording_shows_its_state_file_size_and_last_gap(fake, page):
    shown = page.locator(".recording")
    expect(shown).to_have_text("✓ recording, 12.3 MB")
    expect(shown).to_have_attribute("title", "✓ recording, 12.3 MB: weld/bag")
    fake.recording.update(state="silent", gap=[1.0, 5.5])
    fake.push()
    expect(shown).to_contain_text("■ recorder silent, 12.3 MB, gap of 4.5 s at ")
    shot(page, "recorder_silent")
