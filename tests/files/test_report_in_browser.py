"""The page in a browser: no error, no request, charts drawn, zoom by mouse and keys, hover, print, both themes."""

import shutil

import pytest

import relnav.cli

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
             "--disable-component-update", "--disable-sync"]  # fmt: skip
HOSTILE = "</script><script>window.broken=1</script><img src=x onerror='window.broken=2'>"


@pytest.fixture(scope="module")
def page_path(tmp_path_factory, vbar_log):
    folder = tmp_path_factory.mktemp("browser")
    log = folder / "log.csv"
    log.write_text(f"# note = {HOSTILE}\n" + "".join(vbar_log.read_text().splitlines(keepends=True)[:201]))
    out = folder / "run.html"
    assert relnav.cli.run(["report", str(log), "--model", "three_beacon_psd", "--out", str(out), "--quiet"]) == 0
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
def opened(chromium, page_path):
    """open(width, scheme) -> page and the list of what went wrong."""
    contexts = []

    def open_page(width=1200, scheme="light"):
        context = chromium.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        page, wrong = context.new_page(), []
        page.on("console", lambda message: wrong.append(message.text))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if "file:" not in request.url else None)
        page.goto(page_path.as_uri())
        page.evaluate("relnavPage.finish()")
        return page, wrong

    yield open_page
    for context in contexts:
        context.close()


@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (1200, "dark"), (390, "light")])
def test_all_charts_without_an_error(opened, width, scheme):
    page, wrong = opened(width, scheme)
    assert page.evaluate("relnavPage.built()") == page.evaluate("relnavPage.all") > 15
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    drawn = "[...document.querySelectorAll('canvas')].filter(c => c.getContext('2d')" \
        ".getImageData(0, 0, c.width, c.height).data.some(v => v)).length"  # fmt: skip
    assert page.evaluate(drawn) == page.evaluate("document.querySelectorAll('canvas').length")
    assert page.evaluate("window.broken") is None
    assert wrong == []


def test_keys_and_mouse_zoom_every_chart(opened):
    page, wrong = opened()
    whole = page.evaluate("relnavPage.shown()")
    page.keyboard.press("+")
    half = page.evaluate("relnavPage.shown()")
    assert half[1] - half[0] == pytest.approx(0.5 * (whole[1] - whole[0]))
    page.keyboard.press("0")
    assert page.evaluate("relnavPage.shown()") == whole
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


def test_it_prints(opened):
    page, wrong = opened()
    assert page.pdf(format="A4").startswith(b"%PDF")
    assert wrong == []
