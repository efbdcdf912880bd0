"""View planning: where pictures are worth most, who takes which, and how to get there."""
