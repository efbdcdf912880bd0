"""Drones in simulated flight under avoidance: the plant is worse than what avoidance assumes."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from server.geometry.boxes import Box3
from server.planner.avoidance import Agent, Obstacle, avoid
from server.planner.config import PlannerConfig
from server.planner.paths import column, separation
from server.planner.route import Detour, next_detour, route_velocity

CONFIG = PlannerConfig()
RATE_HZ = 15.0
STEPS = 4


@dataclass(frozen=True)
class Plant:
    """How real drones differ from ideal ones.

    Attributes:
        lag_s: First-order lag from setpoint to velocity.
        gain_error: Greatest relative error of the velocity, per drone and axis.
        drift_m_s: Standard deviation of the hover drift.
        noise_m: Greatest error of a believed position, slowly wandering.
        latency_s: Age of beliefs, and with it of setpoints.
        velocity_step_m_s: Resolution of the reported velocity.
    """

    lag_s: float = 0.35
    gain_error: float = 0.0
    drift_m_s: float = 0.0
    noise_m: float = 0.0
    latency_s: float = 0.0
    velocity_step_m_s: float = 0.0


IDEAL = Plant()
ROUGH = Plant(0.35, 0.10, 0.03, 0.15, 0.2, 0.1)


@dataclass
class Flight:
    """What came of it; distances are true ones, heights shrunk by the downwash in ``apart_m``."""

    ends: np.ndarray
    apart_m: float = math.inf
    clearance_m: float = math.inf
    fence_m: float = math.inf
    floor_m: float = math.inf
    ceiling_m: float = math.inf
    arrived_s: float = math.inf
    fastest_m_s: float = 0.0
    trail: list[np.ndarray] = field(default_factory=list)


class _Noise:
    """Errors ``(n, 3)`` that wander slowly within a ball of ``bound``."""

    def __init__(self, count: int, bound: float, rng: np.random.Generator) -> None:
        self._bound, self._rng = bound, rng
        self.value = bound * 0.5 * rng.standard_normal((count, 3))
        self.step(0.0)

    def step(self, dt_s: float) -> None:
        keep = math.exp(-dt_s / 3.0)
        kick = 0.6 * self._bound * math.sqrt(1.0 - keep * keep)
        self.value = keep * self.value + kick * self._rng.standard_normal(self.value.shape)
        length = np.linalg.norm(self.value, axis=1, keepdims=True)
        self.value *= np.minimum(1.0, self._bound / np.maximum(length, 1e-9))


def fly(
    starts: np.ndarray,
    goals: np.ndarray,
    target: Box3 | None,
    seconds: float,
    plant: Plant = IDEAL,
    seed: int = 0,
    config: PlannerConfig = CONFIG,
    sigma_m: float = 0.0,
    arrive_m: float = 0.25,
) -> Flight:
    """Fly all drones from starts to goals ``(n, 3)``; ends early when all have stayed there."""
    rng = np.random.default_rng(seed)
    count = len(starts)
    x, v = starts.astype(float), np.zeros((count, 3))
    gain = 1.0 + plant.gain_error * rng.uniform(-1.0, 1.0, (count, 3))
    drift = plant.drift_m_s * rng.standard_normal((count, 3))
    noise = _Noise(count, plant.noise_m, rng)
    delayed: deque[np.ndarray] = deque([np.zeros((count, 3))] * round(plant.latency_s * RATE_HZ))
    first, second = np.triu_indices(count, 1)
    obstacles = [] if target is None else [Obstacle(target, config.space.standoff_m)]
    dt = 1.0 / RATE_HZ
    flight = Flight(x)
    detours: list[Detour | None] = [None] * count
    for tick in range(round(seconds * RATE_HZ)):
        noise.step(dt)
        believed = x + noise.value
        reported = v + drift
        if plant.velocity_step_m_s:
            reported = np.round(reported / plant.velocity_step_m_s) * plant.velocity_step_m_s
        wishes = [
            _wish(i, believed[i], goals[i], target, config, detours, tick * dt)
            for i in range(count)
        ]
        agents = [
            Agent(
                str(i),
                believed[i],
                reported[i],
                wishes[i],
                sigma_m,
            )
            for i in range(count)
        ]
        delayed.append(np.array(avoid(agents, obstacles, config.space, config.avoidance, dt)))
        told = delayed.popleft()
        flight.fastest_m_s = max(flight.fastest_m_s, float(np.linalg.norm(told, axis=1).max()))
        for _ in range(STEPS):
            h = dt / STEPS
            v = v + (gain * told - v) * (1.0 - math.exp(-h / plant.lag_s))
            x = x + (v + drift) * h
        keep = math.exp(-dt / 4.0)
        drift = keep * drift + plant.drift_m_s * math.sqrt(1 - keep**2) * rng.standard_normal(
            (count, 3)
        )
        flight.trail.append(x)
        _measure(flight, x, first, second, target, config)
        there = np.linalg.norm(x + noise.value - goals, axis=1).max() < arrive_m
        if not there:
            flight.arrived_s = math.inf
        elif math.isinf(flight.arrived_s):
            flight.arrived_s = (tick + 1) * dt
        elif (tick + 1) * dt > flight.arrived_s + 3.0:
            break
    flight.ends = x
    return flight


def _wish(
    index: int,
    position: np.ndarray,
    goal: np.ndarray,
    target: Box3 | None,
    config: PlannerConfig,
    detours: list[Detour | None],
    now_s: float,
) -> np.ndarray:
    if target is not None:
        detour = next_detour(detours[index], position, goal, target, config, now_s, index)
        detours[index] = detour
        return route_velocity(position, goal, target, config, detour.turning)
    way = goal - position
    distance = float(np.linalg.norm(way))
    speed = min(config.tracking.travel_speed_m_s, config.tracking.travel_gain * distance)
    return way * (speed / max(distance, 1e-9))


def _measure(
    flight: Flight,
    x: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    target: Box3 | None,
    config: PlannerConfig,
) -> None:
    if len(first):
        apart = separation(x[first], x[second], config.avoidance.downwash_factor)
        flight.apart_m = min(flight.apart_m, float(apart.min()))
    if target is not None:
        clearance = min(column(target).distance(p) for p in x)
        flight.clearance_m = min(flight.clearance_m, clearance)
    space = config.space
    beyond = space.fence_radius_m - float(np.hypot(x[:, 0], x[:, 1]).max())
    flight.fence_m = min(flight.fence_m, beyond)
    flight.floor_m = min(flight.floor_m, float(x[:, 2].min()) - space.floor_m)
    flight.ceiling_m = min(flight.ceiling_m, space.ceiling_m - float(x[:, 2].max()))


def circle(count: int, radius: float = 2.0, height: float = 1.0) -> np.ndarray:
    """Return ``count`` places ``(count, 3)`` spread evenly on a circle."""
    angles = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(count, height)], 1)
