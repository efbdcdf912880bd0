"""Simulated Tellos: bodies, text protocol, faults, radio, video; on UDP or in one process."""
