"""The console's five screens in a browser: what they show, and that everybody can use them."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from browsers import chromium
from fake_mission import (
    DRONES,
    JPEG,
    capture_changed,
    checklist,
    drone_report,
    failsafe_fired,
    jpeg,
    level_failed,
    picture_taken,
    plan_found,
    seed_fitted,
)
from playwright.async_api import Browser, Locator, Page, Route, expect
from served_console import TOKEN, Console, runner_of, serve, until

from server.geometry.cameras import TELLO_INTRINSICS as LENS
from server.geometry.poses import look_at
from server.jobs.spec import JobSpec
from server.mission.events import (
    MetricsMeasured,
    NoGoChanged,
    PlanProgressed,
    TrainingProgressed,
)
from server.nerf.dataset import PosedFile, load_dataset, write_transforms
from server.stages import Metrics
from server.swarm.failsafes import FailsafeTable

WEB = Path(__file__).parents[2] / "web"
AXE = WEB / "node_modules/axe-core/axe.min.js"

pytestmark = [
    pytest.mark.browser,
    pytest.mark.loopback,
    pytest.mark.slow,
    pytest.mark.skipif(not (WEB / "dist/index.html").exists(), reason="no dashboard is built"),
]

# Drone 1 flies two metres along +Y in ten seconds and takes a picture on its way.
REEL = {
    "seconds": 10.0,
    "drones": [
        {
            "drone_id": "drone-1",
            "film": None,
            "begins_s": 0.0,
            "way": [[0.5 * n, 1.5, 0.1 * n - 1.0, 0.8, 3.1] for n in range(21)],
        }
    ],
    "moments": [
        {"at_s": 1.0, "kind": "warning", "drone_id": "", "text": "Mind the chair."},
        {"at_s": 4.0, "kind": "picture", "drone_id": "drone-1", "text": "3"},
    ],
    "object_box": [[-0.2, -0.2, 0.0], [0.2, 0.2, 0.5]],
}

SCREENS = ("fly", "plan", "reconstruct", "library", "setup")
SIZES = {"desk": (1440, 900), "phone": (390, 844)}


@pytest.fixture
async def browser() -> AsyncIterator[Browser]:
    async with chromium() as browser:
        yield browser


def furnish(console: Console) -> None:
    """Let the mission be in the middle of its second capture, with one in the library."""
    mission = console.mission
    for run, state in (("run-1", "succeeded"), ("run-2", "aborted"), ("run-3", "running")):
        folder = mission.runs / run
        (folder / "images").mkdir(parents=True)
        (folder / "images/0000.jpg").write_bytes(JPEG)
        (folder / "preview.jpg").write_bytes(JPEG)
        request = {"train_seconds": 60.0, "seed": 3}
        seconds = {"fly": 60.0, "land": 5.0, "train": 100.0}
        (folder / "capture.json").write_text(json.dumps({"request": request, "seconds": seconds}))
        psnr_db = 21.5 if run == "run-1" else 19.25
        metrics = {"psnr_db": psnr_db, "ssim": 0.61, "flip": 0.2, "images": 24}
        judged = {**metrics, "images_held_out": 3} if state != "running" else None
        changed = capture_changed(run, state, "fly" if state == "running" else "done")
        mission.keep(replace(changed, run=str(folder)), None, judged)
    run = mission.runs / "run-1"
    (run / "held_out").mkdir()
    (run / "held_out/0000.jpg").write_bytes(jpeg(grey=220))
    (run / "recording.mcap").write_bytes(b"")
    (run / "replay").mkdir()
    (run / "replay/replay.json").write_text(json.dumps(REEL))
    mission.checks = checklist(level_failed("drone-2"))
    mission.kept = [seed_fitted(), mission.records["run-3"].status, failsafe_fired("drone-3")]
    mission.reports["drone-3"] = drone_report("drone-3", activity="holding", video_age_s=4.2)


def keep_training(
    console: Console, name: str, *, psnr_db: float, only: bool = False, on: str = "run-1"
) -> Path:
    """Let a field trained anew on a capture be in the library."""
    folder = console.mission.runs / name
    parameters = {"source": "dataset", "dataset": str(console.mission.runs / on)}
    parameters |= {"train_seconds": 90.0, "object_only": only}
    JobSpec("reconstruct", parameters, seed=7).write(folder / "jobs/reconstruct")
    metrics = {**parameters, "psnr_db": psnr_db, "ssim": 0.7, "flip": 0.15, "images_held_out": 3}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    (folder / "held_out").mkdir()
    for file in ("preview.jpg", "held_out/0000.jpg"):
        (folder / file).write_bytes(jpeg(grey=180))
    (folder / "mesh.glb").write_bytes(b"mesh")
    return folder


async def tell(console: Console) -> None:
    """Publish what happens in a capture, so that every panel has something to show."""
    publish = console.mission.events.publish
    for iteration, fitness in ((0, 0.5), (2000, 0.7), (4000, 0.75)):
        publish(PlanProgressed(iteration, 4000, 1e-3, fitness))
    publish(plan_found())
    for index in range(10):
        publish(picture_taken(index, DRONES[index % 4]))
    for second in range(5):
        publish(
            TrainingProgressed(
                "train", 10 * second, second, 60.0, 0.1, 18.0 + second, None, 5e5, 10
            )
        )
    publish(MetricsMeasured(Metrics(10, 2, 21.0, 0.6, 0.2, 18.0)))


async def open_screen(console: Console, page: Page, screen: str) -> None:
    await page.goto(f"{console.http}/?token={TOKEN}")
    await expect(page.get_by_test_id("tile-drone-1")).to_be_visible()
    await tell(console)
    await page.get_by_test_id(f"screen-{screen}").click()
    await expect(page.get_by_test_id(f"screen-{screen}")).to_have_attribute("aria-current", "page")


async def faults(page: Page) -> list[str]:
    """Return the serious faults that axe finds on the page, each with the place of the first."""
    await page.evaluate(AXE.read_text())
    found = await page.evaluate(
        """async () => (await axe.run({exclude: [["iframe"]]}, {resultTypes: ["violations"]}))
            .violations.filter((fault) => ["serious", "critical"].includes(fault.impact))
            .map((fault) => `${fault.id}: ${fault.nodes.map((node) => node.target).join(" | ")}`)"""
    )
    return list(found)


@pytest.mark.skipif(not AXE.exists(), reason="axe-core is not installed")
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", ["dark", "light"])
async def test_no_screen_has_a_serious_fault(
    tmp_path: Path, browser: Browser, scheme: str, size: str
) -> None:
    width, height = SIZES[size]
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page(
            viewport={"width": width, "height": height},
            color_scheme="dark" if scheme == "dark" else "light",
            reduced_motion="reduce",
        )
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        wrong: dict[str, list[str]] = {}
        for screen in SCREENS:
            await open_screen(console, page, screen)
            if screen == "library":
                await page.get_by_test_id("mark-run-1").check()
                await page.get_by_test_id("mark-run-2").check()
                await page.get_by_test_id("compare").click()
                await expect(page.get_by_test_id("difference-psnr")).to_contain_text("19.25")
                wrong.update({"compare": found} if (found := await faults(page)) else {})
                await page.goto(f"{console.http}/#/library/run-1%2Freplay")
                await expect(page.get_by_test_id("replay")).to_be_visible()
                wrong.update({"replay": found} if (found := await faults(page)) else {})
                await page.goto(f"{console.http}/#/library/run-1")
                await expect(page.get_by_test_id("held-out")).to_be_visible()
            if screen == "setup":
                await expect(page.get_by_test_id("fleet")).to_be_visible()
                await page.get_by_test_id("settings-search").fill("control_rate")
            # Nothing is wider than its window: a console is not for scrolling sideways.
            beyond = "document.documentElement.scrollWidth - innerWidth"
            assert await page.evaluate(beyond) <= 0, screen
            found = await faults(page)
            if found:
                wrong[screen] = found
        await page.close()
    assert wrong == {}
    assert errors == []


async def test_keys_go_from_screen_to_screen_and_hold_from_each(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "fly")
        for number, screen in enumerate(SCREENS, start=1):
            await page.keyboard.press(str(number))
            await expect(page.locator("main")).to_have_class(f"console console-{screen}")
            await expect(page).to_have_url(f"{console.http}/#/{screen}")
            # The stops are there, and the space bar is one of them.
            await expect(page.get_by_test_id("cut")).to_be_visible()
            await page.keyboard.press("Space")
            await until(lambda n=number: console.stops.calls == n * [("hold", None)])
        # Where digits are typed they are digits.
        await page.get_by_test_id("settings-search").fill("")
        await page.get_by_test_id("settings-search").press("1")
        await expect(page.locator("main")).to_have_class("console console-setup")
        await page.go_back()
        await expect(page.locator("main")).to_have_class("console console-library")
        await page.close()


async def test_captures_are_looked_at_compared_and_deleted(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "library")
        # The newest first; one that flies can be looked at and not be deleted.
        names = page.locator(".capture-name")
        await expect(names).to_have_text(["run-3", "run-2", "run-1"])
        await names.nth(0).click()
        await expect(page.get_by_test_id("run")).to_have_attribute("data-run", "run-3")
        await expect(page.get_by_test_id("delete-capture")).to_have_count(0)

        await page.get_by_test_id("mark-run-1").check()
        await page.get_by_test_id("mark-run-2").check()
        await expect(page.get_by_test_id("mark-run-3")).to_be_disabled()
        await page.get_by_test_id("compare").click()
        row = page.get_by_test_id("difference-psnr")
        await expect(row).to_contain_text("21.50 dB better")
        await expect(row).to_contain_text("2.25 dB", use_inner_text=True)
        slider = page.get_by_test_id("compare-slider")
        await slider.focus()
        await page.keyboard.press("Home")
        await expect(slider).to_have_attribute("aria-valuetext", "0 % of B")

        await page.goto(f"{console.http}/#/library/run-2")
        async with page.expect_download() as waiting:
            await page.get_by_role("link", name="capture.json").click()
        assert (await waiting.value).suggested_filename == "capture.json"
        star = page.get_by_test_id("star-capture")
        await expect(star).to_have_attribute("aria-pressed", "false")
        await star.click()
        await expect(star).to_have_attribute("aria-pressed", "true")
        await expect(page.get_by_test_id("kept-run-2")).to_be_visible()
        assert (console.mission.runs / "run-2" / "starred").exists()
        await star.click()
        await expect(page.get_by_test_id("kept-run-2")).to_have_count(0)
        delete = page.get_by_test_id("delete-capture")
        await delete.click()
        await expect(delete).to_have_text("Delete for good?")
        assert (console.mission.runs / "run-2").is_dir()
        await delete.click()
        await expect(page.get_by_test_id("capture-run-2")).to_have_count(0)
        assert not (console.mission.runs / "run-2").exists()
        assert list(console.mission.records) == ["run-1", "run-3"]
        await page.close()


async def test_a_capture_is_trained_anew_with_other_settings(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        (console.mission.runs / "run-1/transforms.json").write_text("{}")
        console.mission.keep(capture_changed("run-3", "succeeded", "done"))
        page = await browser.new_page()
        await open_screen(console, page, "library")
        await page.goto(f"{console.http}/#/library/run-1")
        start = page.get_by_test_id("train-anew")
        await page.get_by_label("Seed").fill("1.5")
        await expect(start).to_be_disabled()
        await page.get_by_label("Seed").fill("7")
        await page.get_by_label("The object alone").check()
        await start.click()
        await expect(page.get_by_test_id("training-running")).to_be_visible()
        (job,) = runner_of(console).jobs
        assert job.spec.seed == 7
        assert job.spec.parameters["object_only"] is True
        news = {"event": "progressed", "stage": "train", "seconds": 6.0, "seconds_total": 24.0}
        job.news.put_nowait(news)
        progress = page.get_by_role("progressbar", name="Share of this stage done")
        await expect(progress).to_have_attribute("value", "0.25")
        # At the pace that was seen; the next stages are not promised.
        await asyncio.sleep(1.2)
        job.news.put_nowait(news | {"seconds": 18.0})
        await expect(page.get_by_test_id("training-running")).to_contain_text(
            re.compile(r"Training.*0:0\d left.*asked for 0:\d\d ago")
        )
        run = Path(job.spec.parameters["out"])
        (run / "mesh.glb").write_bytes(b"mesh")
        about = {"dataset": job.spec.parameters["dataset"], "object_only": True}
        judged = {"psnr_db": 23.456, "ssim": 0.8}
        (run / "metrics.json").write_text(json.dumps(about | judged))
        job.news.put_nowait({"event": "done", **judged})
        done = page.get_by_test_id("training-succeeded")
        await expect(done).to_contain_text("23.46 dB")
        await expect(done).to_contain_text("60 s, seed 7, the object alone")
        mesh = done.get_by_role("link", name="mesh.glb").first
        await expect(mesh).to_have_attribute("href", re.compile(f"/artifacts/{run.name}/mesh.glb$"))
        # What is cancelled says so.
        await start.click()
        await page.get_by_role("button", name="Cancel").click()
        await expect(page.get_by_test_id("training-cancelled")).to_be_visible()
        await page.close()


async def test_fields_trained_anew_are_compared_and_deleted(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        first = keep_training(console, "20260501-120000-train-run-1", psnr_db=22.5)
        second = keep_training(console, "20260502-120000-train-run-1", psnr_db=30.0, only=True)
        keep_training(console, "20260503-120000-train-run-3", psnr_db=18.25, on="run-3")
        console.mission.kept = [console.mission.keep(capture_changed("run-3", "succeeded")).status]
        page = await browser.new_page(viewport={"width": 360, "height": 800})
        await open_screen(console, page, "library")
        await page.goto(f"{console.http}/#/library/run-1")
        fields = page.locator(".field-card")
        await expect(fields).to_have_count(3)
        await expect(fields.nth(0)).to_contain_text("Trained in flight")
        await expect(fields.nth(2)).to_contain_text("90 s, seed 7")
        width = await page.evaluate("document.documentElement.scrollWidth")
        assert width <= 360
        assert await faults(page) == []
        # The capture's own field is the one marked in the list of captures.
        await page.get_by_test_id("mark-field-run-1").focus()
        await page.keyboard.press("Enter")
        await expect(page.get_by_test_id("mark-run-1")).to_be_checked()
        await page.get_by_test_id(f"mark-field-{first.name}").check()
        await expect(page.get_by_test_id(f"mark-field-{second.name}")).to_be_disabled()
        await page.get_by_test_id("compare-fields").click()
        row = page.get_by_test_id("difference-psnr")
        await expect(row).to_contain_text("22.50 dB better")
        await expect(page.get_by_test_id("difference-training")).to_contain_text("+30 s")
        picture = page.get_by_role("combobox", name="Picture")
        await picture.select_option(label="Rendering of picture 1, which was held out")
        shown = page.get_by_test_id("comparison").locator("img").last
        path = f"/artifacts/{first.name}/held_out/0000.jpg"
        await expect(shown).to_have_attribute("src", re.compile(f"{path}$"))
        assert await faults(page) == []
        # An object before white is no better than a room.
        await page.goto(f"{console.http}/#/library/run-1,run-1~{second.name}")
        await expect(row).to_contain_text("30.00 dB")
        await expect(row).not_to_contain_text("better")
        await expect(page.get_by_test_id("comparison")).to_contain_text("before white")

        await page.goto(f"{console.http}/#/library/run-1")
        card = fields.filter(has=page.get_by_test_id(f"mark-field-{first.name}"))
        delete = card.get_by_test_id("delete-training")
        await delete.click()
        assert first.is_dir()
        await delete.click()
        await expect(fields).to_have_count(2)
        assert not first.exists()
        # A mark on what is gone is none.
        await expect(page.get_by_test_id("compare-fields")).to_have_count(0)
        delete = page.get_by_test_id("delete-capture")
        await delete.click()
        await expect(delete).to_contain_text("with 1 field trained anew")
        await delete.click()
        await expect(page.get_by_test_id("capture-run-1")).to_have_count(0)
        assert not second.exists()
        # The screen of the newest capture shows those of before as well.
        await page.get_by_test_id("screen-reconstruct").click()
        await expect(fields).to_have_count(1)
        await expect(fields).to_contain_text("18.25 dB")
        await page.close()


async def test_what_is_marked_is_named_and_taken_back(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        for day, psnr_db in ((1, 22.5), (2, 30.0)):
            keep_training(console, f"2026050{day}-120000-train-run-1", psnr_db=psnr_db)
        page = await browser.new_page(viewport={"width": 360, "height": 800})
        await open_screen(console, page, "library")
        await page.goto(f"{console.http}/#/library/run-1")
        for day in (1, 2):
            await page.get_by_test_id(f"mark-field-2026050{day}-120000-train-run-1").check()
        # Nothing of what is marked is in sight there, and nothing else can be marked.
        await page.goto(f"{console.http}/#/library/run-2")
        await expect(page.get_by_test_id("run")).to_have_attribute("data-run", "run-2")
        await expect(page.get_by_test_id("mark-run-2")).to_be_disabled()
        bar = page.locator(".compare-bar")
        await expect(bar.get_by_role("link", name="20260502-120000")).to_have_attribute(
            "href", "#/library/run-1"
        )
        assert await page.evaluate("document.documentElement.scrollWidth") <= 360
        await page.get_by_test_id("compare-clear").click()
        await expect(bar).to_have_text("Mark two captures or fields to compare them.")
        await expect(page.get_by_test_id("mark-run-2")).to_be_enabled()
        await page.close()


async def test_a_deletion_tells_of_all_that_goes_with_it(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "library")
        lists = "**/captures/run-1/trainings*"
        answered = asyncio.Event()

        async def slowly(route: Route) -> None:
            await answered.wait()
            await route.continue_()

        await page.route(lists, slowly)
        await page.goto(f"{console.http}/#/library/run-1")
        delete = page.get_by_test_id("delete-capture")
        await expect(page.get_by_test_id("waiting")).to_have_text(
            re.compile(r"^Asking the console… 0:0\d$")
        )
        await expect(delete).to_be_disabled()
        answered.set()
        await expect(delete).to_be_enabled()
        # Somebody else's, since that answer.
        keep_training(console, "20260501-120000-train-run-1", psnr_db=22.5)
        answered.clear()
        await delete.click()
        await expect(delete).to_have_text("Asking the console…")
        await delete.click()
        assert (console.mission.runs / "run-1").is_dir()
        answered.set()
        await expect(delete).to_have_text("Delete for good, with 1 field trained anew?")
        # The question fades; the next one is not answered at all.
        await expect(delete).to_have_text("Delete", timeout=10_000)
        await page.unroute(lists)
        await page.route(lists, lambda route: route.abort())
        await delete.click()
        await expect(delete).to_be_disabled()
        await page.unroute(lists)
        await page.get_by_role("button", name="Ask again").click()
        await expect(delete).to_be_enabled()
        await page.close()


async def test_what_takes_long_says_what_and_how_long(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "library")
        answered = asyncio.Event()

        async def slowly(route: Route) -> None:
            await answered.wait()
            await route.continue_()

        waiting = page.get_by_test_id("waiting")
        await page.route("**/captures/run-2/replay", slowly)
        await page.goto(f"{console.http}/#/library/run-2/replay")
        await expect(waiting).to_have_text(
            re.compile(r"^Reading the recording.*… 0:0[2-9], at most 5:00$")
        )
        await page.route("**/replay/progress", lambda route: route.fulfill(json={"share": 0.4}))
        read = page.get_by_role("progressbar", name="Share of the recording read")
        await expect(read).to_have_attribute("value", "0.4")
        answered.set()
        again = page.get_by_role("button", name="Ask again")
        await expect(again).to_be_visible()

        answered.clear()
        await page.route("**/captures/run-2", slowly)
        await page.goto(f"{console.http}/#/library/run-2")
        delete = page.get_by_test_id("delete-capture")
        await delete.click()
        await expect(delete).to_have_text("Delete for good?")
        await delete.click()
        await expect(waiting).to_have_text(
            re.compile(r"^Deleting \d+ files… 0:0[2-9], at most 5:00$")
        )
        await expect(delete).to_be_disabled()
        answered.set()
        await expect(page.get_by_test_id("capture-run-2")).to_have_count(0)
    # The console is gone: how long for, and when the page tries again.
    await expect(page.get_by_role("alert")).to_contain_text(
        re.compile(r"\d s, (next attempt in [1-5] s|trying now)")
    )
    await page.close()


async def test_whatever_was_asked_for_says_so(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        field = keep_training(console, "20260501-120000-train-run-1", psnr_db=22.5)
        page = await browser.new_page()
        await open_screen(console, page, "library")
        answered = asyncio.Event()

        async def slowly(route: Route) -> None:
            await answered.wait()
            await route.continue_()

        def said(place: str, what: str = "Asking the console") -> Locator:
            return page.locator(place).get_by_test_id("waiting").filter(has_text=what)

        for asked in ("captures/*/trainings*", "reconstructions", "drones/drone-1/calibration"):
            await page.route(f"**/{asked}", slowly)
        await page.goto(f"{console.http}/#/library/run-1,run-1~{field.name}")
        await expect(said(".compare")).to_be_visible()
        answered.set()
        await expect(page.get_by_test_id("comparison")).to_be_visible()

        await page.goto(f"{console.http}/#/library/run-1")
        await expect(page.locator(".field-card")).to_have_count(2)
        answered.clear()
        await page.get_by_test_id("train-anew").click()
        await expect(said(".retrain", "The training is being started")).to_be_visible()
        answered.set()
        await expect(said(".retrain", "The training is being started")).to_have_count(0)

        answered.clear()
        await page.goto(f"{console.http}/#/setup")
        await page.get_by_test_id("calibrate-drone-1").click()
        await expect(said(".calibrating")).to_be_visible()
        answered.set()
        start = page.get_by_test_id("calibration-start")
        await expect(start).to_be_enabled()
        answered.clear()
        await start.click()
        await expect(said(".calibrating")).to_be_visible()
        answered.set()
        await expect(said(".calibrating")).to_have_count(0)
        await page.close()


async def test_a_known_length_sets_the_scale_of_a_capture(tmp_path: Path, browser: Browser) -> None:
    ends = np.array([[-0.25, 0.0, 0.1], [0.25, 0.0, 0.1]])
    async with serve(tmp_path, dist=WEB / "dist") as console:
        folder = keep_posed_run(console)
        poses = load_dataset(folder).T_world_cam
        page = await browser.new_page(viewport={"width": 1440, "height": 1400})
        await open_screen(console, page, "library")
        await page.goto(f"{console.http}/#/library/run-1")
        await page.get_by_text("Scale from a known length").click()
        start = page.get_by_test_id("set-scale")
        await page.get_by_label("Distance of the ends").fill("0.55")
        await expect(start).to_be_disabled()
        for picture in (0, 1):
            shown = page.get_by_test_id(f"mark-picture-{picture}")
            await shown.scroll_into_view_if_needed()
            size = await shown.bounding_box()
            assert size is not None
            pixels, _ = LENS.project(ends, poses[picture])
            for x, y in (pixels + 0.5) * size["width"] / LENS.width:
                await shown.click(position={"x": float(x), "y": float(y)})
        await expect(start).to_be_enabled()
        # Arrow keys move a cross; only Enter marks with it.
        last = page.get_by_test_id("mark-picture-1")
        marked = last.locator(".mark-cross-a")
        before = await marked.get_attribute("style")
        await last.focus()
        await page.keyboard.press("Shift+ArrowRight")
        await expect(last.locator(".mark-cross-cursor")).to_be_visible()
        assert await marked.get_attribute("style") == before
        await start.click()
        await expect(page.get_by_test_id("scale-found")).to_contain_text("multiplied by 1.")
        after = load_dataset(folder).T_world_cam
        scaled = np.linalg.norm(after[:, :3, 3], axis=1) / np.linalg.norm(poses[:, :3, 3], axis=1)
        # Shown smaller than it is, a click is a pixel or two wrong.
        np.testing.assert_allclose(scaled, 1.1, rtol=0.04)
        await page.close()


def keep_posed_run(console: Console) -> Path:
    """Keep a finished capture of four grey pictures round the middle."""
    console.mission.keep(capture_changed("run-1", "succeeded", "done"))
    folder = console.mission.runs / "run-1"
    (folder / "images").mkdir(parents=True, exist_ok=True)
    posed = []
    for k, azimuth in enumerate((0.0, 1.2, 2.4, 3.6)):
        T = look_at(np.array([1.6 * np.cos(azimuth), 1.6 * np.sin(azimuth), 0.9]), np.zeros(3))
        file = f"images/{k:04d}.jpg"
        cv2.imwrite(str(folder / file), np.full((LENS.height, LENS.width, 3), 120, np.uint8))
        posed.append(PosedFile(file, T))
    write_transforms(folder, posed, LENS, None)
    return folder


async def test_a_rendering_is_judged_and_a_flight_replayed(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "library")
        await page.locator(".capture-name").nth(2).click()
        await page.get_by_test_id("judge-error").click()
        # The photograph's grey is 100, the rendering's 220: beyond the largest error told apart.
        colour = """map => {
            const pen = map.getContext("2d");
            return [...pen.getImageData(map.width / 2, map.height / 2, 1, 1).data];
        }"""
        error_map = page.get_by_test_id("error-map")
        await expect(error_map).to_have_attribute("width", "640")
        assert await error_map.evaluate(colour) == [252, 254, 164, 255]

        await page.get_by_test_id("open-replay").click()
        place = page.get_by_test_id("replay-place")
        await page.get_by_role("button", name="Picture 3").click()
        await expect(place).to_have_value("4")
        trail = page.locator(".sketch-trail")
        assert len((await trail.get_attribute("points") or "").split()) == 9
        await page.get_by_test_id("replay-run").click()
        await expect(place).to_have_value("10", timeout=30_000)
        assert len((await trail.get_attribute("points") or "").split()) == 21

        keys = page.locator("#keys")
        await page.keyboard.press("?")
        await expect(keys).to_be_visible()
        await page.keyboard.press("Escape")
        await expect(keys).not_to_be_visible()
        await page.close()


async def test_the_plan_is_shown_to_whoever_comes_later(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "plan")
        curve = page.get_by_test_id("annealing-curve")
        await expect(curve).to_have_attribute("data-points", "3")
        await page.reload()
        await expect(curve).to_have_attribute("data-points", "3")
        await expect(page.locator(".viewpoints tbody tr")).to_have_count(8)
        # The next search tells how far it is, and, once it has a pace, how long it takes.
        search = page.get_by_test_id("search")
        await expect(search).to_have_count(0)
        console.mission.events.publish(PlanProgressed(1000, 4000, 1e-3, 0.6))
        await expect(search.get_by_role("progressbar")).to_have_attribute("value", "0.25")
        await asyncio.sleep(1.2)
        console.mission.events.publish(PlanProgressed(2000, 4000, 1e-3, 0.7))
        await expect(search).to_have_text(re.compile(r"^0:0[1-3] left$"))
        await expect(search).to_have_text(re.compile(r"^nothing heard for \d s$"), timeout=9000)
        console.mission.events.publish(plan_found())
        await expect(search).to_have_count(0)
        await page.close()


async def test_no_go_volumes_are_drawn_moved_typed_and_removed(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        furnish(console)
        page = await browser.new_page()
        await open_screen(console, page, "plan")
        await page.get_by_test_id("draw-no-go").click()
        sketch = page.locator(".above .sketch")
        await expect(sketch).to_have_class("sketch is-drawn-on")

        async def drag(start: tuple[float, float], end: tuple[float, float]) -> None:
            frame = await sketch.bounding_box()
            assert frame is not None
            # The floor is a square in the middle of its frame.
            side = min(frame["width"], frame["height"])
            left = frame["x"] + (frame["width"] - side) / 2
            top = frame["y"] + (frame["height"] - side) / 2
            await page.mouse.move(left + start[0] * side, top + start[1] * side)
            await page.mouse.down()
            await page.mouse.move(left + end[0] * side, top + end[1] * side, steps=4)
            await page.mouse.up()

        await drag((0.75, 0.25), (0.85, 0.4))
        await until(lambda: list(console.mission.volumes) == ["no-go-1"])
        drawn = console.mission.volumes["no-go-1"]
        x_0, y_0, x_1, y_1 = drawn.area
        # To the right and up is +X and +Y.
        assert 0.0 < x_0 < x_1
        assert 0.0 < y_0 < y_1
        console.mission.events.publish(NoGoChanged((drawn,)))
        await expect(page.get_by_test_id("area-no-go-1")).to_be_visible()

        await drag((0.8, 0.3), (0.2, 0.3))
        await until(lambda: console.mission.volumes["no-go-1"].area[2] < 0.0)
        moved = console.mission.volumes["no-go-1"]
        assert moved.area[1] == pytest.approx(y_0)
        assert moved.area[2] - moved.area[0] == pytest.approx(x_1 - x_0)
        console.mission.events.publish(NoGoChanged((moved,)))

        # A finger that trembles moves nothing, and nobody draws by accident.
        await drag((0.2, 0.3), (0.202, 0.302))
        await page.get_by_test_id("draw-no-go").click()
        await drag((0.2, 0.3), (0.7, 0.7))
        await page.get_by_test_id("draw-no-go").click()
        assert console.mission.volumes["no-go-1"] is moved

        # The same by keys and numbers: the drag has chosen it.
        east = page.get_by_label("X to", exact=True)
        await east.fill("")
        await expect(page.get_by_role("button", name="Apply")).to_be_disabled()
        await east.fill("-0.25")
        await page.get_by_role("button", name="Apply").click()
        await until(lambda: console.mission.volumes["no-go-1"].area[2] == -0.25)
        await page.get_by_role("button", name="Remove").click()
        await until(lambda: console.mission.volumes == {})
        console.mission.events.publish(NoGoChanged(()))
        await expect(page.get_by_test_id("no-go")).to_have_count(0)
        await page.get_by_test_id("add-no-go").click()
        await until(lambda: list(console.mission.volumes) == ["no-go-2"])
        assert await faults(page) == []
        await page.close()


async def test_a_silent_drone_counts_down_and_one_that_rests_is_no_alarm(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        publish = console.mission.events.publish
        # Reports come when this test sends them; their silence shall not be what counts down.
        table = FailsafeTable()
        # A table that no config could hold.
        object.__setattr__(table, "state_age_s", {"hold": 500.0, "land": 1000.0})
        console.mission.table = table
        page = await browser.new_page()
        await page.goto(f"{console.http}/?token={TOKEN}")
        tile = page.get_by_test_id("tile-drone-1")
        await expect(tile).to_contain_text("NO VIDEO")

        # Between the rows that hold and land: the hold has acted, the landing comes.
        publish(drone_report("drone-1", activity="holding", video_age_s=5.0))
        note = page.get_by_test_id("countdown-drone-1")
        await expect(note).to_contain_text(re.compile(r"Land in \d+ s: No picture"))

        publish(drone_report("drone-1", activity="ground", video_age_s=40.0, video_wanted=False))
        await expect(note).to_have_count(0)
        await expect(tile).to_contain_text("Video off")
        await expect(tile).not_to_contain_text("NO VIDEO")
        await page.close()


async def test_one_browser_flies_and_the_other_asks_for_it(
    tmp_path: Path, browser: Browser
) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        calls = console.mission.calls
        pages = [await (await browser.new_context()).new_page() for _ in range(2)]
        for page in pages:
            await page.goto(f"{console.http}/?token={TOKEN}")
            await expect(page.get_by_test_id("tile-drone-1")).to_be_visible()
        flies, watches = pages
        await flies.get_by_test_id("capture-start").click()
        await flies.get_by_test_id("preflight-start").click()
        await expect(flies.get_by_test_id("in-command")).to_be_visible()
        await expect(watches.get_by_test_id("watching")).to_contain_text("Another browser")

        # Who watches does not fly, and is told why; the stops are everybody's.
        console.mission.keep(capture_changed("run-1", "paused", "fly"))
        console.mission.events.publish(console.mission.records["run-1"].status)
        await watches.get_by_test_id("capture-resume").click()
        await expect(watches.get_by_test_id("alarm")).to_contain_text(
            "another browser is in command"
        )
        assert console.mission.records["run-1"].status.state == "paused"
        await watches.get_by_test_id("land").click()
        await until(lambda: console.stops.calls == [("land", None)])

        await watches.get_by_test_id("ask-command").click()
        await flies.get_by_test_id("hand-over").click()
        await expect(watches.get_by_test_id("in-command")).to_be_visible()
        await expect(flies.get_by_test_id("watching")).to_be_visible()
        await watches.get_by_test_id("capture-resume").click()
        await until(lambda: console.mission.records["run-1"].status.state == "running")

        # Taking it needs no answer, but a second press.
        await flies.get_by_test_id("take-command").click()
        await flies.get_by_test_id("take-command").click()
        await expect(flies.get_by_test_id("in-command")).to_be_visible()
        await expect(watches.get_by_test_id("watching")).to_be_visible()
        assert "left" not in console.mission.operator
        assert [name for name, _ in calls] == ["start"]


async def test_another_language_comes_with_the_next_load(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        page = await browser.new_page()
        await open_screen(console, page, "setup")
        await page.get_by_test_id("language").select_option("de")
        await expect(page.locator("html")).to_have_attribute("lang", "de")
        await expect(page.get_by_test_id("screen-library")).to_contain_text("Bibliothek")
        await page.get_by_test_id("language").select_option("en")
        await expect(page.get_by_test_id("screen-library")).to_contain_text("Library")
        await page.close()

        german = await browser.new_page(locale="de-AT")
        await german.goto(f"{console.http}/?token={TOKEN}")
        await expect(german.get_by_test_id("screen-fly")).to_contain_text("Fliegen")
        await german.close()
