"""Listening to the drones: everything is heard, and nothing that listens can disturb a flight."""

from __future__ import annotations

import asyncio

from virtual_air import AirLink, fleet_on, in_virtual_time, plain

from server.swarm.tap import Tap


class Hearing:
    def __init__(self):
        self.sent_texts = []
        self.replies = []
        self.reports = []
        self.video = []

    def sent(self, drone_id, datagram, at_s):
        self.sent_texts.append(plain(datagram).decode())

    def replied(self, drone_id, datagram, at_s):
        self.replies.append(datagram)

    def reported(self, telemetry, activity):
        self.reports.append((telemetry, activity))

    def filmed(self, drone_id, datagram, at_s):
        self.video.append(datagram)


class Deaf(Hearing):
    def sent(self, drone_id, datagram, at_s):
        raise RuntimeError("no room")


def test_everything_of_a_flight_is_heard():
    async def fly():
        hearing, link = Hearing(), AirLink(camera=lambda now_s: [b"picture"])
        async with fleet_on({"drone-1": link}) as fleet:
            fleet.tap.attach(hearing)
            drone = fleet.drones["drone-1"]
            await drone.connect()
            await drone.take_off()
            await asyncio.sleep(0.5)
            await drone.land()
            fleet.tap.detach(hearing)
            heard = len(hearing.sent_texts)
            await asyncio.sleep(2.0)
            assert len(hearing.sent_texts) == heard
        return hearing, link

    hearing, link = in_virtual_time(fly())
    sent = [plain(datagram).decode() for _, datagram in link.sent]
    assert hearing.sent_texts == sent[: len(hearing.sent_texts)]
    assert {"command", "streamon", "takeoff", "land"} <= set(hearing.sent_texts)
    assert any(b"ok" in reply for reply in hearing.replies)
    activities = [activity for _, activity in hearing.reports]
    order = ["ground", "taking_off", "flying", "landing"]
    firsts = [activities.index(activity) for activity in order]
    assert firsts == sorted(firsts)
    assert b"picture" in hearing.video


def test_a_listener_that_raises_is_let_go_and_the_drone_flies_on():
    async def fly():
        async with fleet_on({"drone-1": AirLink()}) as fleet:
            fleet.tap.attach(Deaf())
            drone = fleet.drones["drone-1"]
            await drone.connect()
            await drone.take_off()
            assert drone.activity == "flying"
            await drone.land()
        return fleet.tap.failures

    assert in_virtual_time(fly()) == 1


def test_only_the_newest_listener_hears_and_an_older_one_cannot_silence_it():
    tap, first, second = Tap(), Hearing(), Hearing()
    tap.attach(first)
    tap.attach(second)
    tap.detach(first)
    tap.sent("drone-1", b"land", 1.0)
    assert (first.sent_texts, second.sent_texts) == ([], ["land"])
