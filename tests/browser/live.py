"""Looks at the page of `manylight view` in a real headless Chromium, as a user would.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install playwright
    /tmp/venv/bin/python tests/browser/live.py configs/nave.ron --binary target/release/manylight \
        --chromium /usr/bin/chromium --shots /tmp/shots

What stands behind `--` goes to `manylight view`. No part of `cargo test`. Exit code 1 and a message at the first thing
that is not as it should be.
"""

import argparse
import pathlib
import subprocess
import sys
import time

from playwright.sync_api import sync_playwright


def expect(condition, message):
    if not condition:
        sys.exit(f"error: {message}")


class Live:
    """The page, and what is drawn on it: number, wish, samples, width, mode and exposure."""

    def __init__(self, browser, url, width):
        self.page = browser.new_page(viewport={"width": width, "height": 900})
        self.messages = []
        self.page.on("console", lambda m: self.messages.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda e: self.messages.append(str(e)))
        self.requests = []
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.goto(url)

    def drawn(self):
        number, wish, spp, width, mode, stops = self.page.get_attribute("#view", "data-drawn").split()
        return {"number": int(number), "wish": int(wish), "spp": int(spp), "width": int(width), "mode": mode, "stops": float(stops)}

    def wait(self, condition, what, seconds=120):
        """Until `condition` holds of what is drawn."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.page.get_attribute("#view", "data-drawn") and condition(self.drawn()):
                return self.drawn()
            self.page.wait_for_timeout(20)
        sys.exit(f"error: no {what} in {seconds} s")

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

    def drag(self, dx, dy, modifier=None):
        """From the middle, by shares of the picture's height."""
        box = self.page.locator("#view").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        if modifier:
            self.page.keyboard.down(modifier)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + dx * box["height"], y + dy * box["height"], steps=6)
        self.page.mouse.up()
        if modifier:
            self.page.keyboard.up(modifier)

    def camera(self):
        return self.page.text_content("#camera")

    def overflow(self):
        return self.page.evaluate("document.documentElement.scrollWidth - window.innerWidth")


def check(live, size, with_reference, shot):
    begun = time.monotonic()
    first = live.wait(lambda d: d["spp"] >= 1, "picture")
    print(f"first picture after {time.monotonic() - begun:.2f} s, {first['width']} pixels wide")
    shot("first")
    refined = live.wait(lambda d: d["width"] == size and d["spp"] >= 4, "refined picture")
    expect(refined["number"] > first["number"] or refined["spp"] > first["spp"], "the picture does not refine")
    expect(sum(live.pixels()) > 3, "the picture is black")
    expect("samples a pixel" in live.page.inner_text("#status"), live.page.inner_text("#status"))
    shot("refined")

    before = sum(live.pixels())
    live.page.keyboard.press("e")
    live.page.wait_for_timeout(100)
    expect(sum(live.pixels()) > before, "key e does not brighten")
    live.page.keyboard.press("E")
    if with_reference:
        expect("relmse" in live.page.inner_text("#status"), "no error against the reference is told")
        for mode in ("error", "reference"):
            live.page.select_option("#mode", mode)
            expect(live.drawn()["mode"] == mode, f"{mode} is not shown")
            shot(mode)
        live.page.select_option("#mode", "picture")

    home = live.camera()
    for name, act in [
        ("orbit", lambda: live.drag(0.15, 0.03)),
        ("pan", lambda: live.drag(0.1, 0, "Shift")),
        ("look", lambda: live.drag(0.1, 0, "Alt")),
        ("dolly", lambda: (live.page.mouse.wheel(0, -200), live.page.wait_for_timeout(50))),
        ("keys", lambda: live.page.keyboard.press("ArrowLeft")),
    ]:
        camera, wish = live.camera(), live.drawn()["wish"]
        begun = time.monotonic()
        act()
        expect(live.camera() != camera, f"{name} does not move the camera")
        live.wait(lambda d: d["wish"] > wish, f"picture after {name}")
        print(f"{name}: seen after {time.monotonic() - begun:.2f} s")
    last = live.drawn()["wish"]
    live.wait(lambda d: d["width"] == size and d["wish"] >= last, "moved picture")
    expect(sum(live.pixels()) > 1, "the moved picture is black")
    shot("moved")
    live.page.click("#home")
    expect(live.camera() == home, "home is another place")

    wish = live.drawn()["wish"]
    live.page.select_option("#method", label="uniform")
    live.wait(lambda d: d["width"] == size and d["wish"] > wish, "picture by another method")
    shot("uniform")
    live.page.select_option("#method", index=0)
    live.page.keyboard.press("h")
    return live


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("run")
    parser.add_argument("--binary", default="target/release/manylight")
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    parser.add_argument("--shots", type=pathlib.Path, help="folder for screenshots")
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--reference")
    own, _, rest = " ".join(sys.argv[1:]).partition(" -- ")
    arguments = parser.parse_args(own.split())
    command = [arguments.binary, "view", arguments.run, "--port", "0", "--size", arguments.size, *rest.split()]
    if arguments.reference:
        command += ["--reference", arguments.reference]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        url = program.stdout.readline().strip()
        expect(url.startswith("http://127.0.0.1:"), f"no address: {url!r}")
        size = int(arguments.size.split("x")[0])
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=arguments.chromium, args=["--no-sandbox"])
            for width in (1280, 400):
                live = Live(browser, url, width)

                def shot(name):
                    if arguments.shots:
                        arguments.shots.mkdir(parents=True, exist_ok=True)
                        live.page.screenshot(path=arguments.shots / f"{name}-{width}.png")

                check(live, size, bool(arguments.reference), shot)
                expect(live.overflow() <= 0, f"at {width} pixels the page is {live.overflow()} pixels too wide")
                outside = [r for r in live.requests if not r.startswith(url)]
                expect(not outside, f"the page asks a network: {outside}")
                expect(not live.messages, f"the console says: {live.messages}")
                live.page.close()
            live = Live(browser, url, 1280)
            live.wait(lambda d: d["spp"] >= 1, "picture")
            program.kill()
            live.page.wait_for_timeout(2500)
            expect("does not answer" in live.page.inner_text("#status"), "the program's end is not told")
            browser.close()
    finally:
        program.kill()
        program.wait()
    print("the page works")


main()
