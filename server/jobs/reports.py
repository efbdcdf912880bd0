"""What a training tells about itself while it runs: figures and, now and then, a preview."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from server.drafts import drafted
from server.jobs.spec import Reporting
from server.jobs.wanted_view import WantedView
from server.jobs.worker import Reporter
from server.nerf.metrics import SSIM_WINDOW_PX, psnr_db, ssim
from server.nerf.orbit_view import OrbitView
from server.nerf.preview import render_preview
from server.nerf.training import StepReport, Trainer
from server.nerf.uncertainty import known_surface

_REPORT_S = 1.0
_PREVIEW_S = 4.0
_SCORE_S = 8.0
# A young field changes fast: what comes of it is shown and scored sooner, the pauses grow with it.
_FIRST_S = 1.0
_ORBIT_S = 40.0
# Of the time at most this share goes into previews that somebody asks for one after the other.
_SHOWN_SHARE = 0.3
_LOOK_S = 0.05
# The curves' held-out figures are taken on small renderings; the final figures are not.
_SCORE_SCALE = 0.25


def tell_share(reporter: Reporting, stage: str, images: int) -> Callable[[float], None]:
    """Return what tells of a stage how far it is and how long it will take in all.

    Args:
        reporter: Where the news goes.
        stage: Its name.
        images: Pictures in use.
    """
    begun_s = time.monotonic()

    def tell(share: float) -> None:
        seconds = time.monotonic() - begun_s
        reporter.emit(
            "progressed",
            stage=stage,
            step=0,
            seconds=round(seconds, 1),
            seconds_total=round(seconds / share, 1) if share > 0.05 else None,
            loss=None,
            psnr_db=None,
            held_out_psnr_db=None,
            held_out_ssim=None,
            samples_per_s=0.0,
            images=images,
        )

    return tell


def keep_renderings(out: Path) -> Callable[[int, NDArray[np.float32]], None]:
    """Return what writes the judged field's renderings to ``out/held_out/NNNN.jpg``.

    Beside the photographs they show where the field is wrong, and not only by how much.
    """
    folder = out / "held_out"

    def keep(index: int, image_rgb: NDArray[np.float32]) -> None:
        folder.mkdir(exist_ok=True)
        image = np.clip(255.0 * image_rgb[..., ::-1] + 0.5, 0.0, 255.0).astype(np.uint8)
        done, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])
        if not done:
            raise ValueError(f"rendering {index} of shape {image.shape} cannot be encoded")
        (folder / f"{index:04d}.jpg").write_bytes(jpeg.tobytes())

    return keep


class FieldReports:
    """Reports of one trainer.

    Args:
        trainer: Whom to watch.
        reporter: Where the news goes.
        out: Folder that gets ``preview.jpg``.
        images: Pictures in use.

    Attributes:
        images: Pictures in use.
    """

    def __init__(self, trainer: Trainer, reporter: Reporter, out: Path, images: int) -> None:
        self.images = images
        self._trainer = trainer
        self._reporter = reporter
        self._out = out
        self._stage = ""
        self._total_s: float | None = None
        self._begun_s = time.monotonic()
        self._told_s = self._young_s = self._shown_s = self._scored_s = 0.0
        self._wanted = WantedView(reporter.folder)
        self._asked = False
        self._cost_s = self._looked_s = 0.0
        self._watched: list[int] = []
        self._score_db: float | None = None
        self._score_ssim: float | None = None

    def begin(
        self, stage: str, total_s: float | None, watched: list[int], begun_s: float | None = None
    ) -> None:
        """Begin a stage of ``total_s`` seconds, scoring the pictures ``watched`` as it goes on.

        Args:
            stage: Its name.
            total_s: How long it takes, None when nobody knows.
            watched: Held-out pictures.
            begun_s: When it began, by the monotonic clock; None for now.
        """
        self._stage, self._total_s, self._watched = stage, total_s, watched
        self._begun_s = time.monotonic() if begun_s is None else begun_s
        self._told_s = self._begun_s
        self._young_s = self._shown_s = self._scored_s = time.monotonic()
        self._tell(None)

    def on_step(self, step: StepReport) -> None:
        """Take one step's figures; tell, score and show when it is time."""
        now_s = time.monotonic()
        if self._watched and now_s - self._scored_s > self._pause_s(self._scored_s, _SCORE_S):
            self._scored_s = now_s
            self._score_watched()
        if now_s - self._told_s > _REPORT_S:
            self._told_s = now_s
            self._tell(step)
        if now_s - self._looked_s > _LOOK_S:
            self._looked_s = now_s
            self._asked = self._wanted.changed() or self._asked
        pause_s = self._pause_s(self._shown_s, _PREVIEW_S)
        if self._asked:
            pause_s = self._cost_s * (1.0 / _SHOWN_SHARE - 1.0)
        if now_s - self._shown_s > pause_s:
            begun_s = time.monotonic()
            self._show(self._wanted.view)
            self._asked = False
            self._shown_s = time.monotonic()
            self._cost_s = self._shown_s - begun_s

    def _pause_s(self, last_s: float, longest_s: float) -> float:
        """Return how long to wait after ``last_s``: as long as the stage had lasted by then."""
        return min(longest_s, max(_FIRST_S, last_s - self._young_s))

    def show_orbit(self, width: int, height: int) -> None:
        """Render the orbit's present picture into ``preview.jpg`` and announce it."""
        self._show(None, width, height)

    def tell_known(self, seed: int) -> None:
        """Tell what the field knows of the object's surface; nothing while no object is known."""
        box = self._trainer.dataset.object_box
        if box is None:
            return
        known = known_surface(
            self._trainer, box, np.random.default_rng([seed, self._trainer.steps])
        )
        self._reporter.emit(
            "known",
            points=known.points.round(3).tolist(),
            normals=known.normals.round(3).tolist(),
            uncertainty=known.uncertainty.round(3).tolist(),
        )

    def _show(self, wanted: OrbitView | None, width: int = 320, height: int = 240) -> None:
        view = wanted or (time.monotonic() / _ORBIT_S) % 1.0
        preview = render_preview(self._trainer, view, width=width, height=height)
        with drafted(self._out / "preview.jpg") as draft:
            draft.write_bytes(preview.jpeg)
        self._reporter.emit(
            "preview",
            file="preview.jpg",
            view=asdict(preview.view),
            T_world_cam=preview.T_world_cam.tolist(),
            intrinsics=asdict(preview.intrinsics),
        )

    def _score_watched(self) -> None:
        scores = [self._score(index) for index in self._watched]
        alike = [value for _, value in scores if value is not None]
        self._score_db = float(np.mean([db for db, _ in scores]))
        self._score_ssim = float(np.mean(alike)) if alike else None

    def _score(self, index: int) -> tuple[float, float | None]:
        """Return PSNR in dB and SSIM of a picture, None for one too small for it."""
        dataset = self._trainer.dataset
        camera = dataset.intrinsics[index].scaled(_SCORE_SCALE)
        shown = np.clip(self._trainer.render(camera, dataset.T_world_cam[index]).rgb, 0.0, 1.0)
        size = (camera.width, camera.height)
        small = cv2.resize(dataset.images[index], size, interpolation=cv2.INTER_AREA)
        photograph = small.astype(np.float32) / np.float32(255.0)
        alike = None if min(size) < SSIM_WINDOW_PX else ssim(shown, photograph)
        return psnr_db(shown, photograph), alike

    def _tell(self, step: StepReport | None) -> None:
        self._reporter.emit(
            "progressed",
            stage=self._stage,
            step=self._trainer.steps,
            seconds=round(time.monotonic() - self._begun_s, 2),
            seconds_total=self._total_s,
            loss=None if step is None else round(step.loss, 6),
            psnr_db=None if step is None else round(step.psnr_db, 3),
            held_out_psnr_db=None if self._score_db is None else round(self._score_db, 3),
            held_out_ssim=None if self._score_ssim is None else round(self._score_ssim, 4),
            samples_per_s=round(self._trainer.samples_per_s, 1),
            images=self.images,
        )
