"""Films a first-time user's way through `vispeg view`, by mouse alone, in a real browser, and prints the times.

First from recordings to a named effect and a fallen error, then a policy in two worlds. It needs the extras view and
learn, Playwright and Chromium.

    python scripts/film_view.py --out film            # film/*.webm, film/*.jpg, film/times.json
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import Locator, Page, sync_playwright

SIZE = {"width": 1280, "height": 720}
WAIT = 600_000  # ms
POINTER = """
addEventListener('DOMContentLoaded', () => {
  const dot = document.createElement('div');
  dot.style.cssText = 'position:fixed;z-index:99999;width:18px;height:18px;margin:-9px;border-radius:50%;' +
    'background:rgba(217,84,30,.55);border:2px solid #fff;pointer-events:none;left:50%;top:50%';
  document.body.append(dot);
  addEventListener('mousemove', e => { dot.style.left = e.clientX + 'px'; dot.style.top = e.clientY + 'px'; }, true);
});
"""


class Film:
    """A filmed session: each step is done with the mouse and noted with its time."""

    def __init__(self, page: Page, out: Path):
        self.page, self.out, self.begun, self.times = page, out, time.monotonic(), list[tuple[str, float]]()

    def note(self, what: str) -> None:
        """Note the time at which something was reached, and save a picture."""
        self.times.append((what, round(time.monotonic() - self.begun, 1)))
        print(f"{self.times[-1][1]:7.1f} s  {what}", flush=True)
        self.page.screenshot(path=self.out / f"{len(self.times):02d}.jpg", type="jpeg", quality=72)

    def press(self, what: Locator) -> None:
        """Move the mouse there and click, as a person does."""
        what.wait_for(timeout=WAIT)
        what.scroll_into_view_if_needed()
        box = what.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y, steps=12)
        self.page.mouse.click(x, y)

    def choose(self, label: str, option: str) -> None:
        """Choose an option of a drop-down list."""
        self.press(self.page.get_by_role("combobox", name=label, exact=True).locator("visible=true"))
        self.press(self.page.get_by_role("option", name=option, exact=True).locator("visible=true"))


def effects(film: Film, most: int) -> None:
    """Add the best candidate, at most `most` times, starting from the joint with the largest error."""
    page = film.page
    page.wait_for_selector("[data-ladder]", timeout=WAIT)
    film.note(f"the error of the model as given: {error(page)}")
    film.press(page.get_by_role("button", name=re.compile(r"^joint\d, .*times the noise")).first)
    for rung in range(2, 2 + most):
        best = page.get_by_role("button", name=re.compile(r" · \d+ %$")).first
        best.wait_for(timeout=WAIT)
        name = best.inner_text().split(" · ")[0]
        film.note(f"candidates are there; the best is {name}")
        film.press(best)
        page.wait_for_selector(f"[data-ladder] ol >> nth=0 >> li >> nth={rung - 1}", timeout=WAIT)
        film.note(f"{name} is added: {error(page)}")


def error(page: Page) -> str:
    """Return the page's words about the error, in one line."""
    return " ".join(page.locator("[data-ladder] [role=status]").inner_text().split())


def policy(film: Film, name: str, worlds: tuple[str, str]) -> None:
    """Play a policy in two worlds with the same seed."""
    page = film.page
    film.press(page.get_by_text("Policies", exact=True))
    film.choose("Policy", name)
    film.choose("World", worlds[0])
    film.choose("Beside it", worlds[1])
    film.press(page.get_by_role("button", name="Play the episode"))
    page.wait_for_selector("[data-episode] h2 >> nth=1", timeout=WAIT)
    page.get_by_role("button", name="Stop").locator("visible=true").wait_for(state="hidden", timeout=WAIT)
    film.press(page.get_by_role("button", name="Play", exact=True).locator("visible=true"))
    page.wait_for_timeout(5000)
    shown = " | ".join(" ".join(t.split()) for t in page.locator("[data-episode]").inner_text().split("\n\n"))
    film.note(f"{name} in two worlds: {shown}")


def with_ffmpeg(folder: Path) -> None:
    """Hand Playwright the project's ffmpeg where it was not installed with a browser of its own."""
    import playwright

    from vispeg.evaluation.films.video import ffmpeg

    listed = Path(playwright.__file__).parent / "driver" / "package" / "browsers.json"
    browsers = json.loads(listed.read_text(encoding="utf-8"))["browsers"]
    revision = next(b["revision"] for b in browsers if b["name"] == "ffmpeg")
    place, program = folder / f"ffmpeg-{revision}" / "ffmpeg-linux", ffmpeg()
    if program is not None:
        place.parent.mkdir(parents=True)
        place.symlink_to(program)
        (place.parent / "INSTALLATION_COMPLETE").touch()
        os.environ["PLAYWRIGHT_BROWSERS_PATH"] = str(folder.resolve())


def main() -> int:
    """Run the journeys; write film, stills and times."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("film"))
    parser.add_argument("--recordings", default="assets/recordings")
    parser.add_argument("--effects", type=int, default=2, help="how many are added, one press each")
    parser.add_argument("--policy", default="depth-S")
    parser.add_argument("--worlds", nargs=2, default=("nominal", "randomized"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True)
    words = [sys.executable, "-m", "vispeg", "view", asked.recordings, "--no-browser", "--out", str(asked.out / "view")]
    server = subprocess.Popen([*words, "--threads", "1"], stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    url = server.stdout.readline().split()[0]
    with_ffmpeg(asked.out / "playwright")
    path = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as driver:
        options = ["--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
        browser = driver.chromium.launch(executable_path=path, args=options)
        context = browser.new_context(viewport=SIZE, record_video_dir=asked.out, record_video_size=SIZE)
        context.add_init_script(POINTER)
        film = Film(context.new_page(), asked.out)
        film.page.goto(url)
        effects(film, asked.effects)
        reached = film.times[-1][1]
        policy(film, asked.policy, (asked.worlds[0], asked.worlds[1]))
        context.close()
        browser.close()
    server.send_signal(signal.SIGINT)
    server.wait()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    times = {"steps": film.times, "effects_s": reached, "all_s": film.times[-1][1]}
    times |= {"processor_s": round(used.ru_utime + used.ru_stime, 1), "load": os.getloadavg()[0]}
    (asked.out / "times.json").write_text(json.dumps(times, indent=1) + "\n", encoding="utf-8")
    print(f"effects named after {reached / 60:.1f} min, a policy in two worlds after {times['all_s'] / 60:.1f} min")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
