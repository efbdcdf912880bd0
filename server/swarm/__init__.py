"""The drones: protocol (no I/O), link, video, safety rules, one drone, the fleet."""
