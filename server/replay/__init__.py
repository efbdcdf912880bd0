"""A recorded flight through the same pipeline again: decode, region, box, pose, seed, plan.

``recorded_fleet`` puts what a recording holds in the place of drones and eyes, ``flight`` lets the
mission's own pilot, seed geometry and planning work on it in the file's own time, ``report`` sums
up what came out. The same file gives the same numbers every time.
"""
