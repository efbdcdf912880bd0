import json

import numpy as np

from server.geometry.boxes import Box3
from server.mission.events import Noted, SeedFitted
from server.mission.flight_recording import event_message
from server.recording.scene_messages import no_go_message
from server.stages import SeedGeometry


def test_events_become_json_with_their_name_in_words():
    box = Box3(np.zeros(3), np.ones(3))
    content = json.loads(event_message(SeedFitted(SeedGeometry(box, (box,), 4))).encoded())
    assert content["event"] == "seed_fitted"
    assert content["seed"]["outer"] == {"lower": [0.0] * 3, "upper": [1.0] * 3}
    assert content["seed"]["views"] == 4


def test_a_line_of_the_log_keeps_its_words():
    content = json.loads(event_message(Noted("warning", "wind", "drone-2")).encoded())
    assert (content["event"], content["level"], content["text"], content["drone_id"]) == (
        "noted",
        "warning",
        "wind",
        "drone-2",
    )


def test_no_go_volumes_are_blocks_and_go_when_they_are_dropped():
    column = Box3(np.array([1.0, -1.0, 0.0]), np.array([2.0, 1.0, 3.0]))
    (shown,) = no_go_message([column], 7).entities
    (cube,) = shown.cubes
    assert (cube.size.x, cube.size.y, cube.size.z) == (1.0, 2.0, 3.0)
    assert (cube.pose.position.x, cube.pose.position.z) == (1.5, 1.5)
    (dropped,) = no_go_message([], 8).entities
    # A viewer draws what a name stands for now.
    assert (dropped.id, len(dropped.cubes)) == (shown.id, 0)
