"""Every report in a real browser without a network: both themes, a wide and a narrow window, mouse, keyboard and paper.

Needs playwright (extra [browser]) and Chromium, its own or the system's; skipped with the reason where either is absent.
The slow tests run the commands and open what they wrote; JOINTSCOPE_SCREENSHOTS names a folder to leave pictures in.
"""

import os
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.experiments.charts.chart import Chart, Heat, Missing, Panel, Series, Span
from jointscope.experiments.page import FirstScreen, Section, Table, page

HEAVIEST = 3_000_000  # bytes
SLOWEST = 2.0  # s to the first picture, best of three: the first start of a browser and a busy machine don't count
PATIENCE = 180_000  # ms that a busy machine may take over one step
CONTRAST = 4.5  # WCAG 2 AA
SYSTEM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture(scope="module")
def browser():
    """Headless Chromium."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: extra [browser]")
    with playwright.sync_playwright() as driver:
        system = next((found for name in SYSTEM if (found := shutil.which(name))), None)
        path = driver.chromium.executable_path if Path(driver.chromium.executable_path).exists() else system
        if path is None:
            pytest.skip("no Chromium: playwright install chromium, or the system's chromium package")
        found = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def specimen(tmp_path_factory):
    """A page with one of everything."""
    x = np.linspace(0.1, 10.0, 500)
    waves = Panel(
        title="Waves", x_label="time [s]", y_label="[m]", link="t",
        series=(Series(name="recorded", x=x, y=np.sin(x), look="recorded"),
                Series(name="base", x=x, y=np.cos(x), look="base")),
    )  # fmt: skip
    logs = Panel(
        title="Powers", x_label="frequency [Hz]", y_label="[-]", x_log=True, y_log=True, spans=(Span(1.0, 3.0, "band"),),
        series=(Series(name="recorded", x=x, y=x**3, look="recorded"),
                Series(name="band", x=x, y=2 * x**3, low=x**3, look="band")),
    )  # fmt: skip
    marks = Panel(title="Marks", x_label="speed [rad/s]", y_label="[N m]",
                  series=(Series(name="forward", x=x[::20], y=x[::20], look="recorded", mark="o"),
                          Series(name="reverse", x=x[::20], y=-x[::20], look="base", mark="x")))  # fmt: skip
    heat = Panel(title="Map", x_label="speed [rad/s]", y_label="frequency [Hz]", series=(),
                 heat=Heat(np.arange(5.0), np.arange(4.0), np.arange(12.0).reshape(3, 4), "dB"))  # fmt: skip
    one = Chart(
        stem="one", label="One", shows="Two panels.", reading="so.", panels=(waves, waves, logs), columns=2
    )
    two = Chart(stem="two", label="Two", shows="Marks and map.", reading="so.", panels=(marks, heat))
    path = tmp_path_factory.mktemp("page") / "report.html"
    table = Table(columns=("what", "value"), rows=(("a", "1.5"), ("b", "-2")))
    first = FirstScreen(
        verdict="All is well.", next_step="Rest.", facts=(("fit", "99 %"),), markup=("<svg></svg>",)
    )
    sections = [
        Section(heading="Charts", charts=(one, Missing("Three", "a channel"))),
        Section(heading="Tabs", tabs=(one, two)),
        Section(heading="Numbers", table=table),
        Section(heading="Last", text=("The end.",)),
    ]
    path.write_text(page("Specimen", first, sections), encoding="utf-8")
    return path


class Opened:
    """A page in a browser, and everything that went wrong in it."""

    def __init__(self, browser, path, *, scheme, width):
        self.context = browser.new_context(
            viewport={"width": width, "height": 800}, color_scheme=scheme, offline=True
        )
        self.context.set_default_timeout(PATIENCE)
        self.page = self.context.new_page()
        self.wrong = []
        self.page.on(
            "console", lambda said: self.wrong.append(said.text) if said.type in ("error", "warning") else None
        )
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on(
            "request", lambda r: None if r.url.startswith(("file:", "data:")) else self.wrong.append(r.url)
        )
        self.page.goto(path.resolve().as_uri())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.context.close()


def labels(page, selector):
    return page.eval_on_selector_all(f"{selector} .axes text", "all => all.map(t => t.textContent)")


def click_through(opened):
    """Tabs by mouse and keys, zoom by button, key and drag, legend, table, theme."""
    page = opened.page
    for tabs in page.query_selector_all(".tabs"):
        buttons = tabs.query_selector_all("[role=tab]")
        for place, button in enumerate(buttons):
            button.click()
            shown = tabs.eval_on_selector_all(":scope > .tab", "all => all.map(t => !t.hidden)")
            assert shown == [k == place for k in range(len(buttons))]
        if len(buttons) > 1:
            page.keyboard.press("ArrowRight")  # from the last, which has the focus, around to the first
            assert buttons[0].get_attribute("aria-selected") == "true"
    for figure in [f for f in page.query_selector_all("figure.chart") if f.is_visible()]:
        panel = figure.query_selector("svg.panel")
        panel.scroll_into_view_if_needed()
        before = panel.inner_html()
        figure.query_selector("button[aria-label='zoom in']").click()
        assert panel.inner_html() != before
        figure.query_selector("button[aria-label='show the whole figure']").click()
        whole = panel.inner_html()
        panel.focus()
        page.keyboard.press("+")
        page.keyboard.press("ArrowRight")
        assert panel.inner_html() != whole
        page.keyboard.press("0")
        assert panel.inner_html() == whole
        corner = panel.bounding_box()
        page.mouse.move(corner["x"] + 100, corner["y"] + 100)
        assert figure.query_selector(".read").text_content()
        page.mouse.down()
        page.mouse.move(corner["x"] + 200, corner["y"] + 105, steps=4)
        page.mouse.up()
        assert panel.inner_html() != whole
        page.mouse.dblclick(corner["x"] + 150, corner["y"] + 100)
        assert panel.inner_html() == whole
        key = figure.query_selector(".legend button[data-s]")
        if key:
            key.click()
            assert key.get_attribute("aria-pressed") == "false"
            series = key.get_attribute("data-s")
            hidden = figure.eval_on_selector_all(
                f".panel path[data-s='{series}']", "all => all.map(p => p.style.display)"
            )
            assert hidden and set(hidden) == {"none"}
            key.click()
    copy = page.query_selector("button:text('copy table')")
    if copy:
        copy.click()
        assert copy.text_content() == "copied"
    paper = background(page)
    theme = page.query_selector("header button")
    for _ in range(2):
        theme.click()
    assert background(page) != paper or page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")


def background(page):
    return page.evaluate("getComputedStyle(document.body).backgroundColor")


def contrast(page):
    """Of text on its page, by WCAG's relative luminance."""
    both = page.evaluate(
        "[getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]"
    )

    def luminance(text):
        parts = np.array([int(v) / 255.0 for v in re.findall(r"\d+", text)[:3]])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    light, dark = sorted((luminance(b) for b in both), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def first_picture(browser, path):
    """Time to the first contentful paint, which holds the first screen's text and drawing [s]."""
    times = []
    for _ in range(3):
        with Opened(browser, path, scheme="light", width=1280) as opened:
            opened.page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length > 0")
            times.append(
                opened.page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
            )
    return min(times) / 1000.0


def check(browser, path):
    """Everything that is asked of a report."""
    assert path.stat().st_size <= HEAVIEST
    seen = set()
    for scheme in ("light", "dark"):
        for width in (1280, 400):
            with Opened(browser, path, scheme=scheme, width=width) as opened:
                page = opened.page
                assert len(page.title()) > 4 and page.is_visible("p.verdict") and page.is_visible("p.next")
                assert page.evaluate("document.documentElement.scrollWidth") <= width
                assert contrast(page) >= CONTRAST
                seen.add((scheme, background(page)))
                picture(page, path, f"{scheme}-{width}")
                click_through(opened)
                assert opened.wrong == []
    assert len({colour for _, colour in seen}) == 2
    with Opened(browser, path, scheme="dark", width=1280) as opened:
        opened.page.emulate_media(media="print")
        visible = opened.page.eval_on_selector_all(".tab", "all => all.map(t => getComputedStyle(t).display)")
        assert "none" not in visible  # on paper every alternative stands
        assert contrast(opened.page) >= 7.0 and "253" in background(opened.page)  # dark ink on light paper


def picture(page, path, name):
    folder = os.environ.get("JOINTSCOPE_SCREENSHOTS")
    if folder:
        page.screenshot(path=Path(folder) / f"{path.parent.name}-{name}.png", full_page=True)


def test_a_page_with_one_of_everything_works_in_a_browser(browser, specimen):
    check(browser, specimen)


def test_the_script_labels_an_axis_as_the_page_was_written(browser, specimen):
    drawn = specimen.read_text(encoding="utf-8")
    written = [
        re.findall(r"<text[^>]*>([^<]*)</text>", axes) for axes in re.findall(r'<g class="axes">(.*?)</g>', drawn)
    ]
    with Opened(browser, specimen, scheme="light", width=2400) as opened:
        page = opened.page
        page.add_style_tag(
            content="body{max-width:none!important} .panels{display:block!important} [hidden]{display:block}"
        )
        page.evaluate(
            "document.querySelectorAll('svg.panel').forEach(s => { s.style.width = s.getAttribute('width') + 'px'; })"
        )
        page.wait_for_timeout(200)
        shown = page.eval_on_selector_all(
            "svg.panel .axes", "all => all.map(a => [...a.querySelectorAll('text')].map(t => t.textContent))"
        )
    assert len(shown) == len(written)
    for script, static in zip(shown, written, strict=True):
        assert sorted(script) == sorted(static)


def test_the_page_is_whole_without_its_script(browser, specimen):
    context = browser.new_context(java_script_enabled=False)
    opened = context.new_page()
    opened.goto(specimen.resolve().as_uri())
    assert opened.locator("figure.chart >> visible=true").count() == 3  # tabs stand one under the other
    assert opened.locator("svg.panel path.s >> visible=true").count() > 5
    context.close()


class _Nesting(HTMLParser):
    VOID = frozenset({"meta", "img", "br", "path", "rect", "line"})

    def __init__(self):
        super().__init__()
        self.open, self.ids = [], []

    def handle_starttag(self, tag, attributes):
        self.ids += [value for key, value in attributes if key == "id"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.ids += [value for key, value in attributes if key == "id"]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_markup_is_nested_and_its_ids_are_single(specimen):
    reader = _Nesting()
    text = specimen.read_text(encoding="utf-8")
    reader.feed(
        re.sub(r'<figure class="chart" id="one">', '<figure class="chart">', text, count=1)
    )  # drawn twice on purpose
    assert reader.open == []
    assert len(reader.ids) == len(set(reader.ids))


def test_the_script_parses():
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node to parse the script with")
    import jointscope.experiments.page as module

    script = Path(module.__file__).with_name("page_script.js")
    assert subprocess.run([node, "--check", str(script)], capture_output=True, check=False).returncode == 0


# The reports of the commands


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench") / "bench"
    assert (
        main(["simulate", "single-joint", "--out", str(folder), "--seed", "1", "--hits", "4", "--repeats", "1"])
        == 0
    )
    return folder


STUDY = """format = "jointscope-sensitivity/1"
method = "sobol"
samples = 64
seed = 0
engine = "closed-form"
[parameters]
stiffness = { relative = 0.2 }
damping = { lower = 20.0, upper = 120.0 }
"""


def _written(command, bench, folder):
    out = folder / command
    if command == "sensitivity":
        study = folder / "study.toml"
        study.write_text(STUDY, encoding="utf-8")
        words = ["sensitivity", str(study), "--workers", "1"]
    elif command == "prove":
        draw = folder / "draw"
        assert main(["conceal", "--seed", "3", "--cases", "1", "--out", str(draw)]) == 0
        words = ["prove", str(draw), "--workers", "1"]
    elif command == "reproduce":
        words = ["reproduce", "single-joint", "--quick"]
    elif command == "predict":
        assert main(["identify", str(bench), "--out", str(folder / "id"), "--no-pictures"]) == 0
        words = ["predict", str(folder / "id" / "model.json"), str(bench)]
    else:
        words = [command, str(bench)]
    assert main([*words, "--out", str(out)]) == 0
    return out / "report.html"


@pytest.mark.slow
@pytest.mark.parametrize("command", ["identify", "predict", "diagnose", "sensitivity", "reproduce", "prove"])
def test_the_report_of_a_command_opens_light_and_quick(command, browser, bench, tmp_path):
    report = _written(command, bench, tmp_path)
    check(browser, report)
    seconds = first_picture(browser, report)
    print(f"{command}: {report.stat().st_size / 1e3:.0f} kB, first picture after {seconds:.2f} s")
    assert seconds <= SLOWEST
