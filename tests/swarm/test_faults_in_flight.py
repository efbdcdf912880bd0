"""Everything that can go wrong in the simulator, at every moment of a short flight."""

from __future__ import annotations

import asyncio

import pytest
from virtual_air import AirLink, flying_drone, in_virtual_time, now_s, setpoint

from server.sim.faults import KINDS
from server.swarm.drone import DroneError

MOMENTS = ("1", "air+0.3", "air+2", "air+6", "air+13")


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_flight_with_a_fault_ends_on_the_ground(kind: str, moment: str) -> None:
    async def story() -> None:
        link = AirLink(faults=(f"{kind}@{moment}",))
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(2.0)
            await asyncio.gather(drone.take_off(), return_exceptions=True)
            flown_s = now_s()
            while now_s() < flown_s + 10.0:
                drone.set_setpoint(setpoint(forward=0.2, turn=0.2), now_s())
                await asyncio.sleep(0.1)
            drone.land_now()
            await asyncio.sleep(20.0)
            assert not link.airframe.motors_on
            assert link.airframe.phase == "standing"
            assert drone.activity in ("ground", "offline") or not link.tello.powered
            if drone.activity == "ground":
                assert drone.telemetry is not None
                assert now_s() - drone.telemetry.received_s < 3.0

    in_virtual_time(story())


def test_a_drone_that_says_ok_and_stays_down_is_not_believed() -> None:
    async def story() -> None:
        link = AirLink(faults=("stays_down@0",))
        async with flying_drone(link, up=False) as drone:
            with pytest.raises(DroneError, match="not seen to take off"):
                await drone.take_off()
            assert drone.activity == "ground"

    in_virtual_time(story())


@pytest.mark.parametrize("seed", range(6))
def test_late_replies_confuse_nobody(seed: int) -> None:
    """Each reply may come after the wait for it, and then it is nobody's."""

    async def story() -> None:
        link = AirLink(seed=seed, faults=("late_replies=1.7", "loss=0.05"))
        async with flying_drone(link, up=False) as drone:
            for _ in range(2):
                await drone.take_off()
                assert link.airframe.phase == "flying"
                await asyncio.sleep(2.0)
                await drone.land()
                await asyncio.sleep(3.0)
                assert link.airframe.phase == "standing"

    in_virtual_time(story())
