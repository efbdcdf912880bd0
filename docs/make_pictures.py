"""Make the pictures of this documentation: every screen, and a time lapse of a whole mission.

Start a mission, then this program with the address that the console prints::

    .venv/bin/dronerf demo --scene robot_dog
    .venv/bin/python docs/make_pictures.py ADDRESS

It waits until pictures are being taken, films the console until the field is finished, and leaves
in ``docs/pictures`` each screen in dark and light, at a desk's and at a phone's size.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image
from playwright.async_api import Browser, Page, async_playwright

_HERE = Path(__file__).parent
_SIZES = {"desk": (1440, 900), "phone": (390, 844)}
_SCHEMES = ("dark", "light")
# In flight, in training, afterwards: what a screen shows best when.
_IN_FLIGHT, _IN_TRAINING, _AFTER = ("fly", "plan"), ("reconstruct",), ("library", "setup")
_OVER = ("succeeded", "failed", "aborted", "interrupted")
_MOST_BYTES = 190_000
_LAPSE_SIZE = (960, 600)
_LAPSE_MOST_BYTES = 2_900_000
_LAPSE_FRAMES = 90
_LAPSE_FRAME_MS = 200
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
        await _follow(page, lapse, lambda state, _: state["images"] >= state["images_total"] / 3)
        await _shoot(browser, address, _IN_FLIGHT, out)
        await _follow(page, lapse, lambda _, training: training)
        await _show(page, "reconstruct")
        await _follow(page, lapse, lambda state, _: state["metrics"] is not None)
        await _shoot(browser, address, _IN_TRAINING, out)
        last = await _follow(page, lapse, lambda state, _: state["state"] in _OVER)
        await _show(page, f"library/{last['id']}")
        for _ in range(10):
            lapse.taken_s = 0.0
            await lapse.take(page)
            await asyncio.sleep(0.4)
        await _shoot(browser, address, _AFTER, out, capture_id=str(last["id"]))
        lapse.write(out / "mission.webp")
        await browser.close()


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


async def _follow(page: Page, lapse: Lapse, until) -> dict:
    """Film the page until the newest capture is ``until(state, training)``; return the capture."""
    while True:
        captures = await page.evaluate("fetch('/api/v1/captures').then(answer => answer.json())")
        if captures:
            state = captures[0]
            if state["state"] in _OVER or until(state, state["phase"] in ("train", "done")):
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
                where = f"library/{capture_id}" if screen == "library" else screen
                await _show(page, where)
                await page.wait_for_timeout(_SETTLE_MS.get(screen, 3000))
                file = out / f"{screen}-{scheme}-{size}.jpg"
                for quality in (85, 75, 60, 45):
                    await page.screenshot(path=file, type="jpeg", quality=quality)
                    if file.stat().st_size <= _MOST_BYTES:
                        break
            await page.close()


if __name__ == "__main__":
    main()
