"""Login and control in a browser: what several people see of each other."""

import pytest
from playwright.sync_api import expect

from fsw_hmi.users import Users, new_user
from fsw_test_support.browser import shot
from fsw_test_support.fake_hmi import TOKEN, FakeHmi

PASSWORD = "correct horse battery"
NAMES = ("otto", "olga")


@pytest.fixture
def make_fake():
    servers = []

    def make(**options):
        server = FakeHmi(**options)
        server.measuring = (
            False  # nothing is drawn: several pages are open on a machine that may be busy
        )
        servers.append(server.start())
        return server

    yield make
    for server in servers:
        server.stop()


@pytest.fixture
def fake(make_fake):
    users = Users(new_user(name, PASSWORD) for name in NAMES)
    return make_fake(users=users, handover_timeout_s=3600.0)


@pytest.fixture
def person(open_page):
    """Opens a page and logs in."""

    def person(fake, name, secret=PASSWORD, label="Password", size=(1280, 800)):
        page = open_page(fake.url, *size)
        press(page, "Log in")
        page.get_by_label("Name").fill(name)
        page.get_by_label(label).fill(secret)
        page.keyboard.press("Enter")
        expect(page.locator("dialog")).to_have_count(0)
        return page

    return person


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def says(page, text):
    expect(page.locator(".control")).to_contain_text(text)


def test_control_is_asked_for_and_handed_over(fake, person):
    fake.progress["state"] = "held"  # only then set-points are by hand
    otto, olga = person(fake, "otto"), person(fake, "olga")
    press(otto, "Take control")
    says(otto, "otto (you) has control.")
    says(olga, "otto has control. Ask for control to command.")
    press(otto, "Set-points")
    press(olga, "Ask for control")
    says(olga, "s left to answer")
    notice = otto.get_by_role("alertdialog")
    expect(notice).to_contain_text("olga asks for control and may take it in")
    expect(otto.locator("form")).to_be_visible()  # nothing is lost before it is answered
    shot(otto, "request_for_control")
    press(otto, "Hand over to olga")
    says(olga, "olga (you) has control. Otto has handed control over to you.")
    says(
        otto, "olga has control. Ask for control to command. You have handed control over to olga."
    )
    expect(otto.locator("dialog")).to_have_count(0)  # nor is anything sent by who has lost it
    expect(otto.get_by_role("button", name="Set-points")).to_be_disabled()
    asked = [entry["action"] for entry in fake.actions if entry["action"] != "log in"]
    assert asked == ["take control", "request control", "hand over control"]


def test_request_is_refused_and_withdrawn_and_users_have_further_pages(fake, person):
    fake.pages = ["history"]
    otto, olga = person(fake, "otto"), person(fake, "olga")
    with olga.context.expect_page() as opened:
        press(olga, "History")
    assert "/pages/history?ticket=" in opened.value.url
    opened.value.close()
    press(otto, "Take control")
    press(olga, "Ask for control")
    press(otto, "Keep control")
    expect(otto.get_by_role("alertdialog")).to_have_count(0)
    says(olga, "Ask for control to command. Otto keeps control.")
    press(olga, "Ask for control")
    expect(otto.get_by_role("alertdialog")).to_be_visible()
    press(olga, "Withdraw request")
    expect(otto.get_by_role("alertdialog")).to_have_count(0)
    assert fake.holder.name == "otto"


def test_control_is_taken_only_when_nobody_answers_and_closes_the_form_of_who_had_it(
    make_fake, person
):
    fake = make_fake(handover_timeout_s=0.0)
    anna, bert = person(fake, "Anna", TOKEN, "Token"), person(fake, "Bert", TOKEN, "Token")
    press(anna, "Take control")
    press(anna, "Mode")
    press(bert, "Ask for control")
    says(bert, "Take control to command.")
    press(bert, "Take control")
    assert fake.holder.name == "Anna"
    press(bert, "Take control from Anna")
    says(
        anna,
        "Bert has control. Ask for control to command. Bert has taken control: nobody answered",
    )
    expect(anna.locator("dialog")).to_have_count(0)
    assert fake.requests[-1]["do"] == "take_control"


def test_name_that_may_be_confused_is_not_sent(fake, open_page):
    page = open_page(fake.url)
    press(page, "Log in")
    page.get_by_label("Name").fill("\u0430nna")
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    assert page.get_by_label("Name").evaluate("one => one.validity.patternMismatch")
    assert fake.requests == []


@pytest.mark.parametrize(
    "size",
    [(390, 844), pytest.param((1280, 800), marks=pytest.mark.full)],
    ids="{0[0]}x{0[1]}".format,
)
def test_request_leaves_the_safe_stop_free(fake, person, size):
    otto, olga = person(fake, "otto", size=size), person(fake, "olga")
    press(otto, "Take control")
    press(olga, "Ask for control")
    expect(otto.get_by_role("alertdialog")).to_be_visible()
    otto.locator("#safe-stop").click()
    expect(otto.locator("#who strong")).to_have_text("safe stop")
    expect(otto.get_by_role("alertdialog")).to_be_visible()
