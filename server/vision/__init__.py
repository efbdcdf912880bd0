"""The eyes: regions, boxes, seed geometry, poses and annotation, all pure functions on values."""
