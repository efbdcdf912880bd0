"""Events into wire messages: the one place where the two vocabularies meet."""

from __future__ import annotations

import base64
import math
from dataclasses import asdict
from datetime import datetime
from typing import Any, Literal, assert_never, cast

from pydantic import BaseModel

from server.api import messages
from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    CommandChanged,
    DroneReported,
    Event,
    FailsafeFired,
    FrameAnnotated,
    MetricsMeasured,
    NoGoChanged,
    NoGoVolume,
    Noted,
    ObjectPointedOut,
    PictureMarks,
    PlanFound,
    PlanProgressed,
    PlanViewChosen,
    PoseEstimated,
    PosesRefined,
    PreviewRendered,
    PrioritiesChanged,
    PriorityPart,
    SeedFitted,
    SurfaceSeen,
    TrainingProgressed,
    ViewsDisagree,
)

CaptureState = Literal[
    "queued", "running", "paused", "succeeded", "failed", "aborted", "interrupted"
]
FailsafeAction = Literal["hold", "land", "land_all", "cut"]


def message_from_event(event: Event) -> BaseModel | None:
    """Return the wire message of ``event``; None for what travels as tiles or in the 3D scene."""
    match event:
        case FrameAnnotated() | PoseEstimated():
            return None
        case DroneReported():
            return _drone(event)
        case CaptureChanged():
            return _capture(event)
        case TrainingProgressed():
            return _training(event)
        case SeedFitted() | SurfaceSeen() | PlanProgressed() | PlanFound():
            return _planning(event)
        case CaptureTaken():
            return messages.PictureReport(
                at=_iso(event.at),
                index=event.capture.index,
                round_index=event.capture.round_index,
                drone_id=event.capture.pose.drone_id,
                thumbnail=_data_url(event.thumbnail_jpeg),
                sharpness=event.capture.sharpness,
                damaged_before=event.capture.damaged_before,
            )
        case PosesRefined():
            return messages.PosesReport(
                at=_iso(event.at),
                images=len(event.refined),
                refined=int(event.refined.sum()),
                unrefined=[index for index, done in enumerate(event.refined) if not done],
            )
        case PreviewRendered():
            return messages.PreviewReport(
                at=_iso(event.at), image=_data_url(event.jpeg), **asdict(event.view)
            )
        case MetricsMeasured():
            return _metrics(event)
        case FailsafeFired():
            return _failsafe(event)
        case ObjectPointedOut() | ViewsDisagree() | PrioritiesChanged() | NoGoChanged():
            return _shown(event)
        case PlanViewChosen():
            return messages.PlanView(at=_iso(event.at), shown=event.shown)
        case CommandChanged():
            return messages.CommandReport(
                at=_iso(event.at), holder=event.holder, asking=event.asking
            )
        case Noted():
            return messages.Note(
                at=_iso(event.at), level=event.level, text=event.text, drone_id=event.drone_id
            )
        case _:
            assert_never(event)


def _iso(at: datetime) -> str:
    return at.isoformat()


def _data_url(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode("ascii")


def _drone(event: DroneReported) -> messages.DroneReport:
    return messages.DroneReport(
        at=_iso(event.at),
        drone_id=event.drone_id,
        name=event.name,
        colour=event.colour,
        activity=event.activity,
        held=event.held,
        battery_pct=event.battery_pct,
        temperature_c=event.temperature_c,
        height_m=event.height_m,
        speed_m_s=event.speed_m_s,
        state_age_s=event.state_age_s,
        video_age_s=event.video_age_s,
        video_fps=event.video_fps,
        position_sigma_m=event.position_sigma_m,
        video_wanted=event.video_wanted,
        link_age_s=event.link_age_s,
        object_age_s=event.object_age_s,
        velocity_age_s=event.velocity_age_s,
    )


def _capture(event: CaptureChanged) -> messages.CaptureReport:
    return messages.CaptureReport(
        at=_iso(event.at),
        id=event.id,
        # The event's state is a plain word; the message checks that it is one of ours.
        state=cast(CaptureState, event.state),
        phase=event.phase,
        progress=event.progress,
        eta_s=event.eta_s,
        run=event.run,
        error=event.error,
        mode=event.mode,
        round_index=event.round_index,
        rounds=event.rounds,
        images=event.images,
        images_total=event.images_total,
        commanded=event.commanded,
        entered=dict(event.entered),
    )


def _training(event: TrainingProgressed) -> messages.TrainingReport:
    return messages.TrainingReport(
        at=_iso(event.at),
        stage=event.stage,
        step=event.step,
        seconds=event.seconds,
        seconds_total=event.seconds_total,
        loss=event.loss,
        psnr_db=event.psnr_db,
        held_out_psnr_db=event.held_out_psnr_db,
        held_out_ssim=event.held_out_ssim,
        samples_per_s=event.samples_per_s,
        images=event.images,
    )


def _planning(event: SeedFitted | SurfaceSeen | PlanProgressed | PlanFound) -> BaseModel:
    match event:
        case SeedFitted():
            outer = event.seed.outer
            return messages.SeedReport(
                at=_iso(event.at),
                centre=[float(value) for value in outer.centre],
                size=[float(value) for value in outer.size],
                boxes=len(event.seed.boxes),
                views=event.seed.views,
            )
        case SurfaceSeen():
            return messages.CoverageReport(
                at=_iso(event.at),
                share_once=event.coverage.once,
                share_thrice=event.coverage.thrice,
            )
        case PlanProgressed():
            return messages.PlanProgress(
                at=_iso(event.at),
                iteration=event.iteration,
                iterations=event.iterations,
                temperature=event.temperature,
                fitness=event.fitness,
            )
        case PlanFound():
            return messages.PlanReport(
                at=_iso(event.at),
                fitness=event.placement.fitness,
                terms={name: float(value) for name, value in event.placement.terms.items()},
                candidates=event.placement.candidates,
                viewpoints=len(event.placement.viewpoints),
                bound=event.placement.bound,
            )
        case _:
            assert_never(event)


def _metrics(event: MetricsMeasured) -> messages.MetricsReport:
    metrics = event.metrics
    return messages.MetricsReport(
        at=_iso(event.at),
        images=metrics.images,
        images_held_out=metrics.images_held_out,
        psnr_db=metrics.psnr_db,
        ssim=metrics.ssim,
        flip=metrics.flip,
        psnr_db_object=metrics.psnr_db_object,
    )


def _shown(
    event: ObjectPointedOut | ViewsDisagree | PrioritiesChanged | NoGoChanged,
) -> BaseModel:
    match event:
        case ObjectPointedOut():
            box = None if event.box is None else [float(share) for share in event.box]
            return messages.PickReport(at=_iso(event.at), drone_id=event.drone_id, box=box)
        case ViewsDisagree():
            return messages.DisagreementReport(
                at=_iso(event.at), drone_ids=list(event.drone_ids), reason=event.reason
            )
        case PrioritiesChanged():
            parts = [view_from_part(part) for part in event.parts]
            return messages.PrioritiesReport(at=_iso(event.at), parts=parts)
        case NoGoChanged():
            volumes = [view_from_no_go(volume) for volume in event.volumes]
            return messages.NoGoReport(at=_iso(event.at), volumes=volumes)
        case _:
            assert_never(event)


def view_from_no_go(volume: NoGoVolume) -> messages.NoGoVolume:
    """Return what the console tells about a no-go volume."""
    return messages.NoGoVolume(id=volume.id, area=list(volume.area), configured=volume.configured)


def view_from_part(part: PriorityPart) -> messages.PriorityPart:
    """Return what the console tells about a part of priority."""
    box = part.box
    return messages.PriorityPart(
        id=part.id,
        drone_id=part.drone_id,
        drawn=[float(share) for share in part.drawn],
        weight=part.weight,
        centre=None if box is None else [float(value) for value in box.centre],
        size=None if box is None else [float(value) for value in box.size],
    )


def _failsafe(event: FailsafeFired) -> messages.FailsafeReport:
    return messages.FailsafeReport(
        at=_iso(event.at),
        drone_id=event.drone_id,
        event=event.event,
        threshold=event.threshold,
        # The event's action is a plain word; the message checks that it is one of ours.
        action=cast(FailsafeAction, event.action),
        # A reading that is no number fires too, and JSON has no word for it.
        value=event.value if math.isfinite(event.value) else None,
        text=event.text,
    )


def tile_from_frame(event: FrameAnnotated, now_s: float) -> bytes:
    """Return the binary message of a picture; ``now_s`` is the monotonic clock."""
    return _binary(messages.TileHeader(**_about(event, now_s)), event.jpeg)


def coded_tile_from_frame(event: FrameAnnotated, now_s: float) -> bytes:
    """Return the binary message of a picture as the drone sent it.

    Raises:
        ValueError: If it came otherwise.
    """
    if not event.coded:
        raise ValueError(f"picture {event.sequence} of {event.drone_id} has no coded form")
    header = messages.CodedTileHeader(
        **_about(event, now_s),
        key=event.coded[0].key,
        sizes=[len(picture.data) for picture in event.coded],
        marks=None if event.marks is None else _marks(event.marks),
        note=event.note,
    )
    return _binary(header, b"".join(picture.data for picture in event.coded))


def _about(event: FrameAnnotated, now_s: float) -> dict[str, Any]:
    return {
        "drone_id": event.drone_id,
        "sequence": event.sequence,
        "age_s": round(max(0.0, now_s - event.captured_s), 4),
        "damaged": event.damaged,
    }


def _marks(marks: PictureMarks) -> messages.TileMarks:
    return messages.TileMarks(
        size=list(marks.size_px),
        box=[round(float(edge), 1) for edge in marks.box.xyxy_px],
        confidence=round(marks.box.confidence, 3),
        touches_edge=marks.box.touches_edge,
        outlines=[outline.ravel().tolist() for outline in marks.outlines_px],
        yaw_error_rad=round(marks.yaw_error_rad, 4),
    )


def _binary(header: messages.TileHeader, payload: bytes) -> bytes:
    encoded = header.model_dump_json().encode()
    return len(encoded).to_bytes(4, "big") + encoded + payload
