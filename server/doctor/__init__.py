"""What is wrong with this set-up, and what to do about it; and the calibration of a camera.

Checks are functions from values to a ``Finding``; what reads the machine or asks a drone is kept
apart from what judges it. Nothing here ever makes a drone move.
"""
