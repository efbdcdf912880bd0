"""Simulated Tellos: a rendered world, flight dynamics and drones that speak the real protocol."""
