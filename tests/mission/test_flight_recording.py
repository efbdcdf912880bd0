import json

import numpy as np

from server.geometry.boxes import Box3
from server.mission.events import Noted, SeedFitted
from server.mission.flight_recording import event_message
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
