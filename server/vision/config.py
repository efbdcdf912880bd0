"""Every number the eyes may be tuned with; validated where it is made."""

from __future__ import annotations

from dataclasses import dataclass, field, fields


def _require(condition: bool, name: str, rule: str) -> None:
    if not condition:
        raise ValueError(f"{name} {rule}")


def _require_positive(config: object) -> None:
    """Raise ValueError naming the first numeric field of ``config`` that is not above zero."""
    for each in fields(config):  # type: ignore[arg-type]
        value = getattr(config, each.name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            _require(value > 0, each.name, f"must be above zero, got {value}")


@dataclass(frozen=True, slots=True)
class RegionConfig:
    """How the object's region is found in one picture.

    Attributes:
        work_scale: Full-picture pixels per working pixel; 4 searches a 960x720 picture at 240x180.
        sigma_min_px: Smallest blob scale searched, working pixels.
        sigma_max_px: Largest blob scale searched, working pixels.
        scales_per_octave: Scales per doubling of sigma.
        chroma_weight: Weight of the a and b channels against L in the response's magnitude; above
            one because shading and light change L most.
        min_response: Smallest response of a blob that counts, in (weighted) Lab units.
        candidates: How many blobs are considered for the object.
        size_exponent: How strongly a larger sigma wins over a stronger response.
        prior_sigma_px: Standard deviation of the object's place when nothing is known, as a share
            of the picture's width, around the picture's centre.
        histogram_bins: Bins per Lab channel of the colour model.
        refine_iterations: GrabCut iterations of a refined mask.
        key_s: A tracked object is searched anew this long after the last search, seconds.
        refollow_s: Where following failed, a search waits this long after the last one, seconds.
        retry_s: An object that is not seen is searched for this often, seconds.
        min_area_share: Smallest mask accepted, share of the picture.
        max_area_share: Largest mask accepted, share of the picture.
        min_confidence: Below this a region counts as nothing.
    """

    work_scale: int = 4
    sigma_min_px: float = 4.0
    sigma_max_px: float = 48.0
    scales_per_octave: int = 3
    chroma_weight: float = 1.5
    min_response: float = 3.0
    candidates: int = 12
    size_exponent: float = 0.7
    prior_sigma_px: float = 0.25
    histogram_bins: int = 16
    refine_iterations: int = 2
    key_s: float = 1.0
    refollow_s: float = 0.25
    retry_s: float = 0.5
    min_area_share: float = 0.002
    max_area_share: float = 0.6
    min_confidence: float = 0.05

    def __post_init__(self) -> None:
        _require_positive(self)
        _require(self.sigma_max_px > self.sigma_min_px, "sigma_max_px", "must exceed sigma_min_px")
        _require(
            self.max_area_share <= 1.0 and self.max_area_share > self.min_area_share,
            "max_area_share",
            "must lie between min_area_share and 1",
        )
        _require(4 <= self.histogram_bins <= 64, "histogram_bins", "must lie between 4 and 64")


@dataclass(frozen=True, slots=True)
class SeedConfig:
    """How views become the crude geometry of the object.

    Attributes:
        slices: Most boxes the object is cut into.
        min_views: Fewest views that are combined.
        pair_min_rad: Two views are an orthogonal pair from this angle between their directions on,
            radians; and up to pi minus it.
        agreement: Share of the views that see a place whose boxes must hold it to be the object.
        centroid_share: Standard deviation of a box's centre about the object's, as a share of the
            box's larger side.
        unsure_views: Of so few views none is believed that nothing is above what it shows; of more
            all are, by one minus this over their number.
        shape_doubt: For the boxes inside the outer one, the regions' shapes must hold a place to be
            the object by all votes but this share divided by the root of their number.
        closing_share: Gaps in a region's shape are closed up to this share of its size; from 1 on
            the shape is its convex hull.
        tolerance_px: A region's border may be wrong by this much, full-picture pixels.
        fade_share: Farther out a view's vote fades to nothing within this share of its box's
            larger side.
        least_agreement: Fewest votes of the regions' shapes ever asked for, as a share.
        least_piece: Loose pieces below this share of the largest are dropped.
        least_saved: A cut must free this share of the object's volume.
        voxels: Cells along each axis of the carved space.
        margin_m: The faces of the outer box are moved outwards by this much, metres.
        min_size_m: Smallest edge of any box, metres.
        max_miss_m: Largest median distance between the views' rays and their common centre, metres;
            beyond it the views do not look at the same thing.
    """

    slices: int = 12
    min_views: int = 2
    pair_min_rad: float = 0.785
    agreement: float = 0.75
    centroid_share: float = 0.1
    unsure_views: float = 4.0
    shape_doubt: float = 0.1
    closing_share: float = 1.0
    tolerance_px: float = 4.0
    fade_share: float = 0.1
    least_agreement: float = 0.5
    least_piece: float = 0.05
    least_saved: float = 0.01
    voxels: int = 40
    margin_m: float = 0.01
    min_size_m: float = 0.03
    max_miss_m: float = 0.8

    def __post_init__(self) -> None:
        _require_positive(self)
        _require(self.min_views >= 2, "min_views", "must be at least 2")
        _require(self.pair_min_rad < 1.5707, "pair_min_rad", "must be below a right angle")
        for name in ("agreement", "least_agreement", "least_piece", "least_saved"):
            _require(getattr(self, name) <= 1.0, name, "must be at most 1")
        _require(self.shape_doubt < 1.0, "shape_doubt", "must be below 1")
        _require(self.voxels >= self.slices, "voxels", "must be at least slices")


@dataclass(frozen=True, slots=True)
class ArrangementConfig:
    """When the outlines say that the drones stand in another order than was assumed.

    Attributes:
        cells: Cells along each axis of the cube that is carved.
        cube: Side of that cube, in sizes of the largest box.
        grid: Cells along each side of an outline.
        least_gain: Another order must fill this much more of the outlines than the assumed one.
        tie: Orders that fill less than the best one by no more than this are as likely.
        spread_rad: Neighbours must stand this far apart at least, as seen from the object, radians.
    """

    cells: int = 36
    cube: float = 1.3
    grid: int = 20
    least_gain: float = 0.12
    tie: float = 0.06
    spread_rad: float = 0.8

    def __post_init__(self) -> None:
        _require_positive(self)
        _require(self.tie < self.least_gain < 1.0, "least_gain", "must lie between tie and 1")
        _require(self.spread_rad < 1.5707, "spread_rad", "must be below a right angle")


@dataclass(frozen=True, slots=True)
class AgreementConfig:
    """When the drones' regions are of one object.

    Attributes:
        gate: A view disagrees beyond this many standard deviations.
        centroid_share: Standard deviation of a box's centre about the object's, as a share of the
            box's larger side: the box's centre differs from side to side.
        cut_off_share: The same of a box that the picture's edge cuts off.
        floor_m: Standard deviation of a ray's place that no pose is better than, metres.
        distance_m: Assumed distance of the object where the views have no point in common, metres.
        size_log_sigma: Standard deviation of the logarithm of a box's height in metres.
        arrangement: Whether the drones stand in the assumed order.
    """

    gate: float = 3.0
    centroid_share: float = 0.1
    cut_off_share: float = 0.5
    floor_m: float = 0.03
    distance_m: float = 2.0
    size_log_sigma: float = 0.2
    arrangement: ArrangementConfig = field(default_factory=ArrangementConfig)

    def __post_init__(self) -> None:
        _require_positive(self)


@dataclass(frozen=True, slots=True)
class LocalizationConfig:
    """What the pose filter believes about the drone, its sensors and the object.

    Attributes:
        start_position_sigma_m: How well the start place is known, per horizontal axis, metres.
        start_height_m: Height of the camera above the floor when the drone stands on it, metres.
        start_height_sigma_m: How well that is known, metres.
        start_yaw_sigma_rad: How well the start heading is known, radians.
        velocity_sigma_m_s: White error of a reported velocity (quantisation and noise), m/s.
        unfelt_sigma_m_s: How fast a drone drifts that does not feel its velocity, per axis, m/s.
        velocity_bias_m_s: Slowly changing error of the reported velocity, m/s.
        velocity_bias_tau_s: Correlation time of that error, seconds.
        velocity_scale_sigma: Share by which a drone's reported speeds are wrong all the time.
        velocity_lag_s: How far reported velocities may lag behind, seconds.
        yaw_sigma_rad: Error of one reported yaw (one-degree steps), radians.
        yaw_drift_rad_sqrt_s: Random walk of the reported yaw, radians per root second.
        yaw_bias_rad_s: How fast the reported yaw may drift all the time, radians per second.
        height_sigma_m: How near the height is to the middle of a reported 10 cm step, metres.
        tof_sigma_m: White error of the distance sensor, metres.
        tof_bias_m: Error of its zero, metres.
        tof_offset_m: Camera height minus the distance sensor's reading, metres.
        box_sigma_rad: White error of the box centroid's direction, radians.
        box_bias_rad: Slowly changing error of it (the box's centroid is not the object's centre,
            and differs from side to side), radians.
        box_bias_tau_s: Correlation time of that error, seconds.
        size_sigma: White relative error of the apparent height.
        size_bias: Slowly changing relative error of it.
        attitude_share: Share of the reported pitch and roll that the stabilised video shows.
        gate: Squared Mahalanobis distance per degree of freedom beyond which a box is refused.
        height_gate: The same of a reported height; wider, for of these nearly all are right.
        max_extrapolation_s: How far from the newest report a pose is extrapolated, seconds.
        target_sigma_m: How near the object stands to the world's origin, per axis, metres.
        target_height_m: Height of the object's centre above the floor before it was seen, metres.
        target_height_sigma_m: How well that is known, metres.
        object_height_m: Height of the object before it was seen, metres.
        object_height_log_sigma: How well its logarithm is known.
    """

    start_position_sigma_m: float = 0.12
    start_height_m: float = 0.03
    start_height_sigma_m: float = 0.03
    start_yaw_sigma_rad: float = 0.2
    velocity_sigma_m_s: float = 0.05
    unfelt_sigma_m_s: float = 0.15
    velocity_bias_m_s: float = 0.02
    velocity_bias_tau_s: float = 3.0
    velocity_scale_sigma: float = 0.05
    velocity_lag_s: float = 0.1
    yaw_sigma_rad: float = 0.012
    yaw_drift_rad_sqrt_s: float = 0.0025
    yaw_bias_rad_s: float = 0.0003
    height_sigma_m: float = 0.05
    tof_sigma_m: float = 0.03
    tof_bias_m: float = 0.05
    tof_offset_m: float = 0.0
    box_sigma_rad: float = 0.03
    box_bias_rad: float = 0.15
    box_bias_tau_s: float = 8.0
    size_sigma: float = 0.12
    size_bias: float = 0.7
    attitude_share: float = 0.3
    gate: float = 4.0
    height_gate: float = 9.0
    max_extrapolation_s: float = 0.5
    target_sigma_m: float = 0.3
    target_height_m: float = 0.45
    target_height_sigma_m: float = 0.4
    object_height_m: float = 0.8
    object_height_log_sigma: float = 0.7

    def __post_init__(self) -> None:
        offset = self.tof_offset_m
        _require(-0.5 < offset < 0.5, "tof_offset_m", f"must lie within half a metre, got {offset}")
        share = self.attitude_share
        _require(0.0 <= share <= 1.0, "attitude_share", f"must lie between 0 and 1, got {share}")
        for each in fields(self):
            if each.name not in ("tof_offset_m", "attitude_share"):
                value = getattr(self, each.name)
                _require(value > 0, each.name, f"must be above zero, got {value}")


@dataclass(frozen=True, slots=True)
class VisionConfig:
    """All of the eyes' settings.

    Attributes:
        region: Finding the object in a picture.
        seed: Combining views.
        agreement: Whether views are of one object.
        localization: Poses of drones and object.
    """

    region: RegionConfig = field(default_factory=RegionConfig)
    seed: SeedConfig = field(default_factory=SeedConfig)
    agreement: AgreementConfig = field(default_factory=AgreementConfig)
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
