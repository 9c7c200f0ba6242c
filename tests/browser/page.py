"""Looks at an experiment's page in a real headless Chromium, as a reader would use it.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install playwright
    /tmp/venv/bin/python tests/browser/page.py out/nave/index.html --chromium /usr/bin/chromium --shots /tmp/shots

No part of `cargo test`. Exit code 1 and a message at the first thing that is not as it should be.
"""

import argparse
import pathlib
import sys

from playwright.sync_api import sync_playwright


def expect(condition, message):
    if not condition:
        sys.exit(f"error: {message}")


class Page:
    """The page at one width."""

    def __init__(self, browser, url, width):
        self.page = browser.new_page(viewport={"width": width, "height": 900})
        self.messages = []
        self.page.on("console", lambda m: self.messages.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda e: self.messages.append(str(e)))
        self.requests = []
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.goto(url)
        self.drawn()

    def drawn(self):
        """What the canvas shows: picture, mode, exposure and zoom, once drawing has settled."""
        self.page.wait_for_function("document.getElementById('view').dataset.drawn !== undefined")
        self.page.wait_for_timeout(250)
        return self.page.get_attribute("#view", "data-drawn")

    def pixels(self):
        """Mean of the canvas's red, green and blue."""
        return self.page.evaluate(
            """() => {
                const v = document.getElementById('view');
                const d = v.getContext('2d').getImageData(0, 0, v.width, v.height).data;
                const sums = [0, 0, 0];
                for (let i = 0; i < d.length; i += 4) for (let c = 0; c < 3; c++) sums[c] += d[i + c];
                return sums.map((s) => 4 * s / d.length);
            }"""
        )

    def press(self, key):
        self.page.keyboard.press(key)
        return self.drawn()

    def overflow(self):
        return self.page.evaluate("document.documentElement.scrollWidth - window.innerWidth")


def check(page):
    first = page.drawn()
    expect(sum(page.pixels()) > 3, "the picture is black")
    reference = page.press("0")
    expect(reference != first, "key 0 does not show the reference")
    expect("reference" in page.page.inner_text("#tag"), "the tag does not name the reference")
    expect(page.press("1") == first, "key 1 does not go back")
    expect(page.press("ArrowRight") != first, "the arrow does not flip")
    page.press("ArrowLeft")

    before = sum(page.pixels())
    page.press("e")
    expect(sum(page.pixels()) > before, "key e does not brighten")
    page.press("E")
    expect(abs(sum(page.pixels()) - before) < 1e-6, "key E does not undo it")
    page.page.evaluate(
        "() => { const s = document.getElementById('exposure'); s.value = -2; s.dispatchEvent(new Event('input')); }"
    )
    page.drawn()
    expect(sum(page.pixels()) < before, "the exposure slider does not darken")
    expect(page.page.inner_text("#exposure-value") == "-2", "the exposure is not told")
    page.page.evaluate(
        "() => { const s = document.getElementById('exposure'); s.value = 0; s.dispatchEvent(new Event('input')); }"
    )
    page.drawn()

    expect(" error " in page.press("m"), "key m does not show the error")
    expect(page.page.is_visible("#scale"), "the error has no scale")
    expect(" flip " in page.press("m"), "key m does not show FLIP")
    expect(" picture " in page.press("m"), "key m does not go back")

    page.press("s")
    expect(page.page.inner_text("#other-tag") != "", "key s does not split")
    box = page.page.locator("#view").bounding_box()
    middle = box["y"] + box["height"] / 2
    page.page.mouse.move(box["x"] + box["width"] / 2, middle)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + box["width"] / 4, middle, steps=4)
    page.page.mouse.up()
    page.drawn()
    split = float(page.page.input_value("#split"))
    expect(abs(split - 0.25) < 0.02, f"the split was drawn to a quarter and is at {split}")
    page.press("s")

    page.page.mouse.move(box["x"] + box["width"] / 3, middle)
    page.page.wait_for_timeout(100)
    expect("reference" in page.page.inner_text("#probe"), "the pixel under the pointer is not read")
    page.page.mouse.wheel(0, -100)
    expect(not page.drawn().endswith(" 1.00"), "the wheel does not zoom")
    for _ in range(5):
        page.press("+")
    expect(sum(page.pixels()) > 3, "zoomed in, nothing is to be seen")


def check_rest(page):
    page.press("f")
    crops = page.page.locator("#crops .strip").count()
    box = page.page.locator("#view").bounding_box()
    page.page.keyboard.down("Shift")
    page.page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.4 * box["height"])
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.6 * box["height"], steps=3)
    page.page.mouse.up()
    page.page.keyboard.up("Shift")
    page.drawn()
    expect(page.page.locator("#crops .strip").count() == crops + 1, "shift and drag does not add a part")
    rows = page.page.locator("#figures tbody tr").count()
    expect(rows > 0, "the table is empty")
    column = page.page.locator("#figures th").nth(8)
    column.click()
    values = [float(v) for v in page.page.eval_on_selector_all(
        "#figures tbody tr", "rows => rows.map((r) => r.children[8].dataset.value).filter((v) => v !== '')")]
    expect(values == sorted(values), f"a click on relmse does not sort: {values}")
    page.page.evaluate("() => document.querySelectorAll('img').forEach((i) => { i.loading = 'eager'; })")
    page.page.wait_for_timeout(500)
    broken = page.page.eval_on_selector_all("img", "all => all.filter((i) => !i.naturalWidth).map((i) => i.src)")
    expect(not broken, f"pictures that are not there: {broken}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("page", type=pathlib.Path)
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    parser.add_argument("--shots", type=pathlib.Path, help="folder for screenshots")
    arguments = parser.parse_args()
    url = arguments.page.resolve().as_uri()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=arguments.chromium, args=["--no-sandbox"])
        for width in (1280, 400):
            page = Page(browser, url, width)
            if arguments.shots:
                arguments.shots.mkdir(parents=True, exist_ok=True)
                page.page.screenshot(path=arguments.shots / f"top-{width}.png")
            check(page)
            if arguments.shots:
                page.page.screenshot(path=arguments.shots / f"zoomed-{width}.png")
            check_rest(page)
            expect(page.overflow() <= 0, f"at {width} pixels the page is {page.overflow()} pixels too wide")
            if arguments.shots:
                page.page.screenshot(path=arguments.shots / f"whole-{width}.png", full_page=True)
            outside = [r for r in page.requests if not r.startswith("file:")]
            expect(not outside, f"the page asks a network: {outside}")
            expect(not page.messages, f"the console says: {page.messages}")
        browser.close()
    print("the page works")


main()
