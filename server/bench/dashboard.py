"""``dronerf bench dashboard``: the Fly screen in a real browser, with four tiles playing.

Measured twice: with the drones' own video, which the page decodes, and with annotated JPEG.

Four drones hover and send the same video, 30 pictures a second; each picture bears its number in
black and white blocks. The page runs in Chromium without a GPU, driven by Playwright; a probe reads
the blocks back from the tiles' canvases at every animation frame. What it tells:

* ``shown_per_s``: pictures that each tile showed; ``coded_so``: the share of all that came in the
  form that is measured: where the drones' own video cannot be decoded, JPEG comes;
* ``glass_to_glass_ms``: from before a picture was coded to when its number was read on the page;
  ``misread``: numbers that cannot be right;
* ``first_paint_ms`` of a load from loopback; ``frame_ms``: from the start of an animation frame to
  the first moment that the main thread was free again; ``interval_ms`` between animation frames;
  ``scene_...``: the same on the Plan screen afterwards, with the 3D scene drawn by software;
* ``heap_mb``: the page's script heap after a collection, at the start and at the end.

The machine is busy with drones, coder, console and browser at once.
"""

from __future__ import annotations

import asyncio
import math
import shutil
import tempfile
import time
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.async_api import ViewportSize, async_playwright

from server.bench.hovering_fleet import Painter, blob_on_floor, hovering_fleet, percentiles
from server.bench.options import Figures, Options, each_scene
from server.geometry.cameras import TELLO_INTRINSICS

# Nothing is rendered: the scene's name only stands for the parts that there are.
SCENES = QUICK_SCENES = ("robot_dog",)
_CODINGS = ("h264", "jpeg")

_FPS = 30.0
_SECONDS, _QUICK_SECONDS = 1200.0, 60.0
_SCENE_SECONDS = 120.0
_WARM_UP_S = 10.0
_SCREEN_PX = 1440, 900
# Chromium without a GPU, that asks nobody anything.
CHROMIUM_ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
# The number: so many blocks of so many pixels, the least significant first, along the lower edge.
_BITS, _BLOCK_PX = 16, 48
# Blocks that were coded badly give the number of some other picture.
_MISREAD_MS = 10_000.0
_PROBE = """
({bits, blockPx, widthPx, heightPx}) => {
  const seen = {}, frames = [], intervals = [];
  const numberOn = (canvas) => {
    const scale = canvas.width / widthPx, y = Math.round((heightPx - blockPx / 2) * scale);
    const row = canvas.getContext("2d").getImageData(0, y, canvas.width, 1).data;
    let number = 0;
    for (let bit = 0; bit < bits; bit++) {
      const x = Math.round((bit + 0.5) * blockPx * scale);
      if (row[4 * x + 1] > 127) number += 2 ** bit;
    }
    return number;
  };
  const channel = new MessageChannel();
  let begunMs = 0, lastMs = 0;
  channel.port1.onmessage = () => { frames.push(performance.now() - begunMs); };
  const look = () => {
    begunMs = performance.now();
    if (lastMs) intervals.push(begunMs - lastMs);
    lastMs = begunMs;
    for (const tile of document.querySelectorAll("[data-testid^=tile-drone]")) {
      const canvas = tile.querySelector("canvas");
      if (canvas === null || tile.dataset.sequence === undefined) continue;
      const shown = (seen[tile.dataset.testid] ??= []), number = numberOn(canvas);
      if (shown.at(-1)?.[0] !== number) {
        shown.push([number, performance.timeOrigin + begunMs, tile.dataset.coding]);
      }
    }
    channel.port2.postMessage(null);
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
  window.probe = () => {
    const found = {seen: structuredClone(seen), frames: [...frames], intervals: [...intervals]};
    for (const name of Object.keys(seen)) seen[name].splice(0, seen[name].length - 1);
    frames.length = intervals.length = 0;
    return found;
  };
}
"""


class NumberedPictures:
    """Draws the number of each picture into it and remembers when it was drawn.

    Attributes:
        drawn_s: By number, when it was drawn, seconds since 1970.
    """

    def __init__(self, paint: Painter) -> None:
        self.drawn_s: dict[int, float] = {}
        self._paint = paint

    def __call__(self, count: int) -> NDArray[np.uint8]:
        """Return the picture of number ``count``."""
        number = count % 2**_BITS
        self.drawn_s[number] = time.time()
        picture = self._paint(count)
        height = picture.shape[0]
        for bit in range(_BITS):
            level = 255 if number >> bit & 1 else 0
            left = bit * _BLOCK_PX
            corner = (left + _BLOCK_PX - 1, height - 1)
            cv2.rectangle(picture, (left, height - _BLOCK_PX), corner, (level,) * 3, -1)
        return picture


def run(options: Options) -> Figures:
    """Measure both ways."""
    seconds = _QUICK_SECONDS if options.quick else _SECONDS
    both = replace(options, scenes=_CODINGS)
    figures = each_scene("dashboard", both, lambda coding: measure(coding, seconds))
    return Figures(scenes={}, overall=figures)


def measure(coding: str, seconds: float) -> dict[str, Any]:
    """Return the figures of so long a look at the Fly screen; needs the packages of ``dev``."""
    with tempfile.TemporaryDirectory(prefix="dronerf-dashboard-") as folder:
        return asyncio.run(_measure(coding, seconds, Path(folder)))


async def _measure(coding: str, seconds: float, folder: Path) -> dict[str, Any]:
    chromium = shutil.which("chromium")
    pictures = NumberedPictures(blob_on_floor())
    async with AsyncExitStack() as stack:
        fleet = await stack.enter_async_context(hovering_fleet(folder, pictures, _FPS))
        driver = await stack.enter_async_context(async_playwright())
        browser = await driver.chromium.launch(executable_path=chromium, args=CHROMIUM_ARGUMENTS)
        stack.push_async_callback(browser.close)
        page = await browser.new_page(
            viewport=ViewportSize(width=_SCREEN_PX[0], height=_SCREEN_PX[1])
        )
        token = fleet.console.headers["Authorization"].removeprefix("Bearer ")
        await page.goto(f"{fleet.console.address}/?token={token}")
        await page.goto(f"{fleet.console.address}/?video={coding}#/fly")
        await page.reload()
        tiles = page.locator(f"[data-testid^=tile-drone][data-coding={coding}]")
        await tiles.nth(3).wait_for()
        paint_ms = await page.evaluate(
            "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"
        )
        await page.evaluate(
            _PROBE,
            {
                "bits": _BITS,
                "blockPx": _BLOCK_PX,
                "widthPx": TELLO_INTRINSICS.width,
                "heightPx": TELLO_INTRINSICS.height,
            },
        )
        tools = await page.context.new_cdp_session(page)
        await asyncio.sleep(_WARM_UP_S)
        await page.evaluate("probe()")
        heap_mb = [await _heap_mb(tools)]
        begun_s = time.monotonic()
        shown: dict[str, int] = {}
        coded_so = 0
        late_ms: list[float] = []
        frames_ms: list[float] = []
        intervals_ms: list[float] = []
        while time.monotonic() - begun_s < seconds:
            # Often enough that no number comes twice.
            await asyncio.sleep(min(10.0, seconds))
            found = await page.evaluate("probe()")
            frames_ms += found["frames"]
            intervals_ms += found["intervals"]
            for tile, numbers in found["seen"].items():
                # The first was there at the last look already.
                shown[tile] = shown.get(tile, 0) + len(numbers) - 1
                coded_so += sum(came == coding for _, _, came in numbers[1:])
                late_ms += [
                    at_ms - 1000.0 * pictures.drawn_s.get(number, math.inf)
                    for number, at_ms, _ in numbers[1:]
                ]
        took_s = time.monotonic() - begun_s
        heap_mb.append(await _heap_mb(tools))
        await page.evaluate("location.hash = '#/plan'")
        scene = page.frame_locator("[data-testid=scene-frame]")
        await scene.locator("canvas").first.wait_for()
        await asyncio.sleep(_WARM_UP_S)
        await page.evaluate("probe()")
        await asyncio.sleep(min(_SCENE_SECONDS, seconds))
        with_scene = await page.evaluate("probe()")
    return {
        "seconds": round(took_s, 1),
        "sent_per_s": _FPS,
        "shown_per_s": {tile: round(count / took_s, 2) for tile, count in shown.items()},
        "coded_so": round(coded_so / max(sum(shown.values()), 1), 4),
        "glass_to_glass_ms": percentiles([ms for ms in late_ms if 0.0 < ms < _MISREAD_MS]),
        "misread": sum(not 0.0 < ms < _MISREAD_MS for ms in late_ms),
        "first_paint_ms": None if paint_ms is None else round(paint_ms, 1),
        "frame_ms": percentiles(frames_ms),
        "interval_ms": percentiles(intervals_ms),
        "scene_frame_ms": percentiles(with_scene["frames"]),
        "scene_interval_ms": percentiles(with_scene["intervals"]),
        "heap_mb": {"first": heap_mb[0], "last": heap_mb[1]},
    }


async def _heap_mb(tools: Any) -> float:
    await tools.send("HeapProfiler.collectGarbage")
    usage = await tools.send("Runtime.getHeapUsage")
    return round(usage["usedSize"] / 2**20, 2)
