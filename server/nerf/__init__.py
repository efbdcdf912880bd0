"""The radiance field: datasets, hash-encoded field, training, rendering and its metrics."""
