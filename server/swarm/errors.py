"""What the driver raises to whoever flies."""


class DroneError(Exception):
    """A drone refused or did not do what it was told; the text says which and why."""
