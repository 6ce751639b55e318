"""The layout of the page by measured boxes: at each size, and when a state changes.

And whether it is accessible.
"""

import time

import pytest
from playwright.sync_api import expect

from fsw_hmi.limits import _WORDS
from fsw_test_support.browser import shot
from fsw_test_support.fake_hmi import LIMITS, PLACE, good_account, sample_alarms
from fsw_test_support.page_boxes import faults, places
from fsw_test_support.page_steps import in_control, press, ready, settled, until
from fsw_test_support.staged import STAGED, page_of

#: phone, tablet upright and across, panel computer, control room
PHONE, PANEL = (390, 844), (1280, 800)
#: low and wide, where the page scrolls
LOW = (1024, 600)
SIZES = [PHONE, (768, 1024), (1024, 768), PANEL, (1920, 1080)]


def by_default(*sizes):
    """All sizes, of which only these are tested without ``--full``."""
    return [pytest.param(size, marks=[] if size in sizes else pytest.mark.full) for size in SIZES]


@pytest.mark.parametrize("size", by_default(PHONE, PANEL), ids="{0[0]}x{0[1]}".format)
def test_everything_fits_the_screen_and_the_finger(fake, open_page, uplot, size):
    fake.local_stop = True
    fake.state["reason"] = (
        "nmpc answered late 3 times in a row, decentral took over; "
        "nmpc is inhibited until it is chosen"
    )
    fake.alarms = sample_alarms(time.time())
    page = open_page(fake.url, *size)
    expect(page.locator(".alarm")).to_have_count(8)
    until(page, "document.querySelectorAll('.plot canvas').length === 4")
    is_phone = size[0] < 700

    def measured():
        return faults(page, may_scroll=is_phone)

    assert settled(page, measured) == {}
    shot(page, "{}x{}".format(*size))
    press(page, "Log in")
    assert settled(page, measured) == {}  # with a form over the page, too
    page.locator("#safe-stop").click()
    expect(page.locator("#who strong")).to_have_text("safe stop")
    assert settled(page, measured) == {}
    fake.stop()
    expect(page.locator("body")).to_have_attribute("data-link", "lost")
    assert settled(page, measured) == {}


#: flags whose text leaves their tile, or lies over the gauge
FLAGS_OUTSIDE = """[...document.querySelectorAll(".flag:not(:empty)")].flatMap((flag) => {
    const text = document.createRange();
    text.selectNodeContents(flag);
    const [box, words, tile] = [flag, text, flag.closest(".tile")].map((part) => part.getBoundingClientRect());
    const gauge = flag.closest(".tile").querySelector(".scale").getBoundingClientRect();
    const [right, bottom] = [Math.max(box.right, words.right), Math.max(box.bottom, words.bottom)];
    return right > tile.right - 4 || box.left < tile.left || bottom > gauge.top ? [`${flag.textContent}: ${right - tile.right} px, ${bottom - gauge.top} px`] : [];
})"""


@pytest.mark.parametrize("kind", ["essential", "trip", "deviation"])
def test_flags_stay_in_their_tiles(fake, open_page, monkeypatch, kind):
    level, words = _WORDS[kind]
    flag = {"level": level, "kind": kind, "text": f"{words}, high"}
    monkeypatch.setattr("fsw_test_support.fake_hmi.worst", lambda _: dict.fromkeys(LIMITS, flag))
    fake.depth_offset_mm, fake.temperature_offset_c, fake.force_kn = 20.0, 300.0, 120.0
    page = open_page(fake.url, *PANEL)
    expect(page.locator("#value-depth_mm .plan")).to_contain_text("programme")
    expect(page.locator(".flag", has_text="off scale")).to_have_count(3)
    outside = {}
    for width, height in (*TIGHT, (1180, 820), (768, 1024)):
        page.set_viewport_size({"width": width, "height": height})
        if faults_here := page.evaluate(FLAGS_OUTSIDE):
            outside[width, height] = faults_here
    assert outside == {}


VISIBLE_ALARMS = """[...document.querySelectorAll(".alarm")].filter((one) => {
    const [box, list] = [one.getBoundingClientRect(), one.closest(".scroll").getBoundingClientRect()];
    return box.top >= list.top - 1 && box.bottom <= list.bottom + 1;
}).length"""


def test_six_alarms_are_in_view_on_a_panel_computer(fake, open_page):
    fake.alarms = sample_alarms(time.time())
    page = open_page(fake.url, 1280, 800)
    expect(page.locator(".alarm")).to_have_count(8)
    assert page.evaluate(VISIBLE_ALARMS) >= 6, "as many as a person must see at once"
    expect(page.locator(".alarm details[open]")).to_have_count(1)
    expect(page.locator(".alarm").first).to_contain_text("→ Check the sensor")
    page.locator("summary", has_text="decentral commands").click()
    expect(page.locator(".alarm details[open]")).to_contain_text(
        "decentral commands in place of nmpc"
    )
    gone = page.locator(".alarm.cleared .what")
    assert gone.bounding_box()["height"] < 25  # one line


@pytest.mark.parametrize("size", by_default(PANEL)[1:], ids="{0[0]}x{0[1]}".format)
def test_nothing_moves_when_a_state_changes(fake, open_page, size):
    page = ready(open_page(fake.url, *size))
    page.evaluate("document.fonts.ready")
    before = places(page)

    def moved():
        return {
            name: (box, before.get(name))
            for name, box in places(page).items()
            if box != before.get(name)
        }

    fake.state.update(
        reason="decentral commands because nmpc was late 3 times in a row; "
        "nmpc stays inhibited until mode auto readmits it, "
        "which nobody has chosen yet in this weld on the canister",
        actual_controller="decentral",
    )
    fake.alarms = sample_alarms(time.time())
    fake.depth_offset_mm = 1.2
    fake.push()
    expect(page.locator("#value-depth_mm .flag")).to_have_text("■ beyond trip, high")
    expect(page.locator("#who .detail")).to_contain_text("inhibited")
    assert settled(page, moved) == {}
    in_control(page)
    page.locator("summary", has_text="decentral commands").click()
    assert settled(page, moved) == {}
    page.locator("#safe-stop").click()
    expect(page.locator("#progress strong")).to_contain_text("Stopp")
    assert settled(page, moved) == {}
    fake.stop()
    expect(page.locator("body")).to_have_attribute("data-link", "lost")
    assert settled(page, moved) == {}


CUT_LINES = """(() => {
    const texts = (node) => [...node.childNodes].flatMap((one) => one.nodeType === Node.TEXT_NODE ? [one] : texts(one));
    const lines = (text) => {
        const range = document.createRange();
        range.selectNodeContents(text);
        return [...range.getClientRects()];
    };
    return [...document.querySelectorAll(":is(#controllers, #actions) .scroll")].flatMap((list) => {
        const box = list.getBoundingClientRect();
        const isCut = ({ top, bottom }) => [box.top, box.bottom].some((edge) => top < edge - 1 && bottom > edge + 1);
        const cut = texts(list).filter((text) => lines(text).some(isCut));
        return cut.map((text) => `${text.data}, list ${box.top} to ${box.bottom}`);
    });
})()"""


@pytest.mark.parametrize("size", by_default(PHONE, PANEL), ids="{0[0]}x{0[1]}".format)
def test_no_line_of_the_controllers_and_actions_is_half_in_view(fake, open_page, size):
    page = ready(open_page(fake.url, *size))
    lists = page.locator("#controllers .scroll")
    assert settled(page, lambda: page.evaluate(CUT_LINES)) == []
    health = fake.state["controllers"][0]
    done = {"who": "Anna (1)", "action": "take control", "outcome": "done", "message": ""}
    for count in range(1, 6):  # with one or two lines each
        fake.actions.append(
            done
            | {"server_s": time.time(), "message": count % 2 * "what nobody can say briefly " * 3}
        )
        texts = ["disk full" + i % 2 * " of what others record" for i in range(count)]
        fake.state["controllers"] = [
            health | {"name": f"controller{i}", "reason": text} for i, text in enumerate(texts)
        ]
        fake.push()
        expect(page.locator("#controllers li")).to_have_count(count)
        expect(page.locator("#actions li")).to_have_count(count)
        assert settled(page, lambda: page.evaluate(CUT_LINES)) == []
        assert (
            count < 5
            or size[0] < 700
            or lists.evaluate("(one) => one.scrollHeight > one.clientHeight")
        )
    lists.evaluate("(one) => one.scrollBy(0, 1e6)")
    assert settled(page, lambda: page.evaluate(CUT_LINES)) == []
    shot(page, "controllers_{}x{}".format(*size))


@pytest.mark.parametrize(
    "what",
    [
        "good",
        "form",
        "stop",
        *(
            pytest.param(view, marks=pytest.mark.full)
            for view in ("phone", "alarms", "bag", "notice", "end", "lost")
        ),
    ],
)
def test_accessible_by_axe(fake, bags, open_page, axe, what):
    # so high that nothing lies under the stop or out of a list's view, where axe cannot decide
    width = (PHONE if what == "phone" else PANEL)[0]
    page = open_page(
        bags.url if what == "bag" else fake.url, width, 4000 if what == "phone" else 1600
    )
    if what == "bag":
        expect(page.locator("#play")).to_be_visible()
    else:
        ready(page)
    if what == "phone":
        fake.account = good_account(PLACE)
        fake.push()
        expect(page.locator(".exceedances button")).to_be_visible()
    if what == "alarms":
        fake.alarms = sample_alarms(time.time())
        fake.push()
        expect(page.locator(".alarm")).to_have_count(8)
    if what == "form":
        in_control(page)
        press(page, "Mode")
    if what == "stop":
        fake.alarms, _ = page_of(STAGED["safe stop by an interlock"])
        fake.state.update(actual_mode="safe_stop", target_mode="safe_stop")
        fake.force_kn = 70.0
        fake.push()
        expect(page.locator("#verdict")).to_have_attribute("data-level", "high")
        expect(page.locator("#progress progress")).to_be_visible()
    if what == "notice":
        in_control(page)
        fake.ask_for_control("Bert")
        expect(page.locator(".notice")).to_be_visible()
    if what == "end":
        fake.progress["state"] = "done"
        fake.push()
        expect(page.locator(".end-screen")).to_be_visible()
    if what == "lost":
        fake.cut()
        expect(page.locator("#veil-text")).to_be_visible()
    page.emulate_media(reduced_motion="reduce")
    page.evaluate(axe)

    where = {"form": "dialog", "notice": "dialog", "end": "dialog", "lost": "header"}.get(
        what, "html"
    )

    def found():
        judged = page.evaluate(f"axe.run('{where}')")
        rules = [*judged["violations"], *judged["incomplete"]]
        return [(rule["id"], [node["html"][:120] for node in rule["nodes"]]) for rule in rules]

    assert settled(page, found) == []


OVERLAP = """(selectors) => {
    const box = (one) => one.getBoundingClientRect();
    const form = box(document.querySelector("dialog"));
    return selectors.filter((selector) => {
        const { left, top, right, bottom } = box(document.querySelector(selector));
        const under = left < form.right && form.left < right && top < form.bottom && form.top < bottom;
        return under || top < 0 || bottom > innerHeight;
    });
}"""


@pytest.mark.parametrize("size", [PHONE, LOW, PANEL], ids="{0[0]}x{0[1]}".format)
def test_form_of_set_points_leaves_what_it_changes_in_view(fake, open_page, uplot, size):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = open_page(fake.url, *size)
    in_control(page)
    press(page, "Set-points")
    page.locator("dialog").get_by_label("Temperature").fill("826.4")
    expect(page.locator(".summary")).to_contain_text("826.4")
    shown = [".trend.depth_mm", ".trend.temperature_c"]
    if size == PANEL:
        shown += ["#value-depth_mm", "#value-temperature_c", ".legend", ".alarms"]
    assert settled(page, lambda: page.evaluate(OVERLAP, shown)) == []
    shot(page, "set_points_{}x{}".format(*size))
    if size == LOW:
        tile = "#value-depth_mm"
        page.locator(tile).evaluate("(tile) => tile.scrollIntoView({ block: 'nearest' })")
        assert settled(page, lambda: page.evaluate(OVERLAP, [tile])) == []


def test_buttons_of_a_form_are_in_view_without_scrolling(fake, open_page):
    fake.progress["state"] = "held"  # only then set-points are by hand
    page = open_page(fake.url, *PANEL)
    in_control(page)
    hidden = set()
    for name in ("Set-points", "Mode"):
        press(page, name)
        for width, height in TIGHT:
            page.set_viewport_size({"width": width, "height": height})
            page.locator("dialog").evaluate("(form) => form.scrollTo(0, 0)")
            buttons = page.locator("dialog .buttons").evaluate(AT_THEIR_PLACES)
            hidden |= {(name, width, height, text) for text in buttons}
        press(page, "Cancel")
    assert hidden == set()


def test_page_is_not_wider_than_a_narrow_phone(fake, open_page, uplot):
    fake.account = good_account(PLACE)
    page = open_page(fake.url, 320, 568)
    too_wide = "document.documentElement.scrollWidth - innerWidth"
    page.locator(".exceedances button").click()
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()
    assert page.evaluate(too_wide) == 0
    press(page, "Back to now")
    assert page.evaluate(too_wide) == 0


def test_action_of_a_safe_stop_is_whole_in_the_headline(fake, open_page):
    fake.alarms, _ = page_of(STAGED["safe stop by an interlock"])
    for alarm in fake.alarms:
        alarm["why"] = "hold for 10 s, because of too many swaps in 30 s"
    fake.state.update(actual_mode="safe_stop", target_mode="safe_stop")
    page = open_page(fake.url, *PANEL)
    detail = page.locator("#verdict .detail")
    expect(detail).to_contain_text("too many swaps in 30 s → Remove the cause")
    assert detail.evaluate("(text) => text.scrollHeight <= text.clientHeight + 1")


#: script: texts of buttons that something else covers, or that are out of view
AT_THEIR_PLACES = """(buttons) => [...buttons.children].filter((button) => {
    const { left, top, width, height } = button.getBoundingClientRect();
    return !button.contains(document.elementFromPoint(left + width / 2, top + height - 2));
}).map((button) => button.textContent)"""
#: every size at which a form or notice once lay under the stop, and those where none did
TIGHT = [(390, 844), (360, 640), (844, 390), (640, 400), (1024, 600), (1280, 800), (320, 568)]
COVERED = """(() => {
    const cross = (p, q) => p.left < q.right && q.left < p.right && p.top < q.bottom && q.top < p.bottom;
    const box = (one) => one.getBoundingClientRect();
    const inView = ({ left, top, right, bottom }) => left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
    const stop = document.querySelector("#safe-stop");
    const over = [...document.querySelectorAll("dialog, #veil p")];
    const crossing = over.flatMap((one, i) => (one.closest("#veil") ? [stop] : [stop, ...over.slice(i + 1)]).filter((other) => cross(box(one), box(other))).map((other) => `${one.className || one.tagName} and ${other.id || other.className || other.tagName}`));
    const hidden = [...document.querySelectorAll("dialog :is(button, input, select)")].filter((one) => {
        if (!one.checkVisibility()) return false;
        one.scrollIntoView({ block: "nearest" });
        const { left, top, width, height } = box(one);
        return !one.contains(document.elementFromPoint(left + width / 2, top + height / 2)) || !inView(box(one));
    });
    return [...crossing, ...over.filter((one) => !inView(box(one))).map((one) => `${one.className} out of view`), ...hidden.map((one) => `cannot reach ${one.textContent || one.type}`)];
})()"""
#: buttons that open a form
FORMS = ["Set-points", "Controller", "Mode", "Resume weld", "Abort weld"]


@pytest.mark.requirement("S19")
def test_no_dialog_or_notice_lies_under_the_stop_at_any_size(fake, open_page):
    fake.alarms = sample_alarms(time.time())
    page = open_page(fake.url, *PANEL)
    faults_at = {}

    def check(what):
        for width, height in TIGHT:
            page.set_viewport_size({"width": width, "height": height})
            if covered := page.evaluate(COVERED):
                faults_at[f"{what} at {width}x{height}"] = covered
        page.set_viewport_size({"width": PANEL[0], "height": PANEL[1]})

    press(page, "Log in")
    check("Log in")
    press(page, "Cancel")
    page.locator("#safe-stop").click()
    check("Log in and safe stop")
    press(page, "Cancel")
    in_control(page)
    page.locator("summary", has_text="decentral commands").click()
    fake.ask_for_control("Bartholomäus.the.third.of.the.day")
    expect(page.locator(".notice")).to_be_visible()
    check("notice")
    fake.progress["state"] = "held"  # so that it can be resumed
    fake.push()
    openers = [page.get_by_role("button", name=name, exact=True) for name in FORMS]
    for opener in (*openers, page.locator(".acts button", has_text="Shelve")):
        if opener is not openers[0]:
            press(page, "Cancel")  # a form may lie over the alarms
        opener.click()
        check(f"{page.locator('dialog h2').text_content()} and notice")
    fake.progress["state"] = "aborted"
    fake.push()
    expect(page.locator(".end-screen")).to_be_visible()
    check("end of the weld, form and notice")
    press(page, "Keep control")
    expect(page.locator(".notice")).to_have_count(1)
    fake.cut()
    expect(page.locator("body")).to_have_attribute("data-link", "lost")
    check("cut off, end of the weld and form")
    assert faults_at == {}
