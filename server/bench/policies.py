"""``dronerf bench policies``: rules of choosing where to look next, against each other.

Every course begins with the mission's own four seed views and what its eyes make of them, and ends
with 24 pictures, drawn at true poses in the default room. ``annealed`` plans the other twenty at
once, as the mission does; the others choose four at a time beside what was taken: ``annealed``
again, ``farthest``, and ``uncertain``, which trains a field on the pictures so far and asks it what
it knows least. Judged are the pictures on the true mesh, as in ``bench planner``, and a field
trained afresh on all of them on views that nobody chose: test views even around the object.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.bench.options import Figures, Options, each_scene
from server.bench.planner_judge import Judge
from server.bench.seed_figures import DRONES, fitted_after, seen_by_mission
from server.bench.table.views import draw_views
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import yaw_of_camera
from server.nerf.config import suited_configs
from server.nerf.dataset import Dataset
from server.nerf.sightings import nothing_known
from server.nerf.training import Trainer
from server.nerf.uncertainty import known_surface
from server.planner.config import PlannerConfig
from server.planner.mission_plan import plan_mission
from server.planner.policies import SurfaceUncertainty, uncertainty_near
from server.sim.scenes.catalogue import load_object
from server.sim.world import World
from server.stages import CameraPose, SeedGeometry, Viewpoint
from server.vision.config import SeedConfig

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

QUICK_SCENES = ("robot_dog",)
# Policy, and whether it chooses by rounds.
RULES = {
    "annealed": ("annealed", False),
    "annealed_by_rounds": ("annealed", True),
    "farthest_by_rounds": ("farthest", True),
    "uncertain_by_rounds": ("uncertain", True),
}
_ROUNDS = 5
_CAMERA = TELLO_INTRINSICS.scaled(0.5)
_SUPERSAMPLE = 2
_TEST_VIEWS = 16
# About what one of two cores manages while four drones fly a round.
_LIVE_STEPS, _LIVE_PROGRESS = 200, 0.35
_STEPS, _QUICK_STEPS = 800, 300
_SAMPLES = 3000


@dataclass(frozen=True, slots=True, eq=False)
class _Picture:
    """What was taken.

    Attributes:
        image_rgb: ``(h, w, 3)`` uint8.
        mask: Where the object is in it ``(h, w)``. The true silhouette, for every rule alike: what
            the eyes would find is measured elsewhere.
    """

    image_rgb: Image
    mask: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class _Course:
    """One scene, ready for any rule.

    Attributes:
        world: Draws the pictures.
        seed: What the eyes made of the seed views.
        starts: The seed views.
        rng_seed: Of everything random.
    """

    world: World
    seed: SeedGeometry
    starts: tuple[Viewpoint, ...]
    rng_seed: int

    def picture(self, view: Viewpoint) -> _Picture:
        """Return the picture from ``view``."""
        image = np.ascontiguousarray(self.world.render(_pose(view))[:, :, ::-1])
        return _Picture(image, self.world.silhouette(_pose(view)))


def run(options: Options) -> Figures:
    """Measure every scene."""
    scenes = each_scene("policies", options, lambda scene: _measure(scene, options))
    means: dict[str, Any] = {
        rule: {
            name: float(np.mean([part[rule][name] for part in scenes.values()]))
            for name in next(iter(scenes.values()))[rule]
        }
        for rule in RULES
    }
    return Figures(scenes, means)


def _measure(scene: str, options: Options) -> dict[str, Any]:
    model = load_object(scene)
    (seen,) = seen_by_mission(model, options.seed, rounds=0)
    fitted = fitted_after([seen], SeedConfig())
    if fitted is None:
        raise RuntimeError(f"{scene}: the seed views give no seed geometry")
    starts = tuple(
        Viewpoint(view.pose.position_world, yaw_of_camera(view.pose.T_world_cam))
        for view in seen.views
    )
    judge = Judge(model, _SAMPLES, options.seed)
    test = draw_views(model, options.seed, _TEST_VIEWS)
    world = World(model, intrinsics=_CAMERA, supersample=_SUPERSAMPLE, seed=options.seed)
    figures: dict[str, Any] = {}
    try:
        course = _Course(world, fitted, starts, options.seed)
        for rule, (policy, by_rounds) in RULES.items():
            begun_s = time.monotonic()
            field = _LiveField(course, options.threads) if policy == "uncertain" else None
            views = _choose(course, policy, field, by_rounds=by_rounds)
            seconds = time.monotonic() - begun_s
            pictures = [course.picture(view) for view in views]
            sights = judge.look(views)
            everything = list(range(len(views)))
            steps = _QUICK_STEPS if options.quick else _STEPS
            figures[rule] = {
                "visibility": sights.visibility(everything),
                "visibility_two_views": sights.visibility(everything, 2),
                "detail_visibility": sights.detail(everything),
                "choosing_seconds": round(seconds, 1),
            }
            if field is not None:
                figures[rule]["known_places"] = float(np.mean(field.places))
            figures[rule] |= _field(
                _dataset(views, pictures, course.seed), test.images_rgb, test.masks,
                test.T_world_cam, steps, options,
            )  # fmt: skip
    finally:
        world.close()
    return figures


def _choose(
    course: _Course, policy: str, field: _LiveField | None, *, by_rounds: bool
) -> list[Viewpoint]:
    """Return the seed views and the twenty that a policy adds to them."""
    views = list(course.starts)
    config = replace(PlannerConfig(), policy=policy)
    for number in range(_ROUNDS if by_rounds else 1):
        knows = None if field is None else field.after(views)
        crew = views[-len(course.starts) :]
        poses = {
            f"drone-{k}": CameraPose(f"drone-{k}", 0.0, _pose(view), np.eye(4) * 0.01)
            for k, view in enumerate(crew)
        }
        # The same number of pictures for every rule, however many seed views showed something.
        wanted = DRONES if by_rounds else DRONES * _ROUNDS
        placement, _ = plan_mission(
            course.seed,
            TELLO_INTRINSICS,
            TELLO_TILT_RAD,
            poses,
            -(-wanted // len(poses)),
            config,
            course.rng_seed + number,
            uncertainty=knows,
            taken=views,
            pictures=wanted,
        )
        views += list(placement.viewpoints)[-wanted:]
    return views


class _LiveField:
    """The field that trains beside a flight, as the mission's reconstruction does.

    Attributes:
        places: After each round, of how many places on a surface it had anything to say.
    """

    def __init__(self, course: _Course, threads: int) -> None:
        self._course = course
        self._threads = threads
        self._pictures: list[_Picture] = []
        self.places: list[int] = []
        self._trainer: Trainer | None = None
        self._rng = np.random.default_rng(course.rng_seed)

    def after(self, views: Sequence[Viewpoint]) -> SurfaceUncertainty:
        """Train on the pictures from all ``views`` and return what is known."""
        self._pictures += [self._course.picture(view) for view in views[len(self._pictures) :]]
        dataset = _dataset(views, self._pictures, self._course.seed)
        if self._trainer is None:
            self._trainer = _trainer(dataset, [], self._course.rng_seed, self._threads)
            self._trainer.run(steps=_LIVE_STEPS)
        else:
            self._trainer.take_in(dataset)
            self._trainer.run(steps=_LIVE_STEPS, progress_from=_LIVE_PROGRESS)
        known = known_surface(self._trainer, self._course.seed.outer, self._rng)
        self.places.append(len(known.points))
        return uncertainty_near(known.points, known.normals, known.uncertainty)


def _field(
    dataset: Dataset,
    test_images: Sequence[Image],
    test_masks: Sequence[NDArray[np.bool_]],
    T_test: Array,
    steps: int,
    options: Options,
) -> dict[str, float]:
    """Return how well a field trained on ``dataset`` shows the test views."""
    count, more = len(dataset), len(test_images)
    both = replace(
        dataset,
        files=(*dataset.files, *(Path(f"test-{k}.png") for k in range(more))),
        images=(*dataset.images, *test_images),
        masks=(*dataset.masks, *test_masks),
        alphas=(None,) * (count + more),
        intrinsics=(_CAMERA,) * (count + more),
        T_world_cam=np.concatenate([dataset.T_world_cam, T_test]),
        known=(nothing_known(),) * (count + more),
    )
    held_out = list(range(count, count + more))
    trainer = _trainer(both, held_out, options.seed, options.threads)
    trainer.run(steps=steps)
    scores = trainer.evaluate(held_out).pictures
    on_object = [score.psnr_db_object for score in scores if score.psnr_db_object is not None]
    return {
        "psnr_db": float(np.mean([score.psnr_db for score in scores])),
        "psnr_db_object": float(np.mean(on_object)),
        "psnr_db_object_worst": float(np.min(on_object)),
    }


def _trainer(dataset: Dataset, held_out: list[int], seed: int, threads: int) -> Trainer:
    field, train = suited_configs(cut_out=False, distances_known=False)
    return Trainer(dataset, field, train, held_out=held_out, seed=seed, threads=threads)


def _dataset(
    views: Sequence[Viewpoint], pictures: Sequence[_Picture], seed: SeedGeometry
) -> Dataset:
    count = len(views)
    return Dataset(
        Path("."),
        tuple(Path(f"{k:04d}.png") for k in range(count)),
        tuple(picture.image_rgb for picture in pictures),
        tuple(picture.mask for picture in pictures),
        (None,) * count,
        (_CAMERA,) * count,
        np.stack([_pose(view) for view in views]),
        seed.outer,
        None,
        (nothing_known(),) * count,
    )


def _pose(view: Viewpoint) -> Array:
    return view.T_world_cam(TELLO_TILT_RAD)
