"""A recorded flight through the same pipeline again: decode, region, box, pose, seed, plan.

``recorded_fleet`` puts what a recording holds in the place of drones and eyes, ``flight`` lets the
mission's own pilot and pointing work on it by the flight's own clock (``times``), ``seeding`` and
``planning`` make seed geometries and plans when the flight made them, ``report`` sums up what came
out. The same file gives the same numbers every time.
"""
