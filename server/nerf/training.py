"""Training of the field: one object that steps, renders, judges itself, and is saved."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from server.drafts import whole_file
from server.geometry.cameras import Intrinsics
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import Dataset
from server.nerf.exposure import ExposureGains
from server.nerf.field import initial_parameters, spherical_harmonics
from server.nerf.hull import tight_space
from server.nerf.kernels.cpu_rays import composite
from server.nerf.metrics import PictureScore, mean_metrics, score_picture
from server.nerf.numba_backend import NumbaBackend
from server.nerf.object_part import ObjectPart, object_part
from server.nerf.occupancy import DensityMemory
from server.nerf.optimiser import Adam
from server.nerf.rays import PixelSource, camera_rays
from server.nerf.rendering import Rendering, SampledRays
from server.nerf.sampling import Backend, Samples, sample_rays, visible_part
from server.nerf.space import SceneSpace, contract, scene_space
from server.nerf.torch_backend import TorchBackend
from server.stages import Metrics

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]

# What numba may use at most, asked before anything lowers it.
_CORES = numba.get_num_threads()
# Rays rendered at once; their samples fit the second-level cache.
_RENDER_RAYS = 8192
# Pixels beyond this share of the light are not worth a colour in a rendering.
_RENDER_TRANSMITTANCE = 1e-3
_RENDER_LEAST_WEIGHT = 1e-3
# Once hurried, the remaining schedule passes this many times as fast.
_HURRY_FACTOR = 5.0


@dataclass(frozen=True, slots=True)
class StepReport:
    """What one training step did.

    Attributes:
        step: Steps taken so far, this one included.
        loss: Training loss.
        psnr_db: PSNR of the batch's pixels.
        samples: Points that passed encoding and both MLPs with gradient.
    """

    step: int
    loss: float
    psnr_db: float
    samples: int


@dataclass(frozen=True, slots=True)
class Evaluation:
    """How well pictures are reproduced.

    Attributes:
        metrics: Means.
        pictures: One score per picture.
    """

    metrics: Metrics
    pictures: tuple[PictureScore, ...]


def never() -> bool:
    """Return False: neither stop nor hurry."""
    return False


class Trainer:
    """Trains one field on one dataset.

    Equal dataset, configs, seed, threads and number of steps give the same field; training by
    seconds depends on the machine.

    Attributes:
        dataset: Pictures and cameras.
        space: Where the object's cube lies in the world.

    Args:
        dataset: Posed pictures.
        field: Shape of the field.
        train: How to train.
        held_out: Pictures training must not see.
        backend: ``numba``, or ``torch`` for the slow definition.
        seed: Of every random choice.
        threads: Cores to use; also the number of gradient tables.

    Raises:
        ValueError: If no picture is left for training or ``threads`` is below 1.
    """

    def __init__(
        self,
        dataset: Dataset,
        field: FieldConfig,
        train: TrainConfig,
        *,
        held_out: Sequence[int],
        backend: Literal["numba", "torch"] = "numba",
        seed: int = 0,
        threads: int = 1,
    ) -> None:
        if threads < 1:
            raise ValueError("threads must be at least 1")
        self.dataset = dataset
        found = dataset.cut_out and dataset.object_box is None
        self.space: SceneSpace = tight_space(dataset) if found else scene_space(dataset)
        self._field, self._train = field, train
        self._chunks = threads
        self.use_threads(threads)
        self._rng = np.random.default_rng(seed)
        self._parameters = initial_parameters(field, seed)
        self._adam = Adam(self._parameters, train)
        self._exposure = ExposureGains(len(dataset), train)
        self._backend: Backend
        if backend == "numba":
            self._backend = NumbaBackend(field, self._parameters, len(dataset), threads)
        else:
            self._backend = TorchBackend(field, self._parameters, len(dataset))
        self._step = 0
        self._samples = 0
        self._seconds = 0.0
        self._progress = 0.0
        hidden = set(held_out)
        self.use_pictures([i for i in range(len(dataset)) if i not in hidden])

    @property
    def samples_per_s(self) -> float:
        """Points through encoding and both MLPs with gradient, per second of training."""
        return self._samples / self._seconds if self._seconds > 0.0 else 0.0

    @property
    def steps(self) -> int:
        """Steps taken so far."""
        return self._step

    @property
    def progress(self) -> float:
        """Share of the schedule that is done, 0 to 1."""
        return self._progress

    def use_threads(self, threads: int) -> None:
        """Compute on ``threads`` cores from now on; results do not depend on it."""
        numba.set_num_threads(max(1, min(threads, _CORES)))
        torch.set_num_threads(max(1, threads))

    def use_pictures(self, indices: Sequence[int]) -> None:
        """Train on the pictures ``indices`` from now on.

        Raises:
            ValueError: If ``indices`` is empty.
        """
        self._indices = np.array(sorted(indices), np.int64)
        self._source = PixelSource(
            self.dataset,
            self._indices.tolist(),
            self.space,
            object_share=self._train.object_share,
            surface_share=self._train.surface_share,
            hull_cells=self._train.memory_cells,
        )
        self._background = self._source.mean_colour
        if self.dataset.cut_out:
            # As the pictures were laid on white, renderings are compared on white.
            self._background = np.ones(3, np.float32)
        self._memory = DensityMemory(self._train, self.dataset, self._indices.tolist(), self.space)
        centres = self.space.to_scene(self.dataset.T_world_cam[self._indices, :3, 3])
        self._usual_distance = float(np.median(np.linalg.norm(centres, axis=1)))
        self._near = self._train.near_fraction * self._usual_distance
        if self._step > 0:
            self._memory.refresh(self._densities, self._rng)

    def take_in(self, dataset: Dataset) -> None:
        """Go on with ``dataset``: the pictures there were, as known by now, and new ones behind.

        The field, the optimiser's moments and the scene space stay; all pictures are trained on.

        Raises:
            ValueError: If there are fewer pictures than before.
        """
        if len(dataset) < len(self.dataset):
            raise ValueError(f"{len(self.dataset)} pictures cannot become {len(dataset)}")
        self.dataset = dataset
        self._exposure.grow(len(dataset))
        self._backend.gain_grads = np.zeros(
            (len(self._backend.gain_grads), len(dataset), 3), np.float32
        )
        self.use_pictures(range(len(dataset)))

    def step(self) -> StepReport:
        """Take one training step."""
        began = time.monotonic()
        count, slots = self._train.rays_per_step, self._train.samples_per_ray
        batch = self._source.draw(count, self._rng)
        open_levels = self._open_levels()
        samples = sample_rays(
            self._memory,
            batch.origins,
            batch.directions,
            self._rng.random((count, slots), dtype=np.float32),
            near=self._near,
            bin_length=self._train.bin_length,
            even=self._even_share(),
            chunks=self._chunks,
        )
        backdrops, targets = self._backdrops(count), batch.targets
        if self.dataset.cut_out:
            # White gives way to the same random backdrop that the field is seen against.
            behind = backdrops * self._exposure.gains[batch.pictures] - np.float32(1.0)
            targets += (np.float32(1.0) - batch.alphas)[:, None] * behind
        rays = SampledRays(
            starts=samples.starts,
            points=samples.points,
            ts=samples.ts,
            ss=samples.ss,
            ray_ids=samples.ray_ids,
            trusts=self._trusts(samples.ts),
            dss=samples.dss,
            harmonics=spherical_harmonics(batch.directions, self._field.sh_degree),
            backdrops=backdrops,
            targets=targets,
            pictures=batch.pictures,
            distances=batch.distances,
        )
        loss, square = self._backend.gradients(rays, self._exposure.gains, self._train, open_levels)
        self._adam.step(self._backend.grads, self._progress)
        self._exposure.step(self._backend.gain_grads, self._indices)
        self._step += 1
        due = self._step % self._train.memory_every == 0
        if due and self._step >= self._train.memory_warm_up:
            self._memory.refresh(self._densities, self._rng)
        self._seconds += time.monotonic() - began
        self._samples += len(samples.points)
        return StepReport(
            self._step, loss, -10.0 * float(np.log10(max(square, 1e-10))), len(samples.points)
        )

    def run(
        self,
        seconds: float | None = None,
        steps: int | None = None,
        on_progress: Callable[[StepReport], None] | None = None,
        should_stop: Callable[[], bool] = never,
        hurry: Callable[[], bool] = never,
        progress_from: float = 0.0,
    ) -> StepReport | None:
        """Train for ``seconds`` or ``steps``, whichever is given and ends first.

        The learning rate and the level window follow the share of the time or steps that has
        passed, so a run always ends with a settled field.

        Args:
            seconds: Wall seconds, including those spent in ``on_progress``.
            steps: Steps.
            on_progress: Called after every step.
            should_stop: Asked before every step; True ends the run as it is.
            hurry: Asked before every step; once True, the rest of the schedule passes five times
                as fast: a quick but proper end.
            progress_from: Share of the schedule taken as done, for a field that goes on.

        Returns:
            The last step's report, None when no step was taken.

        Raises:
            ValueError: If neither ``seconds`` nor ``steps`` is given.
        """
        if seconds is None and steps is None:
            raise ValueError("run needs seconds or steps")
        report: StepReport | None = None
        began, first_step = time.monotonic(), self._step
        done, last, speed = 0.0, 0.0, 1.0
        while True:
            now = 0.0
            if seconds is not None:
                now = (time.monotonic() - began) / max(seconds, 1e-9)
            if steps is not None:
                now = max(now, (self._step - first_step) / max(steps, 1))
            if speed == 1.0 and hurry():
                speed = _HURRY_FACTOR
            done, last = done + speed * (now - last), now
            if done >= 1.0 or should_stop():
                return report
            self._progress = progress_from + (1.0 - progress_from) * done
            report = self.step()
            if on_progress is not None:
                on_progress(report)

    @property
    def training_pictures(self) -> list[int]:
        """Pictures that are trained on at present."""
        return self._indices.tolist()

    def densities_at(self, points_world: Array) -> Array:
        """Return the field's densities ``(n,)`` per metre at ``points_world`` ``(n, 3)``.

        Where no picture looks there is nothing to know, and nothing is told to be there.
        """
        scene = self.space.to_scene(points_world)
        u = contract(scene)
        cells = np.minimum(
            (u * len(self._memory.seen)).astype(np.int64), len(self._memory.seen) - 1
        )
        densities = self._densities(u.astype(np.float32)) * self._memory.seen[tuple(cells.T)]
        # A metre is so many path units (``server.nerf.space``).
        return densities / (self.space.half_size * np.maximum(np.abs(scene).max(axis=1), 1.0))

    def object_part(self, cells: int, *, occupied: bool = False) -> ObjectPart:
        """Return where the object may be.

        Args:
            cells: Cells along its longest side.
            occupied: Only where the field was found to hold anything: quicker to render, and what
                is very thin may be missing.
        """
        part = object_part(self.dataset, self.space, cells, len(self._memory.seen))
        return replace(part, coarse=part.coarse & self._memory.occupied()) if occupied else part

    def render(
        self,
        intrinsics: Intrinsics,
        T_world_cam: Array,
        *,
        samples_per_ray: int | None = None,
        only: ObjectPart | None = None,
        background: tuple[float, float, float] | None = None,
    ) -> Rendering:
        """Render the field from a camera; its distortion is applied as in the pictures.

        Args:
            intrinsics: The camera.
            T_world_cam: Its pose ``(4, 4)``.
            samples_per_ray: Fewer are quicker and coarser; None for those of the config.
            only: Which part of the field is shown; None for all.
            background: RGB in [0, 1] behind everything; None for the training's.
        """
        slots = samples_per_ray or self._train.render_samples_per_ray
        origins, directions = camera_rays(intrinsics, T_world_cam, self.space)
        rays = len(origins)
        behind = self._background if background is None else np.array(background, np.float32)
        rgb = np.empty((rays, 3), np.float32)
        depth, opacity = np.empty(rays, np.float32), np.empty(rays, np.float32)
        for start in range(0, rays, _RENDER_RAYS):
            part = slice(start, min(start + _RENDER_RAYS, rays))
            samples = self._visible_samples(origins[part], directions[part], slots, only)
            harmonics = spherical_harmonics(directions[part], self._field.sh_degree)
            sigmas, colours = self._shade(samples, harmonics)
            composite(
                samples.starts, sigmas, colours, samples.ts, samples.dss,
                behind, rgb[part], depth[part], opacity[part],
            )  # fmt: skip
        shape = (intrinsics.height, intrinsics.width)
        depth_m = (depth * self.space.half_size).astype(np.float32)
        return Rendering(rgb.reshape(*shape, 3), depth_m.reshape(shape), opacity.reshape(shape))

    def evaluate(
        self,
        indices: Sequence[int],
        T_world_cam_override: Mapping[int, Array] | None = None,
        on_rendering: Callable[[int, NDArray[np.float32]], None] | None = None,
    ) -> Evaluation:
        """Judge the pictures ``indices`` at training size, without exposure gains.

        Args:
            indices: Pictures.
            T_world_cam_override: Poses to render from instead of the dataset's, by picture.
            on_rendering: Gets each picture's number and its rendering, ``(h, w, 3)`` of 0 to 1.

        Raises:
            ValueError: If ``indices`` is empty.
        """
        poses = T_world_cam_override or {}
        scores: list[PictureScore] = []
        for index in indices:
            pose = poses[index] if index in poses else self.dataset.T_world_cam[index]
            shown = self.render(self.dataset.intrinsics[index], pose).rgb
            if on_rendering is not None:
                on_rendering(index, shown)
            reference = self.dataset.images[index].astype(np.float32) / np.float32(255.0)
            scores.append(score_picture(index, shown, reference, self.dataset.masks[index]))
        return Evaluation(mean_metrics(scores, len(self.dataset)), tuple(scores))

    def save(self, path: Path, *, resumable: bool = False) -> None:
        """Write a checkpoint (numpy archive) that is complete or not there.

        Args:
            path: The file.
            resumable: Also keep the optimiser's moments and the random numbers' state (three times
                the size), so that training goes on as if it had never stopped.

        Raises:
            OSError: If it cannot be written, as on a full disk; nothing is left behind then.
        """
        about = {
            "field": asdict(self._field),
            "train": asdict(self._train),
            "centre": self.space.centre.tolist(),
            "half_size": self.space.half_size,
            "step": self._step,
            "training_pictures": self._indices.tolist(),
        }
        arrays: dict[str, NDArray[Any]] = {
            "densities": self._memory.densities,
            **self._exposure.state(),
            **self._parameters.named(),
        }
        if resumable:
            about |= {
                "random": self._rng.bit_generator.state,
                "progress": self._progress,
                "memory_ready": self._memory.ready,
            }
            arrays |= self._adam.state()
        arrays["about"] = np.array(json.dumps(about))
        with whole_file(path) as stream:
            np.savez(stream, allow_pickle=False, **arrays)

    @classmethod
    def load(
        cls,
        path: Path,
        dataset: Dataset,
        *,
        backend: Literal["numba", "torch"] = "numba",
        seed: int = 0,
        threads: int = 1,
    ) -> Trainer:
        """Return a trainer with the field of a checkpoint; it renders and may go on training.

        Raises:
            ValueError: If the file is no checkpoint, or of a dataset with other pictures.
            OSError: If it cannot be read.
        """
        with np.load(path) as stored:
            if "about" not in stored:
                raise ValueError(f"{path} is not a checkpoint of a field")
            about = json.loads(str(stored["about"]))
            pictures = about["training_pictures"]
            if len(stored["log_gains"]) != len(dataset):
                raise ValueError(f"{path} belongs to a dataset of another size")
            trainer = cls(
                dataset,
                FieldConfig(**about["field"]),
                TrainConfig(**about["train"]),
                held_out=[i for i in range(len(dataset)) if i not in set(pictures)],
                backend=backend,
                seed=seed,
                threads=threads,
            )
            trainer.space = SceneSpace(np.array(about["centre"]), float(about["half_size"]))
            trainer.use_pictures(pictures)
            for name, array in trainer._parameters.named().items():
                array[:] = stored[name]
            trainer._exposure.restore(stored)
            trainer._memory.restore(stored["densities"])
            trainer._step = int(about["step"])
            trainer._progress = float(about.get("progress", 1.0))
            if "random" in about:
                trainer._adam.restore(stored)
                trainer._memory.ready = bool(about["memory_ready"])
                trainer._rng.bit_generator.state = about["random"]
        return trainer

    def _open_levels(self) -> float:
        """Return how many levels of the encoding are in use now (coarse to fine)."""
        levels = self._field.levels
        if self._progress >= self._train.window_until:
            return float(levels)
        share = self._progress / self._train.window_until
        start = min(self._train.window_start, levels)
        return start + (levels - start) * share

    def _even_share(self) -> float:
        """Return the share of samples spread evenly now: all until the memory knows anything."""
        if not self._memory.ready:
            return 1.0
        start, end = self._train.even_share, self._train.even_share_end
        return start + (end - start) * min(self._progress / 0.5, 1.0)

    def _densities(self, points: FloatArray) -> FloatArray:
        return self._backend.densities(points, self._open_levels())

    def _trusts(self, ts: FloatArray) -> FloatArray:
        """Return the gradient factors of samples at distances ``ts`` ``(n,)``."""
        full = self._train.trust_distance * self._usual_distance
        if full == 0.0:
            return np.ones_like(ts)
        return np.minimum(1.0, (ts / np.float32(full)) ** 2).astype(np.float32)

    def _backdrops(self, rays: int) -> FloatArray:
        """Return the colours ``(rays, 3)`` behind everything for one step."""
        noise = np.float32(1.0 if self.dataset.cut_out else self._train.background_noise)
        random = self._rng.random((rays, 3), dtype=np.float32)
        backdrops = noise * random + (np.float32(1.0) - noise) * self._background
        return backdrops.astype(np.float32)

    def _visible_samples(
        self,
        origins: FloatArray,
        directions: FloatArray,
        slots: int,
        only: ObjectPart | None,
    ) -> Samples:
        """Return those of ``slots`` samples per ray that show on some rays of a rendering."""
        samples = sample_rays(
            self._memory,
            origins,
            directions,
            np.full((len(origins), slots), 0.5, np.float32),
            near=self._near,
            bin_length=self._train.bin_length,
            even=self._train.even_share_end,
            chunks=self._chunks,
            only=None if only is None else only.coarse,
        )
        # Rays that meet nothing seen have samples of no length; beside an object alone most do.
        real = np.flatnonzero(samples.dss > 0.0)
        if only is not None:
            real = real[only.holds(samples.points[real])]
        sigmas = np.zeros(len(samples.dss), np.float32)
        if len(real):
            sigmas[real] = self._densities(samples.points[real])
        return visible_part(
            samples,
            sigmas,
            transmittance=_RENDER_TRANSMITTANCE,
            least_weight=_RENDER_LEAST_WEIGHT,
        )

    def _shade(self, samples: Samples, harmonics: FloatArray) -> tuple[FloatArray, FloatArray]:
        if len(samples.points) == 0:
            return np.empty(0, np.float32), np.empty((0, 3), np.float32)
        return self._backend.shade(samples.points, harmonics, samples.ray_ids, self._open_levels())
