"""Make the pictures of this documentation: every screen, and films of a mission and its replay.

Start a mission, then this program with the address that the console prints::

    .venv/bin/dronerf demo --scene robot_dog
    .venv/bin/python docs/make_pictures.py ADDRESS

It waits until pictures are being taken, films the console until the field is finished, and leaves
in ``docs/pictures`` each screen in dark and light, at a desk's and at a phone's size, with a page
that shows them all. Where the newest capture is over, what it left behind is all there is to show.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from PIL import Image
from playwright.async_api import Browser, Page, async_playwright

_HERE = Path(__file__).parent
_SIZES = {"desk": (1440, 900), "phone": (390, 844)}
_SCHEMES = ("dark", "light")
# In flight, in training, afterwards: what a screen shows best when.
_IN_FLIGHT, _IN_TRAINING = ("fly", "plan"), ("reconstruct",)
_AFTER = ("library", "replay", "setup")
_OVER = ("succeeded", "failed", "aborted", "interrupted")
_MOST_BYTES = 190_000
_LAPSE_SIZE = (960, 600)
_LAPSE_MOST_BYTES = 2_900_000
_LAPSE_FRAMES = 90
_LAPSE_FRAME_MS = 200
_ADDRESS = {"library": "library/{}", "replay": "library/{}%2Freplay"}
# The 3D scene takes its time without a graphics card.
_SETTLE_MS = {"plan": 6000}


@dataclass
class Lapse:
    """Pictures of one page, thinned out when there are too many."""

    every_s: float = 1.0
    shots: list[Image.Image] = field(default_factory=list[Image.Image])
    taken_s: float = 0.0

    async def take(self, page: Page) -> None:
        """Take a picture when it is time."""
        if time.monotonic() - self.taken_s < self.every_s:
            return
        self.taken_s = time.monotonic()
        png = await page.screenshot()
        self.shots.append(Image.open(io.BytesIO(png)).convert("RGB").resize(_LAPSE_SIZE))
        if len(self.shots) > 2 * _LAPSE_FRAMES:
            self.shots, self.every_s = self.shots[::2], 2.0 * self.every_s

    def write(self, file: Path) -> None:
        """Write an animated WebP that is small enough."""
        step = max(1, len(self.shots) // _LAPSE_FRAMES)
        first, *rest = self.shots[::step]
        for quality in (70, 55, 40, 25):
            durations = [*[_LAPSE_FRAME_MS] * len(rest), 3000]
            first.save(
                file,
                save_all=True,
                append_images=rest,
                duration=durations,
                loop=0,
                quality=quality,
                method=4,
            )
            if file.stat().st_size <= _LAPSE_MOST_BYTES:
                return


def main() -> None:
    """Follow a mission and take its pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address", help="of the console, with its token")
    parser.add_argument("--out", type=Path, default=_HERE / "pictures")
    wanted = parser.parse_args()
    wanted.out.mkdir(parents=True, exist_ok=True)
    asyncio.run(take_all(wanted.address, wanted.out))


async def take_all(address: str, out: Path) -> None:
    """Take all pictures of the mission at hand."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=shutil.which("chromium"), chromium_sandbox=False
        )
        page = await _page(browser, address, "dark", "desk")
        lapse = Lapse()
        state = await _follow(page, lapse, lambda _: True)
        if state["state"] not in _OVER:
            await _follow(page, lapse, lambda now: now["images"] >= now["images_total"] / 3)
            await _shoot(browser, address, _IN_FLIGHT, out)
            await _follow(page, lapse, lambda now: now["phase"] in ("train", "done"))
            await _show(page, "reconstruct")
            await _follow(page, lapse, lambda now: now["metrics"] is not None)
            await _shoot(browser, address, _IN_TRAINING, out)
            state = await _follow(page, lapse, lambda _: False)
            lapse.write(out / "mission.webp")
        await _shoot(browser, address, _AFTER, out, capture_id=str(state["id"]))
        await _film_replay(page, str(state["id"]), out / "replay.webp")
        await browser.close()
    _write_page(out)


async def _film_replay(page: Page, capture_id: str, file: Path) -> None:
    await _show(page, f"library/{quote(f'{capture_id}/replay', safe='')}")
    await page.get_by_test_id("replay-run").wait_for()
    await page.get_by_role("combobox", name="Speed").select_option("4")
    await page.get_by_test_id("replay-run").click()
    place, lapse = page.get_by_test_id("replay-place"), Lapse(every_s=0.5)
    # The slider rounds to tenths.
    last_s = float(await place.get_attribute("max") or 0) - 0.2
    while float(await place.input_value()) < last_s:
        await lapse.take(page)
        await asyncio.sleep(0.05)
    lapse.write(file)


def _write_page(out: Path) -> None:
    """Write a page that shows all pictures there are."""
    lines = [
        "# The console in pictures",
        "",
        "Made by [make_pictures.py](../make_pictures.py).",
        "",
    ]
    for film in sorted(out.glob("*.webp")):
        lines += [f"## Film: {film.stem}", "", f"![{film.stem}]({film.name})", ""]
    for screen in (*_IN_FLIGHT, *_IN_TRAINING, *_AFTER):
        names = [f"{screen}-{scheme}-{size}" for size in _SIZES for scheme in _SCHEMES]
        there = [name for name in names if (out / f"{name}.jpg").exists()]
        if there:
            lines += [f"## {screen.title()}", "", *(f"![{name}]({name}.jpg)" for name in there), ""]
    (out / "README.md").write_text("\n".join(lines))


async def _page(browser: Browser, address: str, scheme: str, size: str) -> Page:
    width, height = _SIZES[size]
    page = await browser.new_page(
        viewport={"width": width, "height": height},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    await page.goto(address)
    await page.get_by_test_id("connection").wait_for()
    return page


async def _show(page: Page, where: str) -> None:
    await page.evaluate("where => { location.hash = '/' + where; }", where)


async def _follow(
    page: Page, lapse: Lapse, until: Callable[[dict[str, Any]], bool]
) -> dict[str, Any]:
    """Film the page until the newest capture is over or ``until`` says so; return the capture."""
    while True:
        captures = await page.evaluate("fetch('/api/v1/captures').then(answer => answer.json())")
        if captures:
            state = captures[0]
            if state["state"] in _OVER or until(state):
                return state
        await lapse.take(page)
        await asyncio.sleep(0.3)


async def _shoot(
    browser: Browser, address: str, screens: tuple[str, ...], out: Path, capture_id: str = ""
) -> None:
    """Take these screens in all sizes and colours."""
    for size in _SIZES:
        for scheme in _SCHEMES:
            page = await _page(browser, address, scheme, size)
            for screen in screens:
                await _show(page, _ADDRESS.get(screen, screen).format(quote(capture_id)))
                await page.wait_for_timeout(_SETTLE_MS.get(screen, 3000))
                if screen == "replay":
                    # In the middle of the flight, films on their pictures.
                    place = page.get_by_test_id("replay-place")
                    await place.fill(str(round(float(await place.get_attribute("max") or 0) / 2)))
                    await page.wait_for_timeout(3000)
                    await page.locator(".replay-views").scroll_into_view_if_needed()
                file = out / f"{screen}-{scheme}-{size}.jpg"
                for quality in (85, 75, 60, 45):
                    await page.screenshot(path=file, type="jpeg", quality=quality)
                    if file.stat().st_size <= _MOST_BYTES:
                        break
            await page.close()


if __name__ == "__main__":
    main()
