"""What came out of a replay: numbers per drone, seeds, plans, and one digest of it all."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from server.geometry.boxes import Box3
from server.mission.events import PlanFound
from server.mission.eyes import Sight
from server.stages import CameraPose, SeedGeometry


@dataclass(slots=True)
class DroneTally:
    """What one drone's part of a replay gave.

    Attributes:
        coded: Coded pictures in the file.
        decoded: Pictures that came out of them.
        damaged: Of those, how many lack data.
        searched: Pictures searched: the undamaged ones.
        boxes: Left, top, right, bottom, confidence of each picture in which the object was seen.
        poses: Believed camera position and yaw at each decoded picture.
        sigmas_m: Believed error of the position, likewise.
    """

    coded: int = 0
    decoded: int = 0
    damaged: int = 0
    searched: int = 0
    boxes: list[list[float]] = field(default_factory=list[list[float]])
    poses: list[list[float]] = field(default_factory=list[list[float]])
    sigmas_m: list[float] = field(default_factory=list[float])

    def add(self, sight: Sight, pose: CameraPose) -> None:
        """Count a picture."""
        self.decoded += 1
        self.damaged += sight.frame.damaged
        self.searched += not sight.frame.damaged
        if sight.box is not None:
            self.boxes.append([*sight.box.xyxy_px.tolist(), sight.box.confidence])
        self.poses.append([*pose.position_world.tolist(), pose.yaw_rad])
        self.sigmas_m.append(pose.position_sigma_m)

    def summary(self) -> dict[str, Any]:
        """Return its numbers; means over pictures, lengths in metres or pixels."""
        found: dict[str, Any] = {
            "coded": self.coded,
            "decoded": self.decoded,
            "damaged": self.damaged,
            "searched": self.searched,
            "detected": len(self.boxes),
        }
        if self.boxes:
            boxes = np.array(self.boxes)
            size = boxes[:, 2:4] - boxes[:, :2]
            found |= {
                "box_width_px": _rounded(size[:, 0].mean(), 1),
                "box_height_px": _rounded(size[:, 1].mean(), 1),
                "box_confidence": _rounded(boxes[:, 4].mean(), 3),
            }
        if self.poses:
            found |= {
                "position_world": [_rounded(value, 3) for value in self.poses[-1][:3]],
                "yaw_rad": _rounded(self.poses[-1][3], 4),
                "position_sigma_m": _rounded(float(np.mean(self.sigmas_m)), 3),
            }
        return found


@dataclass(slots=True)
class ReplayResult:
    """What came out.

    Attributes:
        file: The recording.
        whole: Whether it was ended properly.
        seconds: Length of the recording.
        drones: By drone id.
        seeds: The seed geometry as it was first fitted and each time it was refined.
        plans: The plan and each one that took its place.
        remarks: What could not be done, and why.
    """

    file: str
    whole: bool
    seconds: float
    drones: dict[str, DroneTally]
    seeds: list[SeedGeometry] = field(default_factory=list[SeedGeometry])
    plans: list[PlanFound] = field(default_factory=list[PlanFound])
    remarks: list[str] = field(default_factory=list[str])

    def as_json(self) -> dict[str, Any]:
        """Return everything for people and programs; equal digests mean equal numbers."""
        return {
            "file": self.file,
            "whole": self.whole,
            "seconds": round(self.seconds, 3),
            "drones": {drone_id: tally.summary() for drone_id, tally in self.drones.items()},
            # The newest of each; all of them count for the digest.
            "seed": _seed(self.seeds[-1]) if self.seeds else None,
            "seeds": len(self.seeds),
            "plan": _plan(self.plans[-1]) if self.plans else None,
            "plans": len(self.plans),
            "remarks": self.remarks,
            "digest": self.digest(),
        }

    def digest(self) -> str:
        """Return a hash of every box, every pose, all seeds and all plans, to the last bit."""
        everything = {
            "boxes": {drone_id: tally.boxes for drone_id, tally in self.drones.items()},
            "poses": {drone_id: tally.poses for drone_id, tally in self.drones.items()},
            "seeds": [_seed(seed) for seed in self.seeds],
            "plans": [_plan(plan) for plan in self.plans],
        }
        return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()


def _seed(seed: SeedGeometry) -> dict[str, Any]:
    return {
        "views": seed.views,
        "volume_m3": seed.outer.volume_m3,
        "outer": _corners(seed.outer),
        "boxes": [_corners(box) for box in seed.boxes],
    }


def _corners(box: Box3) -> list[list[float]]:
    return [box.lower.tolist(), box.upper.tolist()]


def _plan(plan: PlanFound) -> dict[str, Any]:
    placement, rounds = plan.placement, plan.assignment.rounds
    return {
        "fitness": placement.fitness,
        "bound": placement.bound,
        "candidates": placement.candidates,
        "rounds": [
            {d: [*view.position_world.tolist(), view.yaw_rad] for d, view in row.items()}
            for row in rounds
        ],
    }


def _rounded(value: float, digits: int) -> float:
    return round(float(value), digits)
