"""DroNeRF operator console: four small drones, one object, one radiance field."""
