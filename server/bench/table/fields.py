"""One mode's field: trained on its pictures, judged on the test views.

Test views are known in the true world, a field lives in the frame of its poses: the similarity
between the camera centres carries them there, then each settles on the field
(``server.nerf.photometric_fit``) in a few steps, alike for all modes.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.bench.poses_figures import into_frame_of
from server.bench.table.modes import Posed
from server.bench.table.views import HeldOutViews
from server.nerf.config import suited_configs
from server.nerf.metrics import PictureScore, score_picture
from server.nerf.photometric_fit import RenderRgb, fit_pose
from server.nerf.training import Trainer

Array = NDArray[np.float64]
Image = NDArray[np.float32]

FIGURES = ("psnr_db", "ssim", "flip", "psnr_db_object")
# Gauss-Newton steps, each worth many of a gradient descent. With more of them views wander off
# on a poor field, whose pictures nothing holds in place.
_SETTLING_STEPS, _SETTLED_GAIN = 6, 1e-2


@dataclass(frozen=True, slots=True, eq=False)
class JudgedField:
    """How well a field shows what it was not trained on.

    Attributes:
        scores: One per test view.
        shown: Its renderings of the test views ``(h, w, 3)``, RGB in [0, 1].
        settled_deg: How far each test view turned to settle, degrees.
        train_s: Wall seconds of its training.
    """

    scores: tuple[PictureScore, ...]
    shown: tuple[Image, ...]
    settled_deg: tuple[float, ...]
    train_s: float

    def per_view(self) -> dict[str, list[float | None]]:
        """Return every figure of every test view, None where the object is not in it."""
        told = [asdict(score) for score in self.scores]
        return {
            name: [None if one[name] is None else round(one[name], 4) for one in told]
            for name in FIGURES
        }


def train_and_judge(
    posed: Posed, views: HeldOutViews, *, steps: int, seed: int, threads: int
) -> JudgedField:
    """Train a field for ``steps`` steps on the pictures a mode uses, and judge it on ``views``."""
    dataset = posed.dataset
    field, train = suited_configs(cut_out=dataset.cut_out, distances_known=dataset.distances_known)
    unused = [i for i in range(len(dataset)) if i not in posed.used]
    trainer = Trainer(dataset, field, train, held_out=unused, seed=seed, threads=threads)
    begun_s = time.monotonic()
    trainer.run(steps=steps)
    train_s = time.monotonic() - begun_s
    scores, shown, settled_deg = judge(
        lambda camera, T: trainer.render(camera, T).rgb, trainer.space.centre, posed, views
    )
    return JudgedField(scores, shown, settled_deg, train_s)


def judge(
    render: RenderRgb, centre: Array, posed: Posed, views: HeldOutViews
) -> tuple[tuple[PictureScore, ...], tuple[Image, ...], tuple[float, ...]]:
    """Return scores and renderings of ``views``, and by how many degrees each turned to settle.

    Args:
        render: Returns the field's picture of a camera and a pose in the field's frame.
        centre: The object's middle ``(3,)`` in that frame.
        posed: What the field was trained on: says where its frame lies in the world.
        views: The test views.
    """
    used = posed.used
    carried = into_frame_of(posed.dataset.T_world_cam[used], posed.T_true[used], views.T_world_cam)
    scores: list[PictureScore] = []
    shown: list[Image] = []
    turned: list[float] = []
    for number, (image, mask, pose) in enumerate(
        zip(views.images_rgb, views.masks, carried, strict=True)
    ):
        settled = fit_pose(
            render,
            image,
            views.camera,
            pose,
            centre,
            steps=_SETTLING_STEPS,
            least_gain=_SETTLED_GAIN,
        )
        rgb = np.clip(render(views.camera, settled), 0.0, 1.0)
        scores.append(score_picture(number, rgb, image.astype(np.float32) / 255.0, mask))
        shown.append(rgb)
        turn = Rotation.from_matrix(pose[:3, :3].T @ settled[:3, :3]).magnitude()
        turned.append(float(np.rad2deg(turn)))
    return tuple(scores), tuple(shown), tuple(turned)
