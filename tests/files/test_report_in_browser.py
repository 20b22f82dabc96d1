"""The pages in a browser: no error, no request, charts drawn, zoom by mouse and keys, hover, print, phone, themes."""

import json
import re
import shutil

import pytest

import relnav.cli

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
             "--disable-component-update", "--disable-sync"]  # fmt: skip
HOSTILE = "</script><script>window.broken=1</script><img src=x onerror='window.broken=2'>"
RUNS, STILL = ("beacon", "marker"), ("accuracy", "campaign")
LIMITS = ("--capture-m", "0.2", "--capture-distance-m", "4", "--capture-deg", "9")


def call(*arguments):
    assert relnav.cli.run([str(argument) for argument in (*arguments, "--quiet")]) == 0


@pytest.fixture(scope="module")
def pages(tmp_path_factory, vbar_log, campaign):
    """A page of each kind by its name, hostile words in each."""
    folder = tmp_path_factory.mktemp("browser")
    out = {name: folder / f"{name}.html" for name in (*RUNS, *STILL)}
    log = folder / "log.csv"
    log.write_text(f"# note = {HOSTILE}\n" + "".join(vbar_log.read_text().splitlines(keepends=True)[:201]))
    call("report", log, "--model", "three_beacon_psd", "--out", out["beacon"], *LIMITS)
    call("simulate", "three_marker_vision", "--out", log, "--duration", "30", "--rate", "2", "--seed", "5")
    log.write_text(f"# note = {HOSTILE}\n" + log.read_text())
    call("report", log, "--model", "three_marker_vision", "--out", out["marker"], *LIMITS)
    row = {"quantity": HOSTILE, "method": "fix", "range_m": 5.0, "published": 0.02, "measured": 0.01, "unit": "m",
           "statistic": "rms", "met": True, "expected": "met", "reason": HOSTILE + " so it is held" * 6}  # fmt: skip
    rows = [row, row | {"published": None}, row | {"met": False}]
    (folder / "a.json").write_text(json.dumps({"model": HOSTILE, "runs": 3, "seed": 7, "rows": rows, "ok": False}))
    call("report", folder / "a.json", "--out", out["accuracy"])
    copied = shutil.copytree(campaign, folder / "c")
    described = json.loads((copied / "campaign.json").read_text())
    (copied / "campaign.json").write_text(json.dumps(described | {"method": HOSTILE}))
    call("report", copied, "--out", out["campaign"])
    return out


@pytest.fixture(scope="module")
def chromium():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium: apt-get install chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium, pages):
    """open(name, width, scheme) -> page and the list of what went wrong."""
    contexts = []

    def open_page(name="beacon", width=1200, scheme="light", finish=True):
        context = chromium.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        page, wrong = context.new_page(), []
        page.on("console", lambda message: wrong.append(message.text))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if "file:" not in request.url else None)
        page.goto(pages[name].as_uri())
        if name in RUNS and finish:
            page.evaluate("relnavPage.finish()")
        return page, wrong

    yield open_page
    for context in contexts:
        context.close()


def waited(page, condition):
    """Until it holds, for half a minute: the page forbids the text that playwright's own waiting would run."""
    for _ in range(300):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(100)
    raise AssertionError(condition)


CONTRASTS = """() => {
  const numbers = text => (text.match(/[0-9.]+/g) || []).map(Number);
  const light = c => c.slice(0, 3).map(v => v / 255).map(v => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const ratio = (x, y) => (Math.max(x, y) + 0.05) / (Math.min(x, y) + 0.05);
  const behind = e => {
    for (; e; e = e.parentElement) {
      const c = numbers(getComputedStyle(e).backgroundColor);
      if (c.length === 3) return c;
    }
    return [255, 255, 255];
  };
  const found = {};
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const e = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || e.tagName === "SCRIPT" || !e.getClientRects().length) continue;
    const style = getComputedStyle(e), c = e instanceof SVGElement ? style.fill : style.color;
    found[e.tagName + "." + e.getAttribute("class") + " " + c] = ratio(light(numbers(c)), light(behind(e)));
  }
  return found;
}"""
"""Of each kind of text with what lies behind it, by the formula of WCAG 2.2, "relative luminance"."""


@pytest.mark.parametrize("name", [*RUNS, *STILL])
@pytest.mark.parametrize(("width", "scheme"), [(1200, "dark"), (390, "light")])
def test_a_page(opened, name, width, scheme):
    """Whole, without an error, within the screen, and readable."""
    page, wrong = opened(name, width, scheme)
    if name in RUNS:
        assert page.evaluate("relnavPage.built()") == page.evaluate("relnavPage.all") > 15
        drawn = "[...document.querySelectorAll('canvas')].filter(c => c.getContext('2d')" \
            ".getImageData(0, 0, c.width, c.height).data.some(v => v)).length"  # fmt: skip
        assert page.evaluate(drawn) == page.evaluate("document.querySelectorAll('canvas').length")
    else:
        assert page.locator("svg rect, .bar").count() > 0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == {
        "light": "rgb(255, 255, 255)", "dark": "rgb(18, 23, 28)"}[scheme]  # fmt: skip
    contrasts = page.evaluate(CONTRASTS)
    assert len(contrasts) > 8
    assert {what: ratio for what, ratio in contrasts.items() if ratio < 4.5} == {}
    if width == 390:
        small = "[...document.querySelectorAll('button, summary')].filter(e => e.getBoundingClientRect().height < 44)"
        assert page.evaluate(f"{small}.map(e => e.textContent)") == []
    assert page.evaluate("window.broken") is None
    assert wrong == []


def test_charts_out_of_sight_are_drawn_too(opened):
    """A picture of the whole page, taken by a program that does not scroll, has no empty chart."""
    page, wrong = opened(finish=False)
    waited(page, "relnavPage.built() === relnavPage.all")
    assert page.evaluate("document.documentElement.scrollHeight") > 3000
    assert wrong == []


def test_mouse_zooms_every_chart_and_shows_values(opened):
    page, wrong = opened()
    whole = page.evaluate("relnavPage.shown()")
    box = page.locator(".u-over").first
    box.scroll_into_view_if_needed()
    at = box.bounding_box()
    y = at["y"] + at["height"] / 2
    page.mouse.move(at["x"] + 0.25 * at["width"], y)
    page.mouse.down()
    page.mouse.move(at["x"] + 0.5 * at["width"], y, steps=4)
    page.mouse.up()
    low, high = page.evaluate("relnavPage.shown()")
    assert low == pytest.approx(0.25 * whole[1], abs=0.02 * whole[1])
    assert high == pytest.approx(0.5 * whole[1], abs=0.02 * whole[1])
    page.mouse.move(at["x"] + 0.6 * at["width"], y)
    assert page.locator(".u-legend .u-value").nth(0).text_content().endswith(" s")
    page.mouse.dblclick(at["x"] + 0.6 * at["width"], y)
    assert page.evaluate("relnavPage.shown()") == whole
    assert wrong == []


def test_a_part_of_a_run_fills_its_charts(opened):
    """The first chart is the range: of a tenth of the approach a tenth of its numbers."""
    page, wrong = opened()
    page.locator(".u-over").first.scroll_into_view_if_needed()
    low, high = page.evaluate("relnavPage.upright(0)")
    begin, end = page.evaluate("relnavPage.shown()")
    page.evaluate(f"relnavPage.show({end - 0.1 * (end - begin)}, {end})")
    waited(page, f"relnavPage.upright(0)[1] - relnavPage.upright(0)[0] < {0.4 * (high - low)}")
    page.evaluate(f"relnavPage.show({begin}, {end})")
    waited(page, f"relnavPage.upright(0)[1] === {high}")
    assert wrong == []


@pytest.mark.parametrize("name", RUNS)
def test_all_by_the_keyboard(opened, name):
    """The focus comes to the approach and to every chart, one sees it, and there keys zoom and show values."""
    page, wrong = opened(name)
    whole = page.evaluate("relnavPage.shown()")
    reached = []
    while reached.count("plot") < 2:
        assert len(reached) < 20
        page.keyboard.press("Tab")
        here = page.evaluate("[document.activeElement.id || document.activeElement.className,"
                             "getComputedStyle(document.activeElement).outlineStyle]")  # fmt: skip
        if here[0] == "space":
            page.keyboard.press("+")
            assert "from the port in sight" in page.locator("#drawn").text_content()
            nearer = page.locator("#drawn").text_content()
            page.keyboard.press("0")
            assert page.locator("#drawn").text_content() != nearer
            assert page.evaluate("relnavPage.shown()") == whole  # these keys are the drawing's
        if here[0] == "plot" and "plot" not in reached:
            for key in ("ArrowRight", "ArrowRight"):
                page.keyboard.press(key)
            value = page.locator(".plot").first.locator(".u-legend .u-value")
            assert value.nth(0).text_content().endswith(" s")
            assert float(value.last.text_content()) != 0.0
            page.keyboard.press("+")
            half = page.evaluate("relnavPage.shown()")
            assert half[1] - half[0] == pytest.approx(0.5 * (whole[1] - whole[0]))
            page.keyboard.press("0")
            assert page.evaluate("relnavPage.shown()") == whole
        if here[0] in ("space", "plot", "in", "near"):
            assert here[1] == "solid", here
        reached.append(here[0])
    assert page.locator(".plot[tabindex='0'][aria-label]").count() == page.evaluate("relnavPage.all")
    assert {"in", "all", "near", "space"} <= set(reached)
    assert wrong == []


def test_a_short_window_says_its_times_exactly(opened):
    page, _ = opened()
    page.evaluate("relnavPage.show(5.0, 5.16)")
    assert page.locator("#span").inner_text() == "5 s to 5.16 s"
    page.evaluate("relnavPage.show(-1e9, 1e9)")
    assert page.locator("#span").inner_text() == "0 s to 19.9 s"


@pytest.mark.parametrize("name", ["marker", *STILL])
def test_it_prints(opened, name):
    """On so many pages, no chart across two of them, whatever the theme in the colours of paper."""
    page, wrong = opened(name, scheme="dark")
    printed = page.pdf(format="A4")
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 14
    page.emulate_media(media="print", color_scheme="dark")
    cut = "[...document.querySelectorAll('.chart, .tile, tr, #space')].map(e => getComputedStyle(e).breakInside)"
    assert set(page.evaluate(cut)) == {"avoid"}
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert min(page.evaluate(CONTRASTS).values()) >= 4.5
    assert page.locator("button:visible").count() == 0
    assert wrong == []


def test_charts_are_printed_as_paper_has_room_for_them(opened):
    """Drawn anew for paper: the same pixels from the dark page as from the light one; then it is as it was."""
    drawn = []
    for scheme in ("light", "dark"):
        page, wrong = opened(scheme=scheme)
        before = page.evaluate("document.getElementById('space').toDataURL()")
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        drawn.append(page.evaluate("[...document.querySelectorAll('canvas')].slice(0, 4).map(c => c.toDataURL())"))
        assert page.evaluate("Math.max(...[...document.querySelectorAll('.chart')].map(e => e.scrollWidth))") <= 700
        page.evaluate("dispatchEvent(new Event('afterprint'))")
        assert page.evaluate("document.getElementById('space').toDataURL()") == before
        assert wrong == []
    assert drawn[0] == drawn[1]
