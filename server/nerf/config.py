"""Settings of the field and of its training.

Lengths called *scene units* are measured in the scene cube of ``server.nerf.space``: the object's
cube is ``[-1, 1]^3``, everything outside it is contracted into ``[-2, 2]^3``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


def _require(condition: bool, field: str, wish: str) -> None:
    if not condition:
        raise ValueError(f"{field} must be {wish}")


@dataclass(frozen=True, slots=True)
class FieldConfig:
    """Shape of the field (Mueller et al., "Instant Neural Graphics Primitives", 2022, section 3).

    Attributes:
        levels: L, number of grid levels.
        log2_table_size: log2 of T, the most entries one level has.
        features: F, numbers per entry.
        coarsest: N_min, cells per axis of the coarsest level over the whole scene cube.
        finest: N_max, cells per axis of the finest level over the whole scene cube.
        density_width: Hidden units of the density MLP.
        geometry_features: Outputs of the density MLP; the first is the log density.
        colour_width: Hidden units of both hidden layers of the colour MLP.
        sh_degree: Bands of spherical harmonics of the view direction, 1 to 4.
        log_density_bias: Added to the log density, so that an untrained field is thin.
        log_density_max: Upper limit of the log density.

    Raises:
        ValueError: If a value is out of range; the message names it.
    """

    levels: int = 8
    log2_table_size: int = 17
    features: int = 4
    coarsest: int = 16
    finest: int = 1024
    density_width: int = 32
    geometry_features: int = 16
    colour_width: int = 32
    sh_degree: int = 3
    log_density_bias: float = -2.0
    log_density_max: float = 9.0

    def __post_init__(self) -> None:
        _require(1 <= self.levels <= 16, "levels", "1 to 16")
        _require(8 <= self.log2_table_size <= 22, "log2_table_size", "8 to 22")
        _require(1 <= self.features <= 8, "features", "1 to 8")
        _require(2 <= self.coarsest <= self.finest, "coarsest", "at least 2 and at most finest")
        _require(self.finest <= 8192, "finest", "at most 8192")
        _require(8 <= self.density_width <= 128, "density_width", "8 to 128")
        _require(2 <= self.geometry_features <= 64, "geometry_features", "2 to 64")
        _require(8 <= self.colour_width <= 128, "colour_width", "8 to 128")
        _require(1 <= self.sh_degree <= 4, "sh_degree", "1 to 4")
        _require(math.isfinite(self.log_density_bias), "log_density_bias", "finite")
        _require(0.0 < self.log_density_max <= 15.0, "log_density_max", "in (0, 15]")

    @property
    def encoding_width(self) -> int:
        """L F, the number of encoded features of a point."""
        return self.levels * self.features

    @property
    def colour_inputs(self) -> int:
        """Inputs of the colour MLP: geometry features and spherical harmonics."""
        return self.geometry_features + self.sh_degree**2


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """How the field is trained.

    Attributes:
        rays_per_step: Rays per step.
        samples_per_ray: Points with gradient per ray while training.
        render_samples_per_ray: Points per ray of a rendering, before thinning.
        bin_length: Path units per bin of the proposal, fine at the object and coarse far away.
        even_share: Share of the samples that is spread evenly at the start of training.
        even_share_end: The same at its end, and in renderings.
        near_fraction: Rays start at this share of the median camera distance from the object.
        learning_rate: Adam's step for the table after the warm-up.
        mlp_rate_share: Share of it that the MLPs take.
        learning_rate_end: Share of ``learning_rate`` left at the end.
        warm_up_steps: Steps over which the learning rate rises from zero.
        huber_delta: Colour error (0 to 1) beyond which the loss is linear.
        background_noise: Colour behind everything while training: 0 is the pictures' mean colour, 1
            random; noise makes the field opaque, too much of it makes it foggy.
        trust_distance: Gradients of samples nearer to the camera than this share of the median
            camera distance shrink with the square of their distance (Philip and Deschaintre,
            "Floaters No More", 2023); 0 turns that off.
        distortion_weight: Weight of the distortion loss (mip-NeRF 360, equation 15).
        surface_weight: Weight of light not taken at a surface that is known, where there are such.
        surface_reach: How far from it light counts as taken there, share of its distance.
        surface_share: Share of rays drawn towards known surfaces, where there are such.
        mlp_weight_decay: L2 decay per step of the MLPs, share of the learning rate.
        window_start: Levels open at the start, out of L (coarse to fine).
        window_until: Share of the training after which every level is open.
        exposure_rate: Adam's step of the per-picture log gains, 0 turns them off.
        exposure_decay: Pull of the log gains towards 0 per step, share.
        object_share: Share of rays drawn inside object masks, where there are masks.
        memory_cells: Cells per axis of the density memory over the whole scene cube.
        memory_every: Steps between two refreshes of the memory.
        memory_warm_up: Steps before the memory steers samples.

    Raises:
        ValueError: If a value is out of range; the message names it.
    """

    rays_per_step: int = 2048
    samples_per_ray: int = 24
    render_samples_per_ray: int = 16
    bin_length: float = 1.0 / 20.0
    even_share: float = 0.5
    even_share_end: float = 0.1
    near_fraction: float = 0.2
    learning_rate: float = 2e-2
    mlp_rate_share: float = 1.0
    learning_rate_end: float = 0.03
    warm_up_steps: int = 20
    huber_delta: float = 0.1
    background_noise: float = 0.0
    trust_distance: float = 0.8
    distortion_weight: float = 0.003
    surface_weight: float = 0.3
    surface_reach: float = 0.1
    surface_share: float = 0.1
    mlp_weight_decay: float = 1e-4
    window_start: float = 3.0
    window_until: float = 0.3
    exposure_rate: float = 1e-3
    exposure_decay: float = 1e-2
    object_share: float = 0.25
    memory_cells: int = 128
    memory_every: int = 8
    memory_warm_up: int = 16

    def __post_init__(self) -> None:
        for name in (
            "rays_per_step",
            "samples_per_ray",
            "render_samples_per_ray",
            "warm_up_steps",
            "memory_every",
            "memory_warm_up",
        ):
            _require(getattr(self, name) >= 1, name, "at least 1")
        for name in ("learning_rate", "huber_delta", "window_start", "surface_reach"):
            value = getattr(self, name)
            _require(math.isfinite(value) and value > 0.0, name, "positive")
        for name in (
            "near_fraction",
            "learning_rate_end",
            "mlp_rate_share",
            "window_until",
            "object_share",
            "surface_share",
            "background_noise",
            "mlp_weight_decay",
            "exposure_decay",
        ):
            _require(0.0 <= getattr(self, name) <= 1.0, name, "in [0, 1]")
        for name in ("distortion_weight", "surface_weight", "exposure_rate", "trust_distance"):
            _require(0.0 <= getattr(self, name) < math.inf, name, "zero or more")
        for name in ("even_share", "even_share_end"):
            _require(0.0 < getattr(self, name) <= 1.0, name, "in (0, 1]")
        _require(1.0 / 64.0 <= self.bin_length <= 0.5, "bin_length", "in [1/64, 1/2]")
        _require(8 <= self.memory_cells <= 256, "memory_cells", "8 to 256")


def suited_configs(
    *, cut_out: bool, distances_known: bool = False
) -> tuple[FieldConfig, TrainConfig]:
    """Return the shape of a field and its training for a room, or for an object cut out of it.

    Where distances of surfaces are known, a room needs no other help against fog: beginning with
    coarse levels and the distortion loss cost more than they give then.

    An object alone fills few cells of its visual hull: smaller tables stay in the processor's
    cache, and fewer samples meet all of it, spread more evenly than in a room. The hull already
    keeps fog away, so beginning with coarse levels and the distortion loss cost more than they
    give. Against random backdrops fast MLPs turn all colours black before there is anything to
    see, from which they come back late or never.
    """
    if not cut_out and distances_known:
        return FieldConfig(), TrainConfig(window_until=0.0, distortion_weight=0.0)
    if not cut_out:
        return FieldConfig(), TrainConfig()
    return FieldConfig(log2_table_size=15), TrainConfig(
        samples_per_ray=16,
        render_samples_per_ray=32,
        mlp_rate_share=0.25,
        even_share=1.0,
        even_share_end=0.5,
        window_until=0.0,
        distortion_weight=0.0,
    )
