"""The drones: protocol (no I/O), links, video, safety rules and failsafes, one drone, the fleet."""
