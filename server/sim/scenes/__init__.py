"""The objects and the room of the simulated world, built in code or loaded from a file."""
