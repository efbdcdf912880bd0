"""Flights with one part of the method left out."""

from __future__ import annotations

from dataclasses import replace

from server.mission.config import FlightConfig

# Nothing can be trimmed in so short a time; the config wants it positive.
_NO_TIME_S = 1e-3


def left_out(config: FlightConfig, part: str) -> FlightConfig:
    """Return ``config`` for a flight without ``part``; itself when the part is none of a flight.

    ``annealing``: the greedy choice is flown. ``trim``: no PID on the box before a picture.
    ``uncertainty``: plans do not count how far a picture may miss under an unsure pose (Algorithm
    1's agreement).
    """
    planner, mission = config.planner, config.mission
    if part == "annealing":
        planner = replace(planner, annealing=replace(planner.annealing, swaps=0, restarts=0))
    elif part == "trim":
        mission = replace(mission, tune_timeout_s=_NO_TIME_S)
    elif part == "uncertainty":
        planner = replace(planner, fitness=replace(planner.fitness, weight_agreement=0.0))
    return replace(config, planner=planner, mission=mission)
